"""LoCUS: the formation searches as one body, and climbs the gas gradient that all its members measure together.

Source: "LoCUS: A Multi-Robot Loss-Tolerant Algorithm for Surveying Volcanic Plumes", section V-A. The root gives
a waypoint; every drone flies to it plus its slot's offset and takes a reading; when all readings are in, the
root decides the next waypoint: up the gradient where there is one, else along Archimedes' spiral.

What departs from the paper, and why:

* Readings are of real sensors: below `detection_ppm` or within `detection_sigmas` of their own noise they count
  as 0 (the paper's 0.005 cut), and a drone without a valid sensor reports a reading of infinite variance, so
  that it neither blocks the swarm nor enters the fit.
* A drone that is held back, or silent, does not stop the swarm (`Arrival`, `waypoint_timeout_s`).
* Spiral points far out stand closer than the paper's 12 degrees, so that no ground is left unread.
* When contact is lost the swarm first returns to its best reading, and only if nothing is there goes on with the
  spiral: plumes move, and the paper's spiral would throw the contact away.
* Where the wind is known a step goes partly against it (`upwind_weight`): the paper's plane through the readings
  finds a plume's ridge but hardly climbs along it.
* The paper stops by knowing the answer (within 1 m of the maximum). Here the root declares the source found when
  the best reading has not been beaten during `patience` waypoints, and estimates its place from the readings.
* All that a new root needs to go on is in the order and its `LocusNote`.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.source import estimate_source
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Decision, GoTo, Hold, Observation, Order, Reading, Stage
from mission.strategies.locus.gradient import plane_gradient, waypoint_uphill
from mission.strategies.locus.note import LocusNote, note_of, noted
from mission.strategies.locus.spiral import arm_spacing_m, spiral_index, spiral_point

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]

_SAME_PLACE_M = 0.5
"""An anchor this near to a point is at that point."""
_SAME_INDEX = 1e-6
"""Rounding of a spiral point's number that was found again from its radius."""
_CALM_MPS = 0.5
"""A wind below this has no direction worth following."""
_WIND_STALE_S = 15.0
_MEMORY = 400
"""How many readings a drone remembers for the estimate of the source."""


class LocusParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    start_ned_m: Vector3 | None = None
    """Centre of the spiral; None: where the formation formed up."""
    step_m: Positive = 2.0
    """Step up the gradient (paper: 2 m)."""
    upwind_weight: NotNegative = 1.0
    """How much of a step goes against the wind, the unit gradient counting 1 (paper: 0). On the ridge of a long
    plume the gradient points across it; the source lies upwind. Past the source the gradient turns back."""
    jitter_m: NotNegative = 0.1
    """Largest random offset of a step per axis (paper: 0.1 m)."""
    turn_rad: NotNegative = math.pi / 4.0
    """Largest random turn of the formation at a step (paper: 45 degrees)."""
    arrival_m: Positive = 1.0
    settle_mps: Positive = 0.7
    settle_s: NotNegative = 1.0
    """How long a drone stays within `arrival_m` and below `settle_mps` before it takes its reading."""
    blocked_s: Positive = 5.0
    """A drone that stands still this long away from its point takes its reading there."""
    waypoint_timeout_s: Positive = 20.0
    """How long the root waits for the others' readings after its own arrival."""
    forming_timeout_s: Positive = 90.0
    """The same while the swarm forms up, when drones may still be climbing."""
    detection_ppm: Positive = 20.0
    """Excess below this is no contact."""
    detection_sigmas: NotNegative = 4.0
    """Nor is excess below this many standard deviations of its own estimate."""
    patience: Annotated[int, Meta(ge=1)] = 16
    """Waypoints without a better reading after which the source counts as found."""
    improvement_fraction: NotNegative = 0.02
    """A better reading exceeds the best by this fraction and one standard deviation."""
    search_radius_m: Positive = 200.0
    """The search is given up when the spiral leaves this radius."""


