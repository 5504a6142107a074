"""How a swarm comes apart into sub-swarms. Plain functions: the agent calls them, the trials compile them."""

from __future__ import annotations


def group_count(drones: int, size: int) -> int:
    """How many sub-swarms of about `size` drones."""
    return max(1, drones // size)


def group_begin(group: int, groups: int, drones: int) -> int:
    """The number of the first drone of sub-swarm `group` (from 0) of `groups`; the next one's first ends it."""
    return group * drones // groups
