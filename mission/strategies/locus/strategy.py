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
* All of these are numbers of the one rule (`mission.strategies.locus.rule`) that the trials compile with the paper's.
* All that a new root needs to go on is in the order and its `LocusNote`.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from mission.estimation.estimates import Reading
from mission.estimation.source import estimate_source
from mission.geometry.formation import FloatArray, Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Decision, GoTo, Hold, Observation, Order, Stage
from mission.strategies.entry import StrategyEntry
from mission.strategies.locus import rule
from mission.strategies.locus.note import LocusNote, note_of, noted
from mission.strategies.locus.seats import nearest_first
from mission.strategies.locus.spiral import arm_spacing_m

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]

STAGES = (Stage.FORM, Stage.SEARCH, Stage.TRACK, Stage.FOUND, Stage.GIVE_UP)
"""By the rule's numbers of them."""
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
    patience: Annotated[int, Meta(ge=0)] = 16
    """Waypoints without a better reading after which the source counts as found; 0: it never does."""
    return_to_best: bool = True
    """Whether a swarm that has lost contact returns to its best reading before it searches on (paper: no)."""
    even_spiral: bool = True
    """Whether far points of the spiral stand closer than 12 degrees (paper: no)."""
    improvement_fraction: NotNegative = 0.02
    """A better reading exceeds the best by this fraction and one standard deviation."""
    search_radius_m: Positive = 200.0
    """The search is given up when the spiral leaves this radius."""


def rule_numbers(p: LocusParameters) -> FloatArray:
    """The numbers of the rule; ARMS_M follows from the swarm's size."""
    numbers = np.zeros(rule.RULE_NUMBERS)
    numbers[rule.STEP_M] = p.step_m
    numbers[rule.JITTER_M] = p.jitter_m
    numbers[rule.TURN_RAD] = p.turn_rad
    numbers[rule.UPWIND] = p.upwind_weight
    numbers[rule.DETECTION] = numbers[rule.NOISE] = p.detection_ppm
    numbers[rule.SIGMAS] = p.detection_sigmas
    numbers[rule.EXTENT_M] = p.arrival_m
    numbers[rule.IMPROVEMENT] = p.improvement_fraction
    numbers[rule.PATIENCE] = p.patience
    numbers[rule.RETURNS] = float(p.return_to_best)
    numbers[rule.PATTERN] = rule.EVEN_SPIRAL if p.even_spiral else rule.SPIRAL
    numbers[rule.LIMIT_M] = p.search_radius_m
    return numbers


