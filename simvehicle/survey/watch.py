"""What the launcher learns of a survey: from the swarm's messages, and from the world's own record.

No I/O and no clock: messages come with the simulated time at which they were received.
"""

from __future__ import annotations

import collections
import enum
import math
from collections.abc import Iterable, Sequence

import msgspec

from flightstack.swarm import topics
from flightstack.swarm.membership import merge_members
from flightstack.swarm.topics import Topic
from flightstack.swarm.wire import (
    TAKING_PART,
    CommandOutcome,
    DroneState,
    Event,
    MemberRegister,
    OrderState,
    Phase,
    Severity,
    TableState,
    WireError,
)
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order, Stage
from simvehicle.fleet.truth import TruthRow

RECEIVES = (topics.STATE, topics.TABLE, topics.ORDER, topics.OUTCOME, topics.EVENT)
GETTING_THERE = frozenset({Phase.ARMING, Phase.TAKEOFF, Phase.FORMING})
"""The phases of a member that is on the way to its first slot, or to its slot after it had lost one."""
SILENT_S = 5.0
"""Simulated seconds without a state message after which an agent counts as silent."""


class PhaseMark(msgspec.Struct, frozen=True):
    time_s: float
    drone: int
    phase: Phase


class EventMark(msgspec.Struct, frozen=True):
    time_s: float
    drone: int
    """0: the launcher itself, or the swarm as a whole."""
    severity: Severity
    code: str
    text: str


class TreeMark(msgspec.Struct, frozen=True):
    """An assignment of slots when it was first heard of."""

    time_s: float
    slots: dict[int, int]
    """drone -> slot."""


class SlotMark(msgspec.Struct, frozen=True):
    """What a drone said of its own slot, when it changed."""

    time_s: float
    drone: int
    slot: int | None
    """None while it takes no part, too."""
    moving: bool
    """It is on the way there."""


class WatchStanding(enum.StrEnum):
    """What the swarm says of a member."""

    THERE = "there"
    DOUBTED = "doubted"
    """Missed by somebody."""
    GONE = "gone"
    """Counted out by somebody: lost, or gone by its own word."""


class StandingMark(msgspec.Struct, frozen=True):
    """When what the swarm says of a member changed."""

    time_s: float
    drone: int
    standing: WatchStanding


class OrderMark(msgspec.Struct, frozen=True):
    time_s: float
    order: Order


class Log(msgspec.Struct, frozen=True):
    """What is worth keeping of a survey; the summary and the report are made from it and the world's record.

    Times are simulated seconds since the first take-off, negative before it.
    """

    phases: tuple[PhaseMark, ...] = ()
    events: tuple[EventMark, ...] = ()
    trees: tuple[TreeMark, ...] = ()
    orders: tuple[OrderMark, ...] = ()
    heals: int = 0
    ticks: int = 0
    late_ticks: int = 0
    slots: tuple[SlotMark, ...] = ()
    standings: tuple[StandingMark, ...] = ()
    died: dict[int, float] = {}
    """Drone -> when its agent ended by itself."""

    def first(self, stage: Stage) -> OrderMark | None:
        """The first order of a stage."""
        return next((mark for mark in self.orders if mark.order.stage is stage), None)


