"""Flying a lattice: the root orders its centre and radius, the others keep their places on the ring.

The paper's lattice searches with a ring of 0.5 to 3.75 m and waypoints 1 m apart. The defaults are for drones: all
lengths times 16, so that the least spacing is 8 m, but for the greatest radius, which is three times the least. The
paper stops by knowing the answer; here the source counts as found once the best reading has not been beaten during
`patience` waypoints, and its place is estimated from the readings.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.estimates import Reading
from mission.estimation.source import estimate_source
from mission.geometry.formation import FloatArray, Layout
from mission.geometry.frames import Vector3
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Decision, GoTo, Hold, Observation, Order, OwnState, Stage
from mission.strategies.entry import StrategyEntry
from mission.strategies.lattice import lattice_rule as rule
from mission.strategies.lattice.lattice_note import LatticeNote, lattice_note, with_lattice_note
from mission.strategies.mobs import contact_of
from mission.strategies.packed import FARTHEST_M, is_contact

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]

_WIND_STALE_S = 15.0
_STORM_MPS = 100.0
"""Nobody flies in a wind above this: who tells of one is not believed."""
_CALM_MPS = 0.5
"""A wind below this has no direction that a plume could be fitted along."""
_MEMORY = 400
"""How many readings a drone remembers for the estimate of the source."""


class LatticeParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    start_ned_m: Vector3 | None = None
    """Middle of the area that is searched; None: where the formation formed up."""
    least_radius_m: Positive = 8.0
    """Of the ring; of six it is their spacing too (paper: 0.5 m)."""
    most_radius_m: Positive = 24.0
    """Paper: up to 3.75 m."""
    widen_m: Positive = 4.0
    """By how much the radius changes at a waypoint where it is not sensed on purpose (paper: 0.25 m)."""
    step_m: Positive = 16.0
    """Between waypoints (paper: 1 m)."""
    flux_ppm_m2ps: NotNegative = 50.0
    """A flux through an edge of the ring below this is none."""
    arrival_m: Positive = 1.0
    settle_mps: Positive = 0.7
    settle_s: NotNegative = 1.0
    blocked_s: Positive = 5.0
    """A drone that stands still this long away from its point takes its reading there."""
    waypoint_timeout_s: Positive = 20.0
    """How long the root waits for the others' readings after its own arrival."""
    forming_timeout_s: Positive = 90.0
    detection_ppm: Positive = 20.0
    """Excess below this is no contact."""
    detection_sigmas: NotNegative = 4.0
    """Nor is excess below this many standard deviations of its own estimate."""
    patience: Annotated[int, Meta(ge=1)] = 32
    """Waypoints without a better reading after which the source counts as found."""
    improvement_fraction: NotNegative = 0.02
    """A better reading exceeds the best by this fraction and one standard deviation."""
    search_radius_m: Positive = 200.0
    """Half the side of the square, to the north and east, that the lattice stays in."""
    search_limit_s: Positive = 1200.0
    """The search is given up so long after the drones began to form up."""

    def __post_init__(self) -> None:
        if self.least_radius_m > self.most_radius_m:
            raise ValueError(
                f"least_radius_m ({self.least_radius_m:g}) is above most_radius_m ({self.most_radius_m:g})"
            )