class Locus:
    """One drone's part in a LoCUS swarm; see the module's text."""

    Parameters = LocusParameters

    def __init__(self, layout: Layout, parameters: LocusParameters | None = None) -> None:
        self._layout = layout
        self._p = parameters or LocusParameters()
        self._arrival = Arrival(
            arrival_m=self._p.arrival_m,
            settle_mps=self._p.settle_mps,
            settle_s=self._p.settle_s,
            blocked_s=self._p.blocked_s,
        )
        self._reading: Reading | None = None
        self._given: Order | None = None
        self._wind_ned_mps: Vector3 | None = None
        """The swarm's mean wind, None while nobody knows it."""
        self._window: dict[tuple[int, int], Reading] = {}
        """Readings by (order, drone), oldest first."""

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        for heard in observation.readings:
            self._remember(heard)
        tree, own = observation.tree, observation.own
        is_root = tree.root == own.drone
        if tree.healing:
            self._arrival.interrupt()
            return Decision(Hold())
        order = observation.order
        if is_root and self._given and order and order.sequence < self._given.sequence:
            order = self._given
        if order is None:
            if not is_root:
                return Decision(Hold())
            order = Order(0, Stage.FORM, self._p.start_ned_m or own.position_ned_m, 0.0)
        target = self._target(order, tree.slot)
        if self._arrival.step(observation.elapsed_s, own.position_ned_m, own.velocity_ned_mps, target):
            self._take_reading(observation, order)
        reading = self._reading if self._reading and self._reading.order == order.sequence else None
        if is_root and reading is not None and order.stage not in (Stage.FOUND, Stage.GIVE_UP):
            self._remember(reading)
            self._wind_ned_mps = _mean_wind(observation)
            order = self._next_if_due(observation, order, rng)
        if is_root and order is not observation.order:
            self._given = order
            return Decision(GoTo(self._target(order, tree.slot)), reading, order)
        return Decision(GoTo(target), reading)

    # -- every drone ------------------------------------------------------------------------------------------

    def _target(self, order: Order, slot: int) -> Vector3:
        north_m, east_m = rotated(self._layout.offset_m(slot), order.rotation_rad)
        anchor_n, anchor_e, anchor_d = order.anchor_ned_m
        return anchor_n + north_m, anchor_e + east_m, anchor_d

    def _take_reading(self, observation: Observation, order: Order) -> None:
        """The reading for `order`, taken once; infinite variance says that there is no valid measurement."""
        if self._reading is not None and self._reading.order == order.sequence:
            return
        own = observation.own
        co2 = own.excess_co2_ppm
        valid = co2 is not None and math.isfinite(co2.mean) and math.isfinite(co2.variance)
        self._reading = Reading(
            own.drone,
            order.sequence,
            own.position_ned_m,
            co2.mean if co2 is not None and valid else 0.0,
            co2.variance if co2 is not None and valid else math.inf,
        )

    def _remember(self, reading: Reading) -> None:
        if math.isfinite(reading.variance_ppm2):
            self._window[reading.order, reading.drone] = reading
            while len(self._window) > _MEMORY:
                del self._window[next(iter(self._window))]

    # -- the root ---------------------------------------------------------------------------------------------

    def _next_if_due(self, observation: Observation, order: Order, rng: np.random.Generator) -> Order:
        """The next order once the readings of all live members are in or the time for them is over."""
        reported = {r.drone for r in observation.readings if r.order == order.sequence}
        reported.add(observation.own.drone)
        patience_s = self._p.forming_timeout_s if order.stage is Stage.FORM else self._p.waypoint_timeout_s
        waited_s = observation.elapsed_s - self._arrival.arrived_s
        if not reported.issuperset(observation.tree.slots) and waited_s < patience_s:
            return order
        return self._next(order, len(observation.tree.slots), rng)

    def _next(self, order: Order, drones: int, rng: np.random.Generator) -> Order:
        """The order after `order`, from the readings of the last two waypoints (2 x swarm size readings)."""
        note = note_of(order)
        start = note.search_start_ned_m or self._p.start_ned_m or order.anchor_ned_m
        current = [r for r in self._window.values() if r.order == order.sequence]
        note = msgspec.structs.replace(self._with_best(note, current), search_start_ned_m=start)
        order = noted(msgspec.structs.replace(order, sequence=order.sequence + 1), note)
        window = sorted(self._window.values(), key=lambda r: r.order)[-2 * drones :]
        uphill, north_m, east_m = self._uphill(order, window, rng)
        if note.best is not None and note.waypoints_since_best >= self._p.patience:
            # A long wait, or a new root, may have forgotten the contact; then only the note still has it.
            known = list(self._window.values())
            known += [] if note.best in known else [note.best]
            source = estimate_source(known, self._layout.spacing_m, self._wind_ned_mps)
            return msgspec.structs.replace(order, stage=Stage.FOUND, anchor_ned_m=source, source_ned_m=source)
        if uphill:
            turn_rad = float(rng.uniform(0.0, self._p.turn_rad))
            return msgspec.structs.replace(
                order,
                stage=Stage.TRACK,
                anchor_ned_m=(north_m, east_m, order.anchor_ned_m[2]),
                rotation_rad=(order.rotation_rad + turn_rad) % (2.0 * math.pi),
            )
        if note.best is not None and not self._is_at(order, note.best.position_ned_m):
            north_m, east_m, _ = note.best.position_ned_m
            return msgspec.structs.replace(
                order, stage=Stage.TRACK, anchor_ned_m=(north_m, east_m, order.anchor_ned_m[2])
            )
        return self._next_search(order, note, start, drones)

    def _next_search(self, order: Order, note: LocusNote, start: Vector3, drones: int) -> Order:
        """The next point of the spiral; the same one again if a heal stopped the swarm before it was reached.

        Only the radius is carried on: a swarm that has become smaller flies narrower arms from there on.
        """
        arms_m = arm_spacing_m(self._layout.full_levels(drones), self._layout.spacing_m)

        def point(index: int) -> Vector3:
            north_m, east_m = spiral_point(index, arms_m, even=True)
            return start[0] + north_m, start[1] + east_m, order.anchor_ned_m[2]

        index = 0
        if note.search_radius_m >= 0.0:
            index = math.ceil(spiral_index(note.search_radius_m, arms_m, even=True) - _SAME_INDEX)
            if order.stage is not Stage.SEARCH or self._is_at(order, point(index)):
                index += 1
        anchor = point(index)
        radius_m = math.dist(anchor[:2], start[:2])
        outside = radius_m > self._p.search_radius_m
        order = msgspec.structs.replace(
            order,
            stage=Stage.GIVE_UP if outside else Stage.SEARCH,
            anchor_ned_m=order.anchor_ned_m if outside else anchor,
        )
        return noted(order, LocusNote(radius_m, start))

    def _is_at(self, order: Order, point_ned_m: Vector3) -> bool:
        return math.dist(order.anchor_ned_m[:2], point_ned_m[:2]) <= _SAME_PLACE_M

    def _excess_ppm(self, reading: Reading) -> float:
        """The reading's excess, 0 where it is no contact."""
        least_ppm = max(self._p.detection_ppm, self._p.detection_sigmas * math.sqrt(reading.variance_ppm2))
        return reading.excess_co2_ppm if reading.excess_co2_ppm > least_ppm else 0.0

    def _with_best(self, note: LocusNote, current: list[Reading]) -> LocusNote:
        """`note` with the best reading brought up to date."""
        contacts = [reading for reading in current if self._excess_ppm(reading) > 0.0]
        top = max(contacts, key=lambda reading: reading.excess_co2_ppm, default=None)
        best = note.best
        if top is not None:
            beat_ppm = 0.0
            if best is not None:
                beat_ppm = best.excess_co2_ppm * (1.0 + self._p.improvement_fraction)
                beat_ppm += math.sqrt(top.variance_ppm2 + best.variance_ppm2)
            if top.excess_co2_ppm > beat_ppm:
                return msgspec.structs.replace(note, best=top, waypoints_since_best=0)
        if best is None:
            return note
        return msgspec.structs.replace(note, waypoints_since_best=note.waypoints_since_best + 1)

    def _uphill(
        self, order: Order, window: list[Reading], rng: np.random.Generator
    ) -> tuple[bool, float, float]:
        """Whether the window shows a gradient, and the anchor one step up it."""
        value = np.array([self._excess_ppm(reading) for reading in window])
        if not value.any():
            return False, 0.0, 0.0
        place_m = np.array([reading.position_ned_m[:2] for reading in window])
        # A reading counts by its own noise on top of what a plane cannot follow of the plume's shape.
        noise = np.array([reading.variance_ppm2 for reading in window]) + self._p.detection_ppm**2
        gradient_n, gradient_e, _ = plane_gradient(
            place_m[:, 0], place_m[:, 1], value, 1.0 / noise, len(window), self._p.arrival_m
        )
        steepness = math.hypot(gradient_n, gradient_e)
        if self._wind_ned_mps is not None and steepness > 0.0:
            wind_n, wind_e, _ = self._wind_ned_mps
            pull = self._p.upwind_weight / math.hypot(wind_n, wind_e)
            gradient_n = gradient_n / steepness - pull * wind_n
            gradient_e = gradient_e / steepness - pull * wind_e
        jitter_n, jitter_e = rng.uniform(-self._p.jitter_m, self._p.jitter_m, 2)
        north_m, east_m, _ = order.anchor_ned_m
        uphill, north_m, east_m = waypoint_uphill(
            gradient_n, gradient_e, north_m, east_m, self._p.step_m, float(jitter_n), float(jitter_e)
        )
        return bool(uphill), float(north_m), float(east_m)  # numpy's numbers do not go over the wire


def _mean_wind(observation: Observation) -> Vector3 | None:
    """The mean of what the members know of the wind; None where it is weaker than its own uncertainty."""
    known = [observation.own.wind, *(neighbour.wind for neighbour in observation.neighbours)]
    winds = [wind for wind in known if wind is not None and wind.age_s < _WIND_STALE_S]
    if not winds:
        return None
    north_mps, east_mps, down_mps = (
        math.fsum(axis) / len(winds) for axis in zip(*(wind.wind_ned_mps for wind in winds), strict=True)
    )
    variance_m2ps2 = math.fsum(wind.variance_m2ps2 for wind in winds) / len(winds)
    if math.hypot(north_mps, east_mps) < max(_CALM_MPS, math.sqrt(variance_m2ps2)):
        return None
    return north_mps, east_mps, down_mps
