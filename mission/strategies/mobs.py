"""MoBS: every drone for itself, on golden-ratio spokes, then like a moth (LoCUS paper, section IV).

The rule is a plain function of numbers and one small array: the agent calls it, the trials compile it.
"""

from __future__ import annotations

import math
from typing import Annotated, Protocol

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.estimates import Reading
from mission.geometry.formation import FloatArray, Layout
from mission.geometry.frames import Vector3
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Decision, GoTo, Hold, Observation, Order, OwnState, Stage
from mission.strategies.entry import StrategyEntry
from mission.strategies.packed import Packed, is_contact
from mission.strategies.spokes import GOLDEN, next_bearing, next_on_spokes

_ZEROS = 4
"""After more than so many moth steps with nothing before and nothing after, back to the spokes."""

# Places in the state array of one drone.
MOTH, BEARING, ALONG, HEADING, BEFORE, ZEROS, STATE_SIZE = range(7)


def mobs_begin(state: FloatArray, bearing_rad: float) -> None:
    """Make `state` (STATE_SIZE numbers) that of a drone at the centre, about to fly its first spoke."""
    for k in range(STATE_SIZE):
        state[k] = 0.0
    state[BEARING] = bearing_rad


def mobs_next(
    state: FloatArray,
    north_m: float,
    east_m: float,
    reading: float,
    radius_m: float,
    step_m: float,
    draw: float,
) -> tuple[float, float]:
    """The drone's next waypoint (north, east from the centre), given where it is and what it reads there.

    `reading` is 0 where there is no contact; `draw` is uniform in [0, 1), used where a new direction is due.
    """
    if state[MOTH] == 0.0:
        if reading > 0.0:
            state[MOTH] = 1.0
            state[HEADING] = state[BEARING]
            state[BEFORE] = 0.0
            state[ZEROS] = 0.0
        else:
            state[ALONG], state[BEARING] = next_on_spokes(state[ALONG], state[BEARING], radius_m, step_m)
    if state[MOTH] == 1.0:
        if reading == 0.0 and state[BEFORE] == 0.0:
            state[ZEROS] += 1.0
        else:
            state[ZEROS] = 0.0
        if state[ZEROS] > _ZEROS:
            state[MOTH] = 0.0
            state[ALONG] = 0.0
            state[BEARING] = next_bearing(state[BEARING])
        else:
            if reading <= state[BEFORE]:
                state[HEADING] = 2.0 * math.pi * draw
            state[BEFORE] = reading
            return north_m + step_m * math.cos(state[HEADING]), east_m + step_m * math.sin(state[HEADING])
    return state[ALONG] * math.cos(state[BEARING]), state[ALONG] * math.sin(state[BEARING])


class MobsParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    start_ned_m: Vector3 | None = None
    """Centre of the spokes; None: where the formation formed up."""
    radius_m: Annotated[float, Meta(gt=0.0)] = 100.0
    """Length of a spoke (paper: the arena's radius)."""
    step_m: Annotated[float, Meta(gt=0.0)] = 1.0
    """Distance between waypoints (paper: 1 m)."""
    arrival_m: Annotated[float, Meta(gt=0.0)] = 0.5
    settle_mps: Annotated[float, Meta(gt=0.0)] = 1.0
    settle_s: Annotated[float, Meta(ge=0.0)] = 0.3
    blocked_s: Annotated[float, Meta(gt=0.0)] = 5.0
    """A drone that stands still this long away from its waypoint decides there."""
    detection_ppm: Annotated[float, Meta(gt=0.0)] = 20.0
    detection_sigmas: Annotated[float, Meta(ge=0.0)] = 4.0
    improvement_fraction: Annotated[float, Meta(ge=0.0)] = 0.02
    """A better reading exceeds the best by this fraction and one standard deviation."""
    patience_s: Annotated[float, Meta(gt=0.0)] = 180.0
    """The source counts as found where the best reading was taken, once nobody has beaten it for so long."""
    search_limit_s: Annotated[float, Meta(gt=0.0)] = 1200.0
    """The search is given up so long after the drones began to form up."""


def waypoint_arrival(p: MobsParameters) -> Arrival:
    """Watches a drone's flights from waypoint to waypoint."""
    return Arrival(arrival_m=p.arrival_m, settle_mps=p.settle_mps, settle_s=p.settle_s, blocked_s=p.blocked_s)


class SpokeFlight(Protocol):
    """How one drone flies on its spokes, and like a moth."""

    arrived: bool
    """Whether the newest step ended at a place where a reading is taken."""

    def __init__(self, centre_ned_m: Vector3, bearing_rad: float, p: MobsParameters) -> None: ...

    def step(self, elapsed_s: float, own: OwnState, reading: float, rng: np.random.Generator) -> Vector3: ...


