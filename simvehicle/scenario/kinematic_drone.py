"""A drone whose swarm code is that of flight and whose vehicle is a point that flies straight.

What it hears goes through the drone's own `Peers`, `SwarmTable` and `Exchange`; what is left out are autopilot,
instruments, filters, the guard and the strategy, in whose place a plain rule stands: take a reading in the slot, and
as root send the formation a step on when all readings are in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from flightstack.swarm.admission import Message
from flightstack.swarm.exchange import Exchange, OrderExchange
from flightstack.swarm.parting import Part
from flightstack.swarm.peers import Peers
from flightstack.swarm.swarm_table import SwarmTable
from flightstack.swarm.topics import ORDER, READINGS, STATE, TABLE, Topic
from flightstack.swarm.wire import (
    NO_ORDER,
    TAKING_PART,
    DroneState,
    OrderState,
    Phase,
    ReadingsState,
    TableState,
)
from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Hold, Order, Stage, TreePlace

TICK_S: Final = 0.1
STATE_TICKS: Final = 2
"""A state is told five times a second."""
SPEED_MPS: Final = 5.0
ARRIVED_M: Final = 1.2
TRANSFER_LIMIT_S: Final = 60.0
"""How long a drone says that it is on the way to its slot, as `flightstack.flight.slot_transfer`."""
SUSPECT_AFTER_S: Final = 0.8
LOST_AFTER_S: Final = 3.0
READINGS_WITHIN_S: Final = 10.0
"""How long the root waits for readings."""
STEP_M: Final = 3.0
UP_AGAIN_S: Final = 3.0
"""From an agent's start to its taking part: it reads its vehicle and is told of the survey."""
_PART_TICKS: Final = 5
_OF_THE_TABLE: Final = (TableState, OrderState, ReadingsState)
_HOLD: Final = Hold()


