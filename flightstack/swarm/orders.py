"""The order that counts, which is told beside the table.

An order bears the claim to the root's slot by which it was given. The one that bears the claim that stands counts
before any other, then the newer one: what a root ordered that another has displaced is forgotten by itself. But the
end of the survey stands, also when the root that found the source has gone home, and been replaced, before all heard
it.

Orders are numbered, and no number may be further than `STRIDE` beyond all that were heard of before: what is further
off counts for that much and is not taken until the numbers have come near, so that nobody can use them up at once.
One that comes late to a swarm with great numbers catches up by as many messages as it takes.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping

import msgspec

from flightstack.swarm.wire import NO_ORDER
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order
from mission.tree.slot_registers import STRIDE, SlotRegister


class Orders:
    """One drone's knowledge of them."""

    def __init__(self) -> None:
        self.order: Order | None = None
        self.ordered_by: SlotRegister | None = None
        self._greatest_sequence = 0
        self._digested: tuple[str, Order, SlotRegister] | None = None
        self._digest = NO_ORDER

    def digest(self, survey: str) -> int:
        """32 bits that differ where two drones would tell another order, or that of another survey; `NO_ORDER` where
        none is known."""
        order, ordered_by, known = self.order, self.ordered_by, self._digested
        if order is None or ordered_by is None:
            return NO_ORDER
        if known is None or known[0] != survey or known[1] is not order or known[2] is not ordered_by:
            self._digested = survey, order, ordered_by
            self._digest = zlib.crc32(msgspec.msgpack.encode(self._digested)) or 1
        return self._digest

    @property
    def next_sequence(self) -> int:
        """Greater than that of any order heard of."""
        return self._greatest_sequence + 1

    def offer(self, order: Order, ordered_by: SlotRegister, root: SlotRegister) -> None:
        """Hear of an order; `root` is the claim to the root's slot that stands."""
        if order == self.order and ordered_by == self.ordered_by:
            return
        if order.sequence > (limit := self._greatest_sequence + STRIDE):
            self._greatest_sequence = limit
            return
        self._greatest_sequence = max(self._greatest_sequence, order.sequence)
        known, known_by = self.order, self.ordered_by
        if (
            known is None
            or known_by is None
            or _authority(order, ordered_by, root) > _authority(known, known_by, root)
        ):
            self.set(order, ordered_by)

    def set(self, order: Order, ordered_by: SlotRegister) -> None:
        self._greatest_sequence = max(self._greatest_sequence, order.sequence)
        self.order, self.ordered_by = order, ordered_by


def stopped_anchor(
    order: Order, layout: Layout, stay: Mapping[int, int], where: Mapping[int, Vector3 | None]
) -> Vector3:
    """Where a formation that flies `order` stands now, NED: the mean of where those are (`where`, by drone) who keep
    their slots (`stay`, drone -> slot), less their offsets; at the order's height. The order's anchor if nobody's
    place is known."""
    corners: list[tuple[float, float]] = []
    for drone, slot in stay.items():
        position = where.get(drone)
        if position is not None:
            offset_n, offset_e = rotated(layout.offset_m(slot), order.rotation_rad)
            corners.append((position[0] - offset_n, position[1] - offset_e))
    if not corners:
        return order.anchor_ned_m
    north_m, east_m = (math.fsum(axis) / len(corners) for axis in zip(*corners, strict=True))
    return north_m, east_m, order.anchor_ned_m[2]


def _authority(order: Order, ordered_by: SlotRegister, root: SlotRegister) -> tuple[bool, bool, int, bytes]:
    """Which of two orders counts; of two that a liar made equal any, but for everybody the same."""
    ends = order.stage.ends_survey and ordered_by.version <= root.version
    return ends, ordered_by == root, order.sequence, msgspec.msgpack.encode((order, ordered_by))