class MobsFlight:
    """One drone's way by the rule, waypoint after waypoint."""

    def __init__(self, centre_ned_m: Vector3, bearing_rad: float, p: MobsParameters) -> None:
        self._centre = centre_ned_m
        self._p = p
        self._arrival = waypoint_arrival(p)
        self._state = np.zeros(STATE_SIZE)
        mobs_begin(self._state, bearing_rad)
        self._target = centre_ned_m
        self.arrived = False
        """Whether the drone arrived at a waypoint in the newest step."""

    def step(self, elapsed_s: float, own: OwnState, reading: float, rng: np.random.Generator) -> Vector3:
        """The waypoint to fly to. `reading` is what is read now, 0 without contact."""
        self.arrived = self._arrival.step(elapsed_s, own.position_ned_m, own.velocity_ned_mps, self._target)
        if self.arrived:
            north_m, east_m = mobs_next(
                self._state,
                own.position_ned_m[0] - self._centre[0],
                own.position_ned_m[1] - self._centre[1],
                reading,
                self._p.radius_m,
                self._p.step_m,
                float(rng.random()),
            )
            self._target = (
                self._centre[0] + float(north_m),
                self._centre[1] + float(east_m),
                self._centre[2],
            )
        return self._target


def contact_of(own: OwnState, detection_ppm: float, detection_sigmas: float) -> Reading | None:
    """The reading that a drone takes where it is, None where that is no contact."""
    co2 = own.excess_co2_ppm
    if co2 is None or not co2.mean > max(detection_ppm, detection_sigmas * math.sqrt(max(co2.variance, 0.0))):
        return None
    return Reading(own.drone, 0, own.position_ned_m, co2.mean, co2.variance)


def first_bearing_rad(drone: int, rng: np.random.Generator) -> float:
    """Where a drone's first spoke leads. Its number sets the spokes of drones apart that share a seed."""
    return 2.0 * math.pi * ((rng.random() + drone / GOLDEN) % 1.0)


class MobsWord(msgspec.Struct, frozen=True, array_like=True, tag="mobs"):
    best: Reading
    """The strongest reading that the drone has taken at its waypoints."""

    def __post_init__(self) -> None:
        if not is_contact(self.best):
            raise ValueError("the reading in the word is none")


_WORD = Packed(MobsWord)


class Mobs:
    """One independent drone. Nobody steers another; but a survey has an end, and the tree's root gives it.

    Every drone tells the others its best reading. Once none has been beaten for `patience_s`, the source counts as
    found where the best of them was taken: no plume is fitted to a moth's few readings, so that this is as near as
    the moth came. The paper stops by knowing the answer.
    """

    Parameters = MobsParameters
    Flight: type[SpokeFlight] = MobsFlight

    def __init__(self, layout: Layout, parameters: MobsParameters | None = None) -> None:
        del layout  # independent drones hold no formation once they have formed up
        self._p = parameters or MobsParameters()
        self._flight: SpokeFlight | None = None
        self._best: Reading | None = None
        """This drone's own."""
        self._to_beat: Reading | None = None
        """The swarm's, as the root knows it."""
        self._to_beat_since_s = 0.0

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        own = observation.own
        if self._flight is None:
            if self._p.start_ned_m is None and observation.order is None:
                return Decision(Hold())
            anchor = observation.order.anchor_ned_m if observation.order else own.position_ned_m
            start = self._p.start_ned_m or anchor
            self._flight = self.Flight(start, first_bearing_rad(own.drone, rng), self._p)
        contact = contact_of(own, self._p.detection_ppm, self._p.detection_sigmas)
        reading = contact.excess_co2_ppm if contact is not None else 0.0
        target = self._flight.step(observation.elapsed_s, own, reading, rng)
        if self._flight.arrived and contact is not None and self._beats(contact, self._best):
            self._best = contact
        order = self._order(observation) if observation.tree.root == own.drone else None
        return Decision(
            GoTo(target), order=order, word=_WORD.pack(MobsWord(self._best)) if self._best else b""
        )

    def _order(self, observation: Observation) -> Order | None:
        """At the root: the search's beginning, that somebody has contact, and its end."""
        order = observation.order
        if order is None:
            return None
        if not order.apart:
            return msgspec.structs.replace(order, sequence=order.sequence + 1, stage=Stage.SEARCH, apart=True)
        words = [_WORD.unpack(neighbour.word) for neighbour in observation.neighbours]
        told = [word.best for word in words if word is not None]
        for reading in (*told, *([self._best] if self._best else [])):
            if self._beats(reading, self._to_beat):
                self._to_beat, self._to_beat_since_s = reading, observation.elapsed_s
        if self._to_beat and observation.elapsed_s - self._to_beat_since_s >= self._p.patience_s:
            source = self._to_beat.position_ned_m
            return msgspec.structs.replace(
                order,
                sequence=order.sequence + 1,
                stage=Stage.FOUND,
                anchor_ned_m=source,
                source_ned_m=source,
            )
        if observation.elapsed_s > self._p.search_limit_s:
            return msgspec.structs.replace(order, sequence=order.sequence + 1, stage=Stage.GIVE_UP)
        if self._to_beat and order.stage is Stage.SEARCH:
            return msgspec.structs.replace(order, sequence=order.sequence + 1, stage=Stage.TRACK)
        return None

    def _beats(self, reading: Reading, best: Reading | None) -> bool:
        if best is None:
            return True
        beat_ppm = best.excess_co2_ppm * (1.0 + self._p.improvement_fraction)
        return reading.excess_co2_ppm > beat_ppm + math.sqrt(reading.variance_ppm2 + best.variance_ppm2)


ENTRY = StrategyEntry(
    name="mobs", make=Mobs, parameters=MobsParameters, rules=(mobs_next,), word=MobsWord, legs=True
)