class Lattice:
    """One drone's part in a lattice that traces as its class says."""

    tracer: ClassVar[int]

    def __init__(self, layout: Layout, parameters: LatticeParameters | None = None) -> None:
        self._p = parameters or LatticeParameters()
        north_m, east_m = layout.offset_m(1)
        self._first_rad = math.atan2(east_m, north_m)
        """Bearing of the ring's first place: as the formation has it, so that nobody crosses another's way."""
        self._arrival = Arrival(
            arrival_m=self._p.arrival_m,
            settle_mps=self._p.settle_mps,
            settle_s=self._p.settle_s,
            blocked_s=self._p.blocked_s,
        )
        self._reading: Reading | None = None
        self._given: Order | None = None
        self._window: dict[tuple[int, int], Reading] = {}
        """Readings by (order, drone), oldest first."""

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        tree, own = observation.tree, observation.own
        for heard in observation.readings:
            self._remember(heard)
        is_root = tree.root == own.drone
        if tree.healing:
            self._arrival.interrupt()
            return Decision(Hold())
        order = observation.order
        if is_root and self._given and order and order.sequence < self._given.sequence:
            order = self._given
        if is_root and (order is None or lattice_note(order) is None) and not _ended(order):
            order = self._first_order(observation, order, rng)
        if order is None:
            return Decision(Hold())
        target = self._target(order, observation)
        if self._arrival.step(observation.elapsed_s, own.position_ned_m, own.velocity_ned_mps, target):
            self._take_reading(own, order)
        reading = self._reading if self._reading and self._reading.order == order.sequence else None
        if is_root and not _ended(order):
            if observation.elapsed_s > self._p.search_limit_s:
                order = msgspec.structs.replace(order, sequence=order.sequence + 1, stage=Stage.GIVE_UP)
            elif reading is not None:
                self._remember(reading)
                order = self._next_if_due(observation, order, rng)
        if is_root and order is not observation.order:
            self._given = order
            return Decision(GoTo(self._target(order, observation)), reading, order)
        return Decision(GoTo(target), reading)

    # -- every drone ------------------------------------------------------------------------------------------

    def _target(self, order: Order, observation: Observation) -> Vector3:
        """The centre for the root, a place on the ring for the others, evenly spaced in the order of their slots."""
        north_m, east_m, down_m = order.anchor_ned_m
        note = lattice_note(order)
        places = sorted(observation.tree.slots, key=observation.tree.slots.__getitem__)
        drone = observation.own.drone
        if note is None or drone == observation.tree.root or drone not in places:
            return order.anchor_ned_m
        ring = [other for other in places if other != observation.tree.root]
        bearing_rad = self._first_rad + 2.0 * math.pi * ring.index(drone) / len(ring)
        radius_m = note.state[rule.RADIUS_M]
        return north_m + radius_m * math.cos(bearing_rad), east_m + radius_m * math.sin(bearing_rad), down_m

    def _take_reading(self, own: OwnState, order: Order) -> None:
        """The reading for `order`, taken once: 0 without contact, of infinite variance without a measurement."""
        if self._reading is not None and self._reading.order == order.sequence:
            return
        contact = contact_of(own, self._p.detection_ppm, self._p.detection_sigmas)
        if contact is not None:
            self._reading = msgspec.structs.replace(contact, order=order.sequence)
            return
        co2 = own.excess_co2_ppm
        measured = co2 is not None and math.isfinite(co2.mean) and math.isfinite(co2.variance)
        variance = co2.variance if co2 is not None and measured else math.inf
        self._reading = Reading(own.drone, order.sequence, own.position_ned_m, 0.0, variance)

    def _remember(self, reading: Reading) -> None:
        """Only what can be: a broken or hostile member must not lead the lattice astray."""
        if not all(abs(axis) <= FARTHEST_M for axis in reading.position_ned_m):
            return
        if not is_contact(reading):
            valid = reading.excess_co2_ppm == 0.0 and reading.variance_ppm2 >= 0.0
            variance = reading.variance_ppm2 if valid else math.inf
            reading = msgspec.structs.replace(reading, excess_co2_ppm=0.0, variance_ppm2=variance)
        self._window[reading.order, reading.drone] = reading
        while len(self._window) > _MEMORY:
            del self._window[next(iter(self._window))]

    # -- the root ---------------------------------------------------------------------------------------------

    def _first_order(self, observation: Observation, order: Order | None, rng: np.random.Generator) -> Order:
        """Form up as a lattice of the least radius, where the formation is."""
        anchor = order.anchor_ned_m if order is not None else observation.own.position_ned_m
        start = self._p.start_ned_m or anchor
        state = np.zeros(rule.LATTICE_STATE)
        rule.lattice_begin(
            state, self._numbers(start), start[0], start[1], self._p.least_radius_m, float(rng.random())
        )
        first = Order(
            order.sequence + 1 if order is not None else 0,
            Stage.SEARCH,
            (float(state[rule.CENTRE_N]), float(state[rule.CENTRE_E]), start[2]),
            0.0,
            apart=True,
        )
        return with_lattice_note(first, LatticeNote(start, tuple(state.tolist())))

    def _numbers(self, start: Vector3) -> FloatArray:
        p = self._p
        numbers = np.zeros(rule.LATTICE_NUMBERS)
        numbers[rule.TRACER] = self.tracer
        numbers[rule.LEAST_M], numbers[rule.MOST_M] = p.least_radius_m, p.most_radius_m
        numbers[rule.WIDEN_M], numbers[rule.STEP_M] = p.widen_m, p.step_m
        numbers[rule.DETECTION] = 0.0  # what is no contact is read as 0
        numbers[rule.FLUX] = p.flux_ppm_m2ps
        numbers[rule.LOW_N], numbers[rule.HIGH_N] = start[0] - p.search_radius_m, start[0] + p.search_radius_m
        numbers[rule.LOW_E], numbers[rule.HIGH_E] = start[1] - p.search_radius_m, start[1] + p.search_radius_m
        return numbers

    def _next_if_due(self, observation: Observation, order: Order, rng: np.random.Generator) -> Order:
        """The next order once the readings of all live members are in or the time for them is over."""
        note = lattice_note(order)
        if note is None:
            return order
        reported = {drone for sequence, drone in self._window if sequence == order.sequence}
        first = len({sequence for sequence, _ in self._window}) <= 1
        patience_s = self._p.forming_timeout_s if first else self._p.waypoint_timeout_s
        waited_s = observation.elapsed_s - self._arrival.arrived_s
        if not reported.issuperset(observation.tree.slots) and waited_s < patience_s:
            return order
        readings, winds = self._sensed(observation, order)
        best, since = note.best, note.waypoints_since_best + 1
        for reading in readings:
            if reading.excess_co2_ppm > 0.0 and self._beats(reading, best):
                best, since = reading, 0
        order = msgspec.structs.replace(order, sequence=order.sequence + 1)
        wind = tuple(np.mean(winds, axis=0).tolist())
        blowing = math.hypot(*wind) >= _CALM_MPS
        # Without a wind those that go by it only cast: their best reading is where they happened to be.
        has_climbed = blowing or self.tracer not in _BY_WIND
        if best is not None and since >= self._p.patience and has_climbed:
            known = [one for one in self._window.values() if math.isfinite(one.variance_ppm2)]
            known += [] if best in known else [best]
            source = estimate_source(known, self._p.least_radius_m, (*wind, 0.0) if blowing else None)
            return msgspec.structs.replace(order, stage=Stage.FOUND, anchor_ned_m=source, source_ned_m=source)
        state = note.rule_state()
        rule.lattice_next(
            state,
            self._numbers(note.start_ned_m),
            np.array([reading.position_ned_m[0] for reading in readings]),
            np.array([reading.position_ned_m[1] for reading in readings]),
            np.array([reading.excess_co2_ppm for reading in readings]),
            winds[:, 0],
            winds[:, 1],
            len(readings),
            float(rng.random()),
        )
        contact = any(reading.excess_co2_ppm > 0.0 for reading in readings)
        return with_lattice_note(
            msgspec.structs.replace(
                order,
                stage=Stage.TRACK if contact else Stage.SEARCH,
                anchor_ned_m=(
                    float(state[rule.CENTRE_N]),
                    float(state[rule.CENTRE_E]),
                    order.anchor_ned_m[2],
                ),
            ),
            LatticeNote(note.start_ned_m, tuple(state.tolist()), best, since),
        )

    def _sensed(self, observation: Observation, order: Order) -> tuple[list[Reading], FloatArray]:
        """What everybody who has reported read, the root first, then in the ring's order; (n, 2) winds there.

        A wind that nobody told is the mean of those that are known, 0 where none is.
        """
        tree = observation.tree
        told = {neighbour.drone: neighbour.wind for neighbour in observation.neighbours}
        told[observation.own.drone] = observation.own.wind
        ring = sorted((drone for drone in tree.slots if drone != tree.root), key=tree.slots.__getitem__)
        keys = [(order.sequence, drone) for drone in (tree.root, *ring)]
        readings = [self._window[key] for key in keys if key in self._window]
        winds = np.full((len(readings), 2), np.nan)
        for row, reading in zip(winds, readings, strict=True):
            wind = told.get(reading.drone)
            if (
                wind is not None
                and wind.age_s < _WIND_STALE_S
                and math.hypot(*wind.wind_ned_mps) < _STORM_MPS
            ):
                row[:] = wind.wind_ned_mps[:2]
        known = np.isfinite(winds).all(axis=1)
        winds[~known] = winds[known].mean(axis=0) if known.any() else 0.0
        return readings, winds

    def _beats(self, reading: Reading, best: Reading | None) -> bool:
        if best is None:
            return True
        beat_ppm = best.excess_co2_ppm * (1.0 + self._p.improvement_fraction)
        return reading.excess_co2_ppm > beat_ppm + math.sqrt(reading.variance_ppm2 + best.variance_ppm2)


_BY_WIND = (rule.ANEMOTAXIS, rule.FLUXOTAXIS)


def _ended(order: Order | None) -> bool:
    return order is not None and order.stage.ends_survey


class LatticeCasting(Lattice):
    tracer = rule.CAST


class LatticeChemotaxis(Lattice):
    tracer = rule.CHEMOTAXIS


class LatticeAnemotaxis(Lattice):
    tracer = rule.ANEMOTAXIS


class LatticeFluxotaxis(Lattice):
    tracer = rule.FLUXOTAXIS


def _entry(name: str, kind: type[Lattice]) -> StrategyEntry:
    return StrategyEntry(
        name=name, make=kind, parameters=LatticeParameters, rules=(rule.lattice_next,), note=LatticeNote
    )


ENTRIES = (
    _entry("lattice-casting", LatticeCasting),
    _entry("lattice-chemotaxis", LatticeChemotaxis),
    _entry("lattice-anemotaxis", LatticeAnemotaxis),
    _entry("lattice-fluxotaxis", LatticeFluxotaxis),
)
