"""What one drone tells the others, and when: its state at its rate, table and order where others know
another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from flightstack.autopilot import TakenBy, VehicleReport
from flightstack.sensing.filter_stage import Sensed
from flightstack.swarm.exchange import Exchange, OrderExchange
from flightstack.swarm.news import Note
from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.swarm_table import SwarmTable
from flightstack.swarm.topics import EVENT, ORDER, OUTCOME, READINGS, STATE, TABLE
from flightstack.swarm.wire import NO_ORDER, NO_TABLE, CommandOutcome, DroneState, Event, Phase
from mission.strategies.contract import TreePlace


class OwnFacts(msgspec.Struct, frozen=True):
    """What there is to tell of this drone in one tick."""

    phase: Phase
    vehicle: VehicleReport
    sensed: Sensed
    place: TreePlace
    moving: bool
    """On its way to a slot in a formation that is on its way: as an heir, or because it joins."""
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
        self._tables = Exchange(tick_s)
        self._orders = OrderExchange(tick_s)
        self._states = 0
        self._events = 0
        self._state_s: float | None = None
        """When the newest state was told."""

    def step(
        self,
        now_s: float,
        notes: Sequence[Note],
        outcomes: Sequence[CommandOutcome],
        own: OwnFacts,
        table: SwarmTable,
        peers: Mapping[int, PeerFacts],
    ) -> Announced:
        """What is told in this tick: events and answers at once, the rest when it is due. A drone that has not been
        started yet has no table to tell."""
        events = self._numbered(notes)
        messages = [(EVENT.name, EVENT.codec.encode(event)) for event in events]
        messages += [(OUTCOME.name, OUTCOME.codec.encode(outcome)) for outcome in outcomes]
        digest = table.digest if table.survey is not None else NO_TABLE
        if self._is_state_due(now_s):
            messages.append((STATE.name, STATE.codec.encode(self._state(own, digest, table.order_digest))))
        if digest != NO_TABLE and self._tables.is_due(now_s, digest, peers, table.slots):
            messages.append((TABLE.name, TABLE.codec.encode(table.message())))
        ordered = table.order_digest
        if ordered != NO_ORDER and self._orders.is_due(now_s, ordered, peers):
            messages.append((ORDER.name, ORDER.codec.encode(table.order_message())))
        readings = table.readings_message(now_s, self._tick_s)
        if readings is not None:
            messages.append((READINGS.name, READINGS.codec.encode(readings)))
        return Announced(tuple(messages), events)

    def _is_state_due(self, now_s: float) -> bool:
        """Whether the state is to be told in this tick; if so, it counts as told."""
        period_s = 1.0 / STATE.rate_hz if STATE.rate_hz else 0.0
        if self._state_s is not None and now_s - self._state_s < period_s - 0.5 * self._tick_s:
            return False
        self._state_s = now_s
        return True

    def _numbered(self, notes: Sequence[Note]) -> tuple[Event, ...]:
        first = self._events + 1
        self._events += len(notes)
        return tuple(
            Event(self._drone, number, note.severity, note.code, note.text, self._incarnation)
            for number, note in enumerate(notes, first)
        )

    def _state(self, own: OwnFacts, digest: int, order_digest: int) -> DroneState:
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
            digest,
            order_digest,
        )