class KinematicDrone:
    """One drone; `hear`, `step` and `tell` once a tick, in this order."""

    def __init__(
        self,
        drone: int,
        members: tuple[int, ...],
        layout: Layout,
        *,
        incarnation: int,
        position_ned_m: Vector3,
        phase: Phase = Phase.SEARCHING,
    ) -> None:
        self.drone = drone
        self.phase = phase
        self.position_ned_m = position_ned_m
        self.home_ned_m = position_ned_m
        self.peers = Peers(drone)
        self.table = SwarmTable(
            drone,
            members,
            layout,
            frame_identity=0,
            incarnation=incarnation,
            suspect_after_s=SUSPECT_AFTER_S,
        )
        self.place: TreePlace | None = None
        self.sent_home = False
        """An operator or its own battery has sent it home: it does not come back."""
        self._layout = layout
        self._incarnation = incarnation
        self._tables = Exchange(TICK_S)
        self._orders = OrderExchange(TICK_S)
        self._heard: list[TableState | OrderState | ReadingsState] = []
        self._decision: Decision | None = None
        self._told = 0
        self._ticks = drone
        self._transfer_s: float | None = None
        """Since when it has been on its way to a new slot."""
        self._read: Order | None = None
        """The order for which it has taken its reading."""
        self._read_s = 0.0

    @property
    def takes_part(self) -> bool:
        return self.phase in TAKING_PART

    @property
    def has_arrived(self) -> bool:
        """It is not on its way to a new slot."""
        return self._transfer_s is None

    def hear(self, now_s: float, messages: Iterable[Message]) -> None:
        peers = self.peers
        for message in messages:
            if isinstance(message, DroneState):
                peers.hear(now_s, message)
            elif isinstance(message, _OF_THE_TABLE) and peers.speaks(message.sender, message.incarnation):
                self._heard.append(message)
                peers.hear(now_s, message)

    def step(self, now_s: float) -> None:
        self._ticks += 1
        table = self.table
        if table.survey is not None and not self.takes_part:
            table.leave()
        elif table.survey is not None and self.phase not in (Phase.ARMING, Phase.TAKEOFF):
            table.rejoin()
        heard, self._heard = self._heard, []
        news = table.step(now_s, heard, self.peers.facts(), self._decision, self.position_ned_m)
        self._decision = None
        self.place = table.place(now_s)
        if news.moved:
            self._transfer_s = now_s
        if self._ticks % _PART_TICKS == 0:
            self._choose_phase(now_s)
        self._fly(now_s)

    def tell(self, now_s: float) -> list[tuple[Topic, bytes]]:
        """What is due."""
        said: list[tuple[Topic, bytes]] = []
        table = self.table
        started = table.survey is not None
        if self._ticks % STATE_TICKS == 0:
            said.append((STATE, STATE.codec.encode(self._state())))
        if started and self._tables.is_due(now_s, table.digest, self.peers.facts(), table.slots):
            said.append((TABLE, TABLE.codec.encode(table.message())))
        ordered = table.order_digest
        if ordered != NO_ORDER and self._orders.is_due(now_s, ordered, self.peers.facts()):
            said.append((ORDER, ORDER.codec.encode(table.order_message())))
        readings = table.readings_message(now_s, TICK_S)
        if readings is not None:
            said.append((READINGS, READINGS.codec.encode(readings)))
        return said

    def _choose_phase(self, now_s: float) -> None:
        """As the drone's phases do: the smaller part of a swarm goes home, and comes back if it meets the others."""
        if self.phase is Phase.SEARCHING:
            if self.peers.part(now_s, LOST_AFTER_S) is Part.SMALLER:
                self.phase = Phase.RETURNING
        elif self.phase is Phase.RETURNING and not self.sent_home:
            near = any(f.taking_part and now_s - f.heard_s < 1.0 for f in self.peers.facts().values())
            if near and self.peers.part(now_s, LOST_AFTER_S) is not Part.SMALLER:
                self.phase = Phase.SEARCHING

    def _fly(self, now_s: float) -> None:
        place, order = self.place, self.table.order
        if self.phase is Phase.RETURNING:
            self._transfer_s = None
            self._towards(self.home_ned_m)
            return
        if place is None or place.slot < 0 or order is None or not self.takes_part:
            return
        if place.healing and self._transfer_s is None:
            return
        north_m, east_m = rotated(self._layout.offset_m(place.slot), order.rotation_rad)
        anchor = order.anchor_ned_m
        distance_m = self._towards((anchor[0] + north_m, anchor[1] + east_m, anchor[2]))
        if self._transfer_s is not None:
            if distance_m < ARRIVED_M or now_s - self._transfer_s > TRANSFER_LIMIT_S:
                self._transfer_s = None
        elif distance_m < ARRIVED_M or self._read == order:
            self._search(now_s, place, order)

    def _search(self, now_s: float, place: TreePlace, order: Order) -> None:
        if self._read != order:
            self._read, self._read_s = order, now_s
        reading = Reading(self.drone, order.sequence, self.position_ned_m, 0.0, 1.0)
        following: Order | None = None
        if place.slot == 0:
            read = {known.drone for known in self.table.readings}
            if place.slots.keys() <= read or now_s - self._read_s > READINGS_WITHIN_S:
                north_m, east_m, down_m = order.anchor_ned_m
                following = Order(order.sequence + 1, Stage.SEARCH, (north_m + STEP_M, east_m, down_m), 0.0)
        self._decision = Decision(_HOLD, reading, following)

    def _towards(self, target_ned_m: Vector3) -> float:
        """Fly straight for a tick; the distance that is left."""
        distance_m = math.dist(self.position_ned_m, target_ned_m)
        step_m = SPEED_MPS * TICK_S
        if distance_m <= step_m:
            self.position_ned_m = target_ned_m
            return 0.0
        share = step_m / distance_m
        a, b = self.position_ned_m, target_ned_m
        self.position_ned_m = (
            a[0] + share * (b[0] - a[0]),
            a[1] + share * (b[1] - a[1]),
            a[2] + share * (b[2] - a[2]),
        )
        return distance_m - step_m

    def _state(self) -> DroneState:
        self._told += 1
        place = self.place
        return DroneState(
            self.drone,
            self._incarnation,
            self._told,
            0,
            self.phase,
            self.position_ned_m,
            (0.0, 0.0, 0.0),
            0.0,
            self.home_ned_m,
            True,
            True,
            "GUIDED",
            1.0,
            None,
            None,
            None,
            place.epoch if place else 0,
            place.slot if place and place.slot >= 0 else None,
            place.parent if place else None,
            self._transfer_s is not None,
            None,
            table_digest=self.table.digest,
            order_digest=self.table.order_digest,
        )