class Locus:
    """One drone's part in a LoCUS swarm; see the module's text."""

    Parameters = LocusParameters

    def __init__(
        self,
        layout: Layout,
        parameters: LocusParameters | None = None,
        *,
        spoke_m: float | None = None,
        seated: bool = False,
    ) -> None:
        """`spoke_m`: search on golden spokes of this length; `seated`: form up with whoever is nearest innermost.

        `locus-multi` asks for these. A swarm whose order has seats is seated anew when a member is lost.
        """
        self._seated = seated
        self._layout = layout
        self._p = parameters or LocusParameters()
        self._arrival = Arrival(
            arrival_m=self._p.arrival_m,
            settle_mps=self._p.settle_mps,
            settle_s=self._p.settle_s,
            blocked_s=self._p.blocked_s,
        )
        self._numbers = rule_numbers(self._p)
        if spoke_m is not None:
            self._numbers[rule.PATTERN] = rule.SPOKES
            self._numbers[rule.SPOKE_M] = spoke_m
            self._numbers[rule.SPOKE_STEP_M] = layout.spacing_m
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
            order = self._first_order(observation, rng)
        target = self._target(order, own.drone, tree.slot)
        if self._arrival.step(observation.elapsed_s, own.position_ned_m, own.velocity_ned_mps, target):
            self._take_reading(observation, order)
        reading = self._reading if self._reading and self._reading.order == order.sequence else None
        if is_root and reading is not None and not order.stage.ends_survey:
            self._remember(reading)
            self._wind_ned_mps = _mean_wind(observation)
            order = self._next_if_due(observation, order, rng)
        if is_root and order is not observation.order:
            self._given = order
            return Decision(GoTo(self._target(order, own.drone, tree.slot)), reading, order)
        return Decision(GoTo(target), reading)

    # -- every drone ------------------------------------------------------------------------------------------

    def _target(self, order: Order, drone: int, slot: int) -> Vector3:
        place = dict(note_of(order).seats).get(drone, slot)
        north_m, east_m = rotated(self._layout.offset_m(place), order.rotation_rad)
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
        order = self._next(order, len(observation.tree.slots), rng)
        seats = note_of(order).seats
        if seats and {drone for drone, _ in seats} != set(observation.tree.slots):
            return seated(order, observation)
        return order

    def _first_order(self, observation: Observation, rng: np.random.Generator) -> Order:
        """Where nothing else has ordered it: form up about the start."""
        order = Order(0, Stage.FORM, self._p.start_ned_m or observation.own.position_ned_m, 0.0)
        if self._seated:
            note = LocusNote(0.0, order.anchor_ned_m, search_bearing_rad=2.0 * math.pi * rng.random())
            return seated(noted(order, note), observation)
        return order

    def _next(self, order: Order, drones: int, rng: np.random.Generator) -> Order:
        """The order after `order`, from the readings of the last two waypoints (2 x swarm size readings)."""
        note = note_of(order)
        window = sorted(self._window.values(), key=lambda r: r.order)[-2 * drones :]
        state = self._state(order, note)
        self._numbers[rule.ARMS_M] = arm_spacing_m(self._layout.full_levels(drones), self._layout.spacing_m)
        place_m = np.array([reading.position_ned_m for reading in window]).reshape(-1, 3)
        value = np.array([reading.excess_co2_ppm for reading in window])
        variance = np.array([reading.variance_ppm2 for reading in window])
        contact, weight = np.zeros(len(window)), np.zeros(len(window))
        some = rule.contacts(self._numbers, value, variance, len(window), contact, weight)
        wind_n_mps, wind_e_mps, _ = self._wind_ned_mps or (0.0, 0.0, 0.0)
        draw_n, draw_e = rng.random(2) if some else (0.5, 0.5)
        if rule.locus_next(
            state,
            self._numbers,
            place_m[:, 0],
            place_m[:, 1],
            contact,
            variance,
            weight,
            len(window),
            sum(reading.order == order.sequence for reading in window),
            some,
            wind_n_mps,
            wind_e_mps,
            draw_n,
            draw_e,
        ):
            rule.turn(state, self._numbers, rng.random())
        found = int(state[rule.BEST_ROW])
        best = (window[found] if found >= 0 else note.best) if state[rule.BEST] > 0.0 else None
        stage = STAGES[int(state[rule.STAGE])]
        anchor, source = (
            (float(state[rule.ANCHOR_N]), float(state[rule.ANCHOR_E]), order.anchor_ned_m[2]),
            None,
        )
        if stage is Stage.FOUND and best is not None:
            # A long wait, or a new root, may have forgotten the contact; then only the note still has it.
            known = list(self._window.values())
            known += [] if best in known else [best]
            anchor = source = estimate_source(known, self._layout.spacing_m, self._wind_ned_mps)
        start = (float(state[rule.START_N]), float(state[rule.START_E]), order.anchor_ned_m[2])
        return msgspec.structs.replace(
            noted(
                order,
                LocusNote(
                    float(state[rule.RADIUS]),
                    start,
                    best,
                    int(state[rule.SINCE_BEST]),
                    float(state[rule.BEARING]),
                    note.seats,
                ),
            ),
            sequence=order.sequence + 1,
            stage=stage,
            anchor_ned_m=anchor,
            rotation_rad=float(state[rule.ROTATION] % (2.0 * math.pi)),
            source_ned_m=source,
        )

    def _state(self, order: Order, note: LocusNote) -> FloatArray:
        """What the rule goes on from."""
        state = np.zeros(rule.STATE_SIZE)
        start = note.search_start_ned_m or self._p.start_ned_m or order.anchor_ned_m
        rule.locus_begin(state, start[0], start[1], order.rotation_rad, note.search_bearing_rad)
        state[rule.STAGE] = STAGES.index(order.stage)
        state[rule.ANCHOR_N], state[rule.ANCHOR_E], _ = order.anchor_ned_m
        state[rule.RADIUS] = note.search_radius_m
        if note.best is not None:
            state[rule.BEST] = note.best.excess_co2_ppm
            state[rule.BEST_VARIANCE] = note.best.variance_ppm2
            state[rule.BEST_N], state[rule.BEST_E], _ = note.best.position_ned_m
            state[rule.SINCE_BEST] = note.waypoints_since_best
        return state


def seated(order: Order, observation: Observation) -> Order:
    """`order` with a seat for every member: whoever is nearest to the anchor takes the innermost.

    A member that was never heard comes last.
    """
    own = observation.own
    where = {n.drone: n.position_ned_m for n in observation.neighbours} | {own.drone: own.position_ned_m}
    drones = sorted(observation.tree.slots)
    place_m = np.array([where.get(drone, (math.inf, math.inf, 0.0)) for drone in drones])
    known = np.array([int(drone in where) for drone in drones])
    holder = np.full(len(drones), -1, np.int64)
    north_m, east_m, _ = order.anchor_ned_m
    nearest_first(place_m[:, 0], place_m[:, 1], known, north_m, east_m, np.zeros_like(holder), holder)
    nearest = [drones[number] for number in holder if number >= 0]
    nearest += [drone for drone in drones if drone not in where]
    seats = tuple((drone, place) for place, drone in enumerate(nearest))
    return noted(order, msgspec.structs.replace(note_of(order), seats=seats))


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


ENTRY = StrategyEntry(
    name="locus", make=Locus, parameters=LocusParameters, rules=(rule.locus_next,), note=LocusNote, legs=True
)
