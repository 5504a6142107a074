"""The order that counts, and the readings for it that have come in: two values that are told beside the table.

An order bears the claim to the root's slot by which it was given. The one that bears the claim that stands counts
before any other, then the newer one: what a root ordered that another has displaced is forgotten by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec

from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order
from mission.tree.slot_registers import SlotRegister


class Orders:
    """One drone's knowledge of them."""

    def __init__(self) -> None:
        self.order: Order | None = None
        self.ordered_by: SlotRegister | None = None
        self._greatest_sequence = 0
        self._readings: dict[int, Reading] = {}

    @property
    def next_sequence(self) -> int:
        """Greater than that of any order heard of."""
        return self._greatest_sequence + 1

    @property
    def readings(self) -> tuple[Reading, ...]:
        """The readings for the current order that have reached this drone, by ascending drone."""
        return tuple(self._readings[drone] for drone in sorted(self._readings))

    def offer(self, order: Order, ordered_by: SlotRegister, root: SlotRegister) -> None:
        """Hear of an order; `root` is the claim to the root's slot that stands."""
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
        if self.order is None or order.sequence != self.order.sequence:
            self._readings = {}
        self.order, self.ordered_by = order, ordered_by

    def note(self, readings: Iterable[Reading], slots: Mapping[int, int]) -> None:
        """Keep the readings for the current order of drones that hold a slot."""
        for reading in readings:
            is_current = self.order is not None and reading.order == self.order.sequence
            if is_current and reading.drone in slots:
                self._readings[reading.drone] = reading


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


def _authority(order: Order, ordered_by: SlotRegister, root: SlotRegister) -> tuple[bool, int, bytes]:
    """Which of two orders counts; of two that a liar made equal any, but for everybody the same."""
    return ordered_by == root, order.sequence, msgspec.msgpack.encode((order, ordered_by))
