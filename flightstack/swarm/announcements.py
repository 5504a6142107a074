"""What one drone tells the others of itself, and when: at the rates of the table of topics."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from flightstack.autopilot import TakenBy, VehicleReport
from flightstack.sensing.filter_stage import Sensed
from flightstack.swarm.news import Note
from flightstack.swarm.topics import EVENT, OUTCOME, STATE, TREE, Topic
from flightstack.swarm.tree_protocol import SwarmTree
from flightstack.swarm.wire import CommandOutcome, DroneState, Event, Phase
from mission.strategies.contract import TreePlace


class OwnFacts(msgspec.Struct, frozen=True):
    """What there is to tell of this drone in one tick."""

    phase: Phase
    vehicle: VehicleReport
    sensed: Sensed
    place: TreePlace
    moving: bool
    """On its way to a slot that a heal gave it."""
    best_ppm: float | None
    """Largest filtered excess that it has measured in this survey."""
    held_by: tuple[str, ...]
    """What held the guard back in this tick."""
    ticks: int
    late_ticks: int
    word: bytes
    """What its strategy tells the neighbours' strategies."""
    crash: str = ""
    """How and where it crashed; empty if it did not."""
    astray: str = ""
    """How it does not go where it is sent; empty while it does."""
    storage: str = ""
    """Why its flight is not recorded."""


class Announced(msgspec.Struct, frozen=True):
    messages: tuple[tuple[str, bytes], ...]
    """(topic name, payload)."""
    events: tuple[Event, ...]
    """The events among `messages`, decoded, for the log."""


class Announcements:
    """Counts what was told. It sends nothing."""

    def __init__(self, drone: int, incarnation: int, frame_identity: int, tick_s: float) -> None:
        self._incarnation = incarnation
        self._drone = drone
        self._frame_identity = frame_identity
        self._tick_s = tick_s
        self._states = 0
        self._trees = 0
        self._events = 0
        self._sent_s: dict[str, float] = {}

    def step(
        self,
        now_s: float,
        notes: Sequence[Note],
        outcomes: Sequence[CommandOutcome],
        own: OwnFacts,
        tree: SwarmTree,
    ) -> Announced:
        """What is told in this tick: events and answers at once, state and tree when they are due. A drone that has
        not been started yet has no tree to tell."""
        events = self._numbered(notes)
        messages = [(EVENT.name, EVENT.codec.encode(event)) for event in events]
        messages += [(OUTCOME.name, OUTCOME.codec.encode(outcome)) for outcome in outcomes]
        if self._due(now_s, STATE):
            messages.append((STATE.name, STATE.codec.encode(self._state(own))))
        if tree.survey is not None and self._due(now_s, TREE):
            self._trees += 1
            told = msgspec.structs.replace(tree.message(), sequence=self._trees)
            messages.append((TREE.name, TREE.codec.encode(told)))
        return Announced(tuple(messages), events)

    def _due(self, now_s: float, topic: Topic) -> bool:
        """Whether `topic` is to be sent in this tick; if so, it counts as sent."""
        period_s = 1.0 / topic.rate_hz if topic.rate_hz else 0.0
        last_s = self._sent_s.get(topic.name)
        if last_s is not None and now_s - last_s < period_s - 0.5 * self._tick_s:
            return False
        self._sent_s[topic.name] = now_s
        return True

    def _numbered(self, notes: Sequence[Note]) -> tuple[Event, ...]:
        first = self._events + 1
        self._events += len(notes)
        return tuple(
            Event(self._drone, number, note.severity, note.code, note.text, self._incarnation)
            for number, note in enumerate(notes, first)
        )

    def _state(self, own: OwnFacts) -> DroneState:
        self._states += 1
        vehicle, sensed, place = own.vehicle, own.sensed, own.place
        waiting = vehicle.ready_reason if not vehicle.armed else ""
        failsafe = vehicle.armed and vehicle.taken_by is TakenBy.AUTOPILOT
        return DroneState(
            self._drone,
            self._incarnation,
            self._states,
            self._frame_identity,
            own.phase,
            vehicle.position_ned_m,
            vehicle.velocity_ned_mps,
            vehicle.heading_rad,
            vehicle.home_ned_m,
            vehicle.armed,
            vehicle.airborne,
            vehicle.mode,
            vehicle.battery_fraction,
            sensed.co2_ppm,
            sensed.excess_co2_ppm,
            sensed.wind,
            place.epoch,
            place.slot if place.slot >= 0 else None,
            place.parent,
            own.moving,
            own.best_ppm,
            (
                *((f"autopilot: {waiting}",) if waiting else ()),
                *((f"failsafe of the autopilot: {vehicle.taken_reason}",) if failsafe else ()),
                *vehicle.notes,
                *sensed.notes,
                *(f"guard: {text}" for text in own.held_by),
            ),
            own.ticks,
            own.late_ticks,
            vehicle.position_age_s or 0.0,
            own.word,
            own.crash,
            own.astray,
            own.storage,
        )
