"""What one drone tells the others of itself, and when: at the rates of the table of topics."""

from __future__ import annotations

from collections.abc import Sequence

from flightstack.autopilot import VehicleReport
from flightstack.flight.phase import Note
from flightstack.sensing.filter_stage import Sensed
from flightstack.swarm.topics import Topic
from flightstack.swarm.wire import DroneState, Event, Phase
from mission.strategies.contract import TreePlace


class Announcements:
    """Counts what was told. It sends nothing."""

    def __init__(self, drone: int, incarnation: int, frame_identity: int, tick_s: float) -> None:
        self.incarnation = incarnation
        self._drone = drone
        self._frame_identity = frame_identity
        self._tick_s = tick_s
        self._states = 0
        self._events = 0
        self._sent_s: dict[str, float] = {}

    def due(self, now_s: float, topic: Topic) -> bool:
        """Whether `topic` is to be sent in this tick; if so, it counts as sent."""
        period_s = 1.0 / topic.rate_hz if topic.rate_hz else 0.0
        last_s = self._sent_s.get(topic.name)
        if last_s is not None and now_s - last_s < period_s - 0.5 * self._tick_s:
            return False
        self._sent_s[topic.name] = now_s
        return True

    def events(self, notes: Sequence[Note]) -> tuple[Event, ...]:
        first = self._events + 1
        self._events += len(notes)
        return tuple(
            Event(self._drone, number, note.severity, note.code, note.text)
            for number, note in enumerate(notes, first)
        )

    def state(
        self,
        *,
        phase: Phase,
        vehicle: VehicleReport,
        sensed: Sensed,
        place: TreePlace,
        moving: bool,
        best_ppm: float | None,
        held_by: tuple[str, ...],
        ticks: int,
        late_ticks: int,
        word: bytes,
    ) -> DroneState:
        self._states += 1
        waiting = vehicle.ready_reason if not vehicle.armed else ""
        return DroneState(
            self._drone,
            self.incarnation,
            self._states,
            self._frame_identity,
            phase,
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
            moving,
            best_ppm,
            (
                *((f"autopilot: {waiting}",) if waiting else ()),
                *vehicle.notes,
                *sensed.notes,
                *(f"guard: {text}" for text in held_by),
            ),
            ticks,
            late_ticks,
            vehicle.position_age_s or 0.0,
            word,
        )
