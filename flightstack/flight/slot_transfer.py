"""On the way to a slot: forming up at the start, and flying to another's slot as its heir.

A small state machine, one step a tick. While it is under way the swarm waits for this drone; so it ends also where
the drone cannot get in, because a vehicle whose agent died hovers there.
"""

from __future__ import annotations

import enum
import math

import msgspec

from flightstack.flight.transitions import IN_FORMATION
from flightstack.swarm.wire import Phase
from mission.geometry.frames import Vector3
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Order, Stage

AT_SLOT_M = 1.2

APPROACH_BLOCKED_S = 20.0
"""How long a drone may stand still on its way to its slot, or be beside it and come no nearer: a vehicle whose agent
died may hover in the slot, and the swarm would wait until its battery is empty."""

NEARER_M = 0.5
"""What counts as having come nearer: the guard steps aside before that vehicle, to and fro."""

TRANSFER_LIMIT_S = 60.0
"""How long the swarm waits for an heir on its way to the empty slot."""


class SlotState(enum.Enum):
    SETTLED = "settled"
    """No way to a slot is flown: in it, or not in the formation at all."""
    FORMING_UP = "forming_up"
    TRANSFER = "transfer"
    """On the way to a slot that a heal gave this drone."""


class SlotStep(msgspec.Struct, frozen=True):
    state: SlotState
    formed_up: bool
    """Forming up, and in the slot, or as near to it as this drone gets."""

    @property
    def transferring(self) -> bool:
        return self.state is SlotState.TRANSFER


class SlotTransfer:
    """The state of one drone. `step` is called once a tick."""

    def __init__(self, separation_m: float) -> None:
        """`separation_m`: no two drones come nearer than this, so twice as far from its slot a drone may be kept."""
        self._beside_m = 2.0 * separation_m
        self.state = SlotState.SETTLED
        self._since_s = 0.0
        self._nearest_m = math.inf
        self._nearest_s = 0.0
        """When it last came nearer to its slot than it had been on this way."""
        self._approach = Arrival(
            arrival_m=AT_SLOT_M, settle_mps=math.inf, settle_s=0.0, blocked_s=APPROACH_BLOCKED_S
        )

    def step(
        self,
        now_s: float,
        phase: Phase,
        *,
        moved: bool,
        position_ned_m: Vector3 | None,
        velocity_ned_mps: Vector3 | None,
        slot_ned_m: Vector3 | None,
    ) -> SlotStep:
        """One tick. `phase` is that of the tick before, `moved` tells of a heal that gave this drone another slot,
        `slot_ned_m` is where its slot is now; None: not known."""
        self._begin(now_s, phase, moved=moved)
        there = False
        if (
            self.state is not SlotState.SETTLED
            and slot_ned_m is not None
            and position_ned_m is not None
            and velocity_ned_mps is not None
        ):
            there = self._approach.step(now_s, position_ned_m, velocity_ned_mps, slot_ned_m)
            distance_m = math.dist(position_ned_m, slot_ned_m)
            if distance_m > self._beside_m or distance_m < self._nearest_m - NEARER_M:
                self._nearest_m, self._nearest_s = distance_m, now_s
        else:
            self._approach.interrupt()
        held_up = now_s - self._nearest_s > APPROACH_BLOCKED_S or now_s - self._since_s > TRANSFER_LIMIT_S
        if self.state is SlotState.TRANSFER and (there or held_up):
            self.state = SlotState.SETTLED
            self._approach.interrupt()
        return SlotStep(self.state, there and self.state is SlotState.FORMING_UP)

    def _begin(self, now_s: float, phase: Phase, *, moved: bool) -> None:
        if phase is Phase.FORMING:
            self.state = SlotState.FORMING_UP
        elif phase in IN_FORMATION and moved:
            self.state, self._since_s = SlotState.TRANSFER, now_s
            self._nearest_m, self._nearest_s = math.inf, now_s
        elif self.state is SlotState.FORMING_UP or phase not in IN_FORMATION | {Phase.HOLDING}:
            self.state = SlotState.SETTLED


def is_awaited(phase: Phase, slot: int, order: Order | None, step: SlotStep) -> bool:
    """Whether the swarm holds for a drone (`slot` -1: it has none): it flies to a slot in a formation that is on its
    way. Drones that search apart wait for nobody."""
    is_on_its_way = order is not None and order.stage is not Stage.FORM and not order.apart
    return step.transferring or (phase is Phase.FORMING and slot >= 0 and is_on_its_way)
