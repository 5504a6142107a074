"""Readings on their way to the root: each is told until somebody nearer to the root says that it has it.

A drone tells its own reading at once. A parent that hears one of its child's waits `RELAY_AFTER_S`: mostly the root
has heard it too, and says so. Otherwise the parent tells it as if it were its own, and so on up the tree. So at rest
nothing is said, and what a drone says grows with what comes up through it, not with the swarm.

Where the way up is broken (the parent's slot is empty, or it does not hear this drone) a reading is told
`to_anybody`: then every drone that hears it takes it up its own way.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flightstack.swarm.wire import ReadingsState
from mission.estimation.estimates import Reading
from mission.strategies.contract import Order
from mission.tree.balanced_tree import Place

PERIOD_S: Final = 0.2
"""The shortest time between two tellings."""

RELAY_AFTER_S: Final = 0.2
"""How long another's reading waits for the root's own word that it has it."""

REPEATED_S: Final = 0.5
"""How long an answer is waited for: the parent passes the reading on, which is its answer, after a while itself."""

LOST_WAY_S: Final = 1.0
"""A reading that has waited here for so long is told to anybody, and from then on only so often."""


class ReadingRelay:
    """One drone's knowledge of the readings for the current order; `follow` once a tick, before all else."""

    def __init__(self, drone: int) -> None:
        self._drone = drone
        self._order: Order | None = None
        self._readings: dict[int, Reading] = {}
        self._above: int | None = None
        self._root: int | None = None
        self._below: frozenset[int] = frozenset()
        self._unconfirmed_s: dict[int, float] = {}
        """By drone: since when its reading is here and not known to be further up."""
        self._again_s: dict[int, float] = {}
        """By drone: when its unconfirmed reading is to be told next."""
        self._owed: set[int] = set()
        """Whose readings were told to this drone, which has not said yet that it has them."""
        self._told_s: float | None = None

    @property
    def readings(self) -> tuple[Reading, ...]:
        """By ascending drone: at the root all that have come up, elsewhere those of the own subtree."""
        return tuple(self._readings[drone] for drone in sorted(self._readings))

    def follow(self, order: Order | None, family: Place | None) -> None:
        """The order that counts now, and this drone's relations in the tree, None without a slot."""
        if order != self._order:
            self._order = order
            self._readings = {}
            self._unconfirmed_s = {}
            self._owed = set()
        self._above = family.parent if family is not None else None
        self._root = family.root if family is not None else None
        self._below = frozenset(family.children) if family is not None else frozenset()

    def note(self, now_s: float, reading: Reading) -> None:
        """This drone's own."""
        self._keep(now_s, reading)

    def hear(self, now_s: float, told: ReadingsState, slots: Mapping[int, int]) -> None:
        """What another tells; `slots` are those of all that take part."""
        if self._order is None or told.order != self._order.sequence:
            return
        if told.sender in (self._above, self._root):
            for drone in (*told.held, *(reading.drone for reading in told.readings)):
                self._unconfirmed_s.pop(drone, None)
                self._owed.discard(drone)
        elif self._is_root or told.sender in self._below or told.to_anybody:
            for reading in told.readings:
                if reading.drone in slots:
                    self._keep(now_s, reading)
                    self._owed.add(reading.drone)

    def due(self, now_s: float, tick_s: float) -> tuple[tuple[Reading, ...], tuple[int, ...], bool] | None:
        """What is to be told in this tick, as `readings`, `held` and `to_anybody` of a `ReadingsState`; None:
        nothing. What is given counts as told."""
        soon_s = now_s + 0.5 * tick_s
        if self._told_s is not None and soon_s - self._told_s < PERIOD_S:
            return None
        waiting = self._unconfirmed_s
        ready = {drone for drone in waiting if soon_s >= self._again_s[drone]}
        held = self._owed - waiting.keys()
        if not (ready or held):
            return None
        has_way = self._above is not None and all(now_s - waiting[drone] < LOST_WAY_S for drone in ready)
        for drone in ready:
            self._again_s[drone] = now_s + (REPEATED_S if has_way else LOST_WAY_S)
        self._told_s = now_s
        self._owed -= ready | held
        return tuple(self._readings[drone] for drone in sorted(ready)), tuple(sorted(held)), not has_way

    @property
    def _is_root(self) -> bool:
        return self._root == self._drone

    def _keep(self, now_s: float, reading: Reading) -> None:
        if self._order is None or reading.order != self._order.sequence:
            return
        if self._readings.get(reading.drone) != reading:
            self._readings[reading.drone] = reading
            if not self._is_root:
                self._unconfirmed_s[reading.drone] = now_s
                wait_s = 0.0 if reading.drone == self._drone else RELAY_AFTER_S
                self._again_s[reading.drone] = now_s + wait_s