class SurveyWatch:
    """The newest knowledge of every drone, and the log so far."""

    def __init__(self, members: Sequence[int], tick_hz: float = 10.0) -> None:
        """`tick_hz`: of the agents."""
        self.members = tuple(members)
        self.states: dict[int, DroneState] = {}
        self.outcomes: dict[tuple[str, int], CommandOutcome] = {}
        """(command, drone) -> its answer."""
        self.down_since_s: dict[int, float] = {}
        """Since when a vehicle has been on the ground and disarmed, by the world's record; absent if it is not."""
        self.first_takeoff_s: float | None = None
        """By the world's record."""
        self.order: Order | None = None
        """The newest of the swarm's root."""
        self.best_co2_ppm: float | None = None
        """The highest reading of any flying drone: what the instrument said, not what a filter made of it."""
        self.best_ned_m: Vector3 | None = None
        self.unreadable: dict[str, int] = {}
        """Messages that could not be decoded, by problem, with how often."""
        self._heard_s: dict[int, float] = {}
        self._counts: dict[tuple[int, int], tuple[int, int]] = {}
        """(drone, incarnation) -> (ticks, late ticks)."""
        self._tick_hz = tick_hz
        self._slept_s: dict[int, float] = {}
        """How long each drone's agent stood still because it was made to."""
        self._phases: list[PhaseMark] = []
        self._events: list[EventMark] = []
        self._trees: list[TreeMark] = []
        self._orders: list[OrderMark] = []
        self._slots: list[SlotMark] = []
        self._held: dict[int, tuple[int | None, bool]] = {}
        """The newest of `_slots` of each drone: (slot, moving)."""
        self._standings: list[StandingMark] = []
        self._surveys: dict[int, str] = {}
        """Drone -> the survey that it told of last."""
        self._survey: str | None = None
        """The one that most tell of: who starts late has one of its own until it has heard the others."""
        self._registers: dict[int, MemberRegister] = {}
        """Of the members, merged of all that was told of `_survey`."""
        self._died: dict[int, float] = {}
        self._assignments: set[tuple[int, tuple[tuple[int, int], ...]]] = set()
        self._heals = 0

    # -- what comes in ----------------------------------------------------------------------------------------

    def hear(self, now_s: float, topic: Topic, payload: bytes) -> None:
        """Take a message of the swarm."""
        try:
            message = topic.codec.decode(payload)
        except WireError as error:
            self.unreadable[str(error)] = self.unreadable.get(str(error), 0) + 1
            return
        match message:
            case DroneState():
                self._state(now_s, message)
            case TableState():
                self._table(now_s, message)
            case OrderState():
                self._ordered(now_s, message)
            case CommandOutcome():
                self.outcomes[message.command, message.sender] = message
            case Event():
                self.note(now_s, message.severity, message.code, message.text, message.sender)

    def see(self, now_s: float, rows: Iterable[TruthRow]) -> None:
        """Take new rows of the world's record."""
        for row in rows:
            if row.airborne or row.armed:
                self.down_since_s.pop(row.drone, None)
            else:
                self.down_since_s.setdefault(row.drone, now_s)
            if row.airborne and self.first_takeoff_s is None:
                self.first_takeoff_s = row.time_s

    def note(self, now_s: float, severity: Severity, code: str, text: str, drone: int = 0) -> None:
        """Keep an event; those of the launcher itself have the drone 0."""
        self._events.append(EventMark(now_s, drone, severity, code, text))

    def died(self, now_s: float, drone: int) -> None:
        """The drone's agent has ended by itself."""
        self._died.setdefault(drone, now_s)

    def woke(self, drone: int, slept_s: float) -> None:
        """The drone's agent goes on after it was made to stand still: what it slept through, it did not miss."""
        self._slept_s[drone] = self._slept_s.get(drone, 0.0) + slept_s

    def _state(self, now_s: float, state: DroneState) -> None:
        drone = state.sender
        before = self.states.get(drone)
        self.states[drone] = state
        self._heard_s[drone] = now_s
        self._counts[drone, state.incarnation] = (state.ticks, state.late_ticks)
        if before is None or before.phase is not state.phase:
            self._phases.append(PhaseMark(now_s, drone, state.phase))
        slot = state.slot if state.phase in TAKING_PART else None
        held = slot, slot is not None and (state.healing or state.phase in GETTING_THERE)
        if self._held.get(drone) != held:
            self._held[drone] = held
            self._slots.append(SlotMark(now_s, drone, *held))
        co2_ppm = state.co2_ppm
        if co2_ppm is None or not state.airborne or state.position_ned_m is None:
            return
        if self.best_co2_ppm is None or co2_ppm > self.best_co2_ppm:
            self.best_co2_ppm, self.best_ned_m = co2_ppm, state.position_ned_m

    def _table(self, now_s: float, table: TableState) -> None:
        if not self._is_the_swarms(table):
            return
        held = table.held
        assigned = table.epoch, tuple(sorted(held.items()))
        # One that joins or leaves holds no slot, and does not know yet, or any more, who does.
        if table.sender in held and assigned not in self._assignments:
            self._assignments.add(assigned)
            if not self._trees or self._trees[-1].slots != held:
                self._trees.append(TreeMark(now_s, held))
        self._members(now_s, table)
        self._heals = max(self._heals, table.heals)

    def _ordered(self, now_s: float, told: OrderState) -> None:
        if not self._is_the_swarms(told):
            return
        order = told.order
        if self.order is None or order.sequence > self.order.sequence:
            self.order = order
            self._orders.append(OrderMark(now_s, order))

    def _is_the_swarms(self, told: TableState | OrderState) -> bool:
        """Whether it tells of the survey that most drones tell of; of two with as many the first."""
        self._surveys[told.sender] = told.survey
        known = list(self._surveys.values())
        if told.survey != self._survey and known.count(told.survey) > sum(
            one == self._survey for one in known
        ):
            self._survey, self._registers = told.survey, {}
        return told.survey == self._survey

    def _members(self, now_s: float, table: TableState) -> None:
        """What the table's sender says of the members, on top of what all said before."""
        told = dict(table.members)
        self._registers = merge_members(self._registers, told)
        for drone in sorted(self._registers.keys() | {mark.drone for mark in self._standings}):
            register = self._registers.get(drone, MemberRegister())
            before = self._standing(drone)
            standing = WatchStanding.THERE
            if max(register.suspected, register.left) == register.life:
                is_gone = before is WatchStanding.GONE or (
                    drone in table.absent and told.get(drone) == register
                )
                standing = WatchStanding.GONE if is_gone else WatchStanding.DOUBTED
            if standing is not before:
                self._standings.append(StandingMark(now_s, drone, standing))

    def _standing(self, drone: int) -> WatchStanding:
        marks = (mark.standing for mark in reversed(self._standings) if mark.drone == drone)
        return next(marks, WatchStanding.THERE)

    # -- what is known ----------------------------------------------------------------------------------------

    def talking(self, now_s: float) -> set[int]:
        """Drones whose agents have been heard lately."""
        return {drone for drone, heard_s in self._heard_s.items() if now_s - heard_s < SILENT_S}

    def since_takeoff_s(self, now_s: float) -> float | None:
        return None if self.first_takeoff_s is None else now_s - self.first_takeoff_s

    def from_best_m(self) -> float | None:
        """Horizontal distance of the swarm (the mean of its flying drones) from its best reading so far."""
        places = [s.position_ned_m for s in self.states.values() if s.airborne and s.position_ned_m]
        if self.best_ned_m is None or not places:
            return None
        north_m = sum(p[0] for p in places) / len(places)
        east_m = sum(p[1] for p in places) / len(places)
        return math.hypot(north_m - self.best_ned_m[0], east_m - self.best_ned_m[1])

    def log(self) -> Log:
        """The log so far, its times counted from the first take-off (from the first mark if there was none)."""
        zero_s = self.first_takeoff_s
        if zero_s is None:
            firsts = [*(m.time_s for m in self._phases[:1]), *(m.time_s for m in self._events[:1])]
            zero_s = min(firsts, default=0.0)
        slept = self._slept_ticks()
        return Log(
            phases=tuple(PhaseMark(m.time_s - zero_s, m.drone, m.phase) for m in self._phases),
            events=tuple(
                EventMark(m.time_s - zero_s, m.drone, m.severity, m.code, m.text) for m in self._events
            ),
            trees=tuple(TreeMark(m.time_s - zero_s, m.slots) for m in self._trees),
            orders=tuple(OrderMark(m.time_s - zero_s, m.order) for m in self._orders),
            slots=tuple(SlotMark(m.time_s - zero_s, m.drone, m.slot, m.moving) for m in self._slots),
            standings=tuple(StandingMark(m.time_s - zero_s, m.drone, m.standing) for m in self._standings),
            died={drone: at_s - zero_s for drone, at_s in self._died.items()},
            heals=self._heals,
            ticks=sum(ticks for ticks, _ in self._counts.values()) - slept,
            late_ticks=sum(late for _, late in self._counts.values()) - slept,
        )

    def _slept_ticks(self) -> int:
        """Of the late ticks those that were slept through, and are the machine's fault no more than the agents'."""
        late: collections.Counter[int] = collections.Counter()
        for (drone, _), (_, missed) in self._counts.items():
            late[drone] += missed
        return sum(min(late[d], math.ceil(s * self._tick_hz)) for d, s in self._slept_s.items())
