"""Whom a drone in the tree has to miss when it falls silent."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mission.geometry.formation import SlotTable


def watched(
    slots: Mapping[int, int], present: Collection[int], table: SlotTable, drone: int
) -> frozenset[int]:
    """The drones that `drone` watches, in an assignment drone -> slot of those that are `present`.

    The next above and below in the tree, beyond empty slots too, so that a branch whose drones are lost together is
    found out from both its ends; the others next below an empty root's slot; and who has no slot, and so no
    neighbours, yet.
    """
    found = set(present - slots.keys())
    own = slots.get(drone)
    if own is not None:
        holder = {slot: other for other, slot in slots.items()}
        above = _next_above(own, holder, table)
        for slot, other in holder.items():
            up = _next_above(slot, holder, table)
            if slot != own and (up == own or slot == above or (up is None and above is None)):
                found.add(other)
    return frozenset(found - {drone})


def _next_above(slot: int, holder: Mapping[int, int], table: SlotTable) -> int | None:
    """The nearest held slot on the way to the root."""
    up = int(table.parent[slot])
    while up >= 0 and up not in holder:
        up = int(table.parent[up])
    return up if up >= 0 else None
