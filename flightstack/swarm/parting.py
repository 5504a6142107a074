"""What a drone does when the swarm comes apart: the one place for what a part of a swarm does.

Several nodes that fall silent together, drones that took part or the ground station, have not all failed: the own
radio has, or a ridge is between. Then two parts that cannot hear each other would fly the same search on the same
points; so only the larger one goes on, of equal ones that of the lowest id, and the other goes home. A single drone
that falls silent has failed itself, and the tree heals around it (`flightstack.swarm.swarm_table`). While the
ground station is heard, it tells each part where the other is, and both go on.

All times are on this drone's own clock: when somebody was heard last.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping

ADRIFT_S = 5.0
"""A peer whose agent has been silent for so long does not make way any more."""

TOGETHER_S = 2.0
"""Nodes whose last words came within this time fell silent together."""

PARTING_S = 20.0
"""So long after it was noticed a parting of the swarm decides who goes home; later the tree has healed around it."""

GOES_HOME_BECAUSE = (
    "most of the swarm fell silent at one moment: the own radio has failed, or a ridge is between"
)


class Part(enum.Enum):
    """What this drone belongs to, as far as it hears."""

    WHOLE = "whole"
    """The swarm, with at most single losses."""
    LARGER = "larger"
    """The part of a swarm come apart that goes on with the survey."""
    SMALLER = "smaller"
    """The part that goes home."""


def part_of(
    now_s: float,
    drone: int,
    heard_s: Mapping[int, float],
    ground_heard_s: float | None,
    lost_after_s: float,
) -> Part:
    """The part that `drone` is in. `heard_s`: when each other drone that took part was heard last; `lost_after_s`:
    how long one must be silent to count as lost."""
    if ground_heard_s is not None and now_s - ground_heard_s <= lost_after_s:
        return Part.WHOLE
    silent_s = {other: at_s for other, at_s in heard_s.items() if now_s - at_s > lost_after_s}
    if not silent_s:
        return Part.WHOLE
    last_s = max(silent_s.values())
    if now_s - last_s > lost_after_s + PARTING_S:
        return Part.WHOLE
    gone = {other for other, at_s in silent_s.items() if at_s > last_s - TOGETHER_S}
    ground_gone = ground_heard_s is not None and abs(ground_heard_s - last_s) < TOGETHER_S
    if len(gone) + ground_gone < 2:
        return Part.WHOLE
    with_us = {drone, *heard_s} - silent_s.keys()
    smaller = len(with_us) == 1 or (len(gone), -min(gone)) > (len(with_us), -min(with_us))
    return Part.SMALLER if smaller else Part.LARGER


def is_adrift(silence_s: float) -> bool:
    """Whether a drone that has been silent for so long can no longer be expected to make way."""
    return silence_s > ADRIFT_S
