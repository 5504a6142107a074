"""The rule of LoCUS: the swarm's next waypoint from a window of readings (LoCUS paper, section V-A).

Up the gradient where the readings show one, else on with the search for contact, on a spiral or on golden spokes.
Plain functions of numbers and small arrays: the agent calls them, the trials compile them. First `contacts` of the
window, then `locus_next`, and `turn` after a step up the gradient. What real sensors and a real plume need, and the
paper's simulation does not, is in the numbers:

| number | the paper's trials | flights |
| --- | --- | --- |
| DETECTION, SIGMAS: what counts as contact | 0, 0: everything above 0 | ppm, and multiples of the reading's noise |
| NOISE: what a plane cannot follow, on top of a reading's noise | 1: all readings count alike | DETECTION |
| UPWIND: share of a step against the wind | 0 | 1 |
| PATTERN | SPIRAL, or SPOKES | EVEN_SPIRAL, or SPOKES |
| RETURNS: back to the best reading before the search goes on | 0 | 1 |
| PATIENCE: waypoints without a better reading that end it; 0: none do | 0: they know the answer | 16 |
| LIMIT_M: the spiral's radius that ends it | infinite | the search radius |

Places are metres north and east, in any frame without rotation; readings are ppm (the trials: shares of the peak).
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray
from mission.strategies.locus.gradient import plane_gradient, waypoint_uphill
from mission.strategies.locus.spiral import spiral_index, spiral_point
from mission.strategies.spokes import next_on_spokes

# Places in the state of one swarm.
(
    STAGE,
    ANCHOR_N,
    ANCHOR_E,
    ROTATION,
    START_N,
    START_E,
    RADIUS,
    BEARING,
    BEST,
    BEST_VARIANCE,
    BEST_N,
    BEST_E,
    BEST_ROW,
    SINCE_BEST,
    STATE_SIZE,
) = range(15)
"""RADIUS: how far out the search has got, on the spiral (negative before its first point) or on the present spoke,
whose bearing is BEARING. BEST: the reading that a better one must beat, 0 without contact, its variance and place;
BEST_ROW: its row in the window where it was taken at this waypoint, else -1."""

# Stages, as STAGE holds them, in the order of `contract.Stage`.
FORM, SEARCH, TRACK, FOUND, GIVE_UP = range(5)

# Places in the numbers of a rule, and the patterns of a search.
(
    STEP_M,
    JITTER_M,
    TURN_RAD,
    UPWIND,
    DETECTION,
    SIGMAS,
    NOISE,
    EXTENT_M,
    IMPROVEMENT,
    PATIENCE,
    RETURNS,
    PATTERN,
    ARMS_M,
    LIMIT_M,
    SPOKE_M,
    SPOKE_STEP_M,
    RULE_NUMBERS,
) = range(17)
SPIRAL, EVEN_SPIRAL, SPOKES = range(3)

_SAME_PLACE_M = 0.5
"""An anchor this near to a point is at that point."""
_SAME_INDEX = 1e-6
"""Rounding of a spiral point's number that was found again from its radius."""


def locus_begin(
    state: FloatArray, north_m: float, east_m: float, rotation_rad: float, bearing_rad: float
) -> None:
    """Make `state` (STATE_SIZE numbers) that of a swarm that forms up, and will search from there."""
    for place in range(STATE_SIZE):
        state[place] = 0.0
    state[STAGE] = FORM
    state[ANCHOR_N] = state[START_N] = north_m
    state[ANCHOR_E] = state[START_E] = east_m
    state[ROTATION] = rotation_rad
    state[BEARING] = bearing_rad
    state[BEST_ROW] = -1.0


def contacts(
    numbers: FloatArray,
    value: FloatArray,
    variance: FloatArray,
    count: int,
    contact: FloatArray,
    weight: FloatArray,
) -> bool:
    """Whether any of the first `count` readings has contact; if so, `contact` gets them with 0 where there is none.

    `weight` then gets how much each counts: by its own noise on top of what a plane cannot follow of the plume.
    """
    least = numbers[DETECTION]
    sigmas = numbers[SIGMAS]
    some = False
    for i in range(count):
        if value[i] > least and value[i] > sigmas * math.sqrt(variance[i]):
            some = True
    if not some:
        return False
    noise = numbers[NOISE] * numbers[NOISE]
    for i in range(count):
        has_contact = value[i] > least and value[i] > sigmas * math.sqrt(variance[i])
        contact[i] = value[i] if has_contact else 0.0
        weight[i] = 1.0 / (variance[i] + noise)
    return True


def turn(state: FloatArray, numbers: FloatArray, draw: float) -> None:
    """Turn the formation, as it is due after a step up the gradient."""
    state[ROTATION] += numbers[TURN_RAD] * draw


def locus_next(
    state: FloatArray,
    numbers: FloatArray,
    north_m: FloatArray,
    east_m: FloatArray,
    contact: FloatArray,
    variance: FloatArray,
    weight: FloatArray,
    count: int,
    fresh: int,
    some: bool,
    wind_n_mps: float,
    wind_e_mps: float,
    draw_n: float,
    draw_e: float,
) -> bool:
    """Change `state` to the next waypoint: its stage and anchor, and what the search must remember.

    The first `count` rows are the window, oldest first: the readings of this waypoint (the last `fresh` rows) and
    of the one before, with their places and variances (finite) and what `contacts` made of them. A wind of (0, 0) is
    not known. The draws, uniform in [0, 1), are for the step's jitter. Returns whether it is a step up the gradient.
    """
    keep_best(state, numbers, north_m, east_m, contact, variance, count, fresh if some else 0)
    if state[BEST] > 0.0 and 0.0 < numbers[PATIENCE] <= state[SINCE_BEST]:
        state[STAGE] = FOUND
        return False
    if some:
        slope_n, slope_e, _ = plane_gradient(north_m, east_m, contact, weight, count, numbers[EXTENT_M])
        steepness = math.hypot(slope_n, slope_e)
        wind_mps = math.hypot(wind_n_mps, wind_e_mps)
        if numbers[UPWIND] > 0.0 and wind_mps > 0.0 and steepness > 0.0:
            pull = numbers[UPWIND] / wind_mps
            slope_n = slope_n / steepness - pull * wind_n_mps
            slope_e = slope_e / steepness - pull * wind_e_mps
        uphill, anchor_n, anchor_e = waypoint_uphill(
            slope_n,
            slope_e,
            state[ANCHOR_N],
            state[ANCHOR_E],
            numbers[STEP_M],
            numbers[JITTER_M] * (2.0 * draw_n - 1.0),
            numbers[JITTER_M] * (2.0 * draw_e - 1.0),
        )
        if uphill:
            state[STAGE] = TRACK
            state[ANCHOR_N] = anchor_n
            state[ANCHOR_E] = anchor_e
            return True
    if numbers[RETURNS] > 0.0 and state[BEST] > 0.0:
        away_m = math.hypot(state[ANCHOR_N] - state[BEST_N], state[ANCHOR_E] - state[BEST_E])
        if away_m > _SAME_PLACE_M:
            state[STAGE] = TRACK
            state[ANCHOR_N] = state[BEST_N]
            state[ANCHOR_E] = state[BEST_E]
            return False
    search_on(state, numbers)
    return False


def keep_best(
    state: FloatArray,
    numbers: FloatArray,
    north_m: FloatArray,
    east_m: FloatArray,
    contact: FloatArray,
    variance: FloatArray,
    count: int,
    fresh: int,
) -> None:
    """Bring the best reading up to date with those of this waypoint."""
    top = -1
    for i in range(count - fresh, count):
        if contact[i] > 0.0 and (top < 0 or contact[i] > contact[top]):
            top = i
    state[BEST_ROW] = -1.0
    if top >= 0:
        beat = 0.0
        if state[BEST] > 0.0:
            beat = state[BEST] * (1.0 + numbers[IMPROVEMENT])
            beat += math.sqrt(variance[top] + state[BEST_VARIANCE])
        if contact[top] > beat:
            state[BEST] = contact[top]
            state[BEST_VARIANCE] = variance[top]
            state[BEST_N] = north_m[top]
            state[BEST_E] = east_m[top]
            state[BEST_ROW] = top
            state[SINCE_BEST] = 0.0
            return
    if state[BEST] > 0.0:
        state[SINCE_BEST] += 1.0


def search_on(state: FloatArray, numbers: FloatArray) -> None:
    """The next point of the search; the same one again if a heal stopped the swarm before it was reached.

    On the spiral only the radius is carried on: a swarm that has become smaller flies narrower arms from there on.
    """
    on_the_way = False
    if numbers[PATTERN] == SPOKES:
        radius_m, bearing_rad = max(state[RADIUS], 0.0), state[BEARING]
        north_m, east_m = radius_m * math.cos(bearing_rad), radius_m * math.sin(bearing_rad)
        if state[STAGE] == SEARCH:
            on_the_way = not is_at(state, north_m, east_m)
        if not on_the_way:
            radius_m, bearing_rad = next_on_spokes(
                radius_m, bearing_rad, numbers[SPOKE_M], numbers[SPOKE_STEP_M]
            )
            north_m, east_m = radius_m * math.cos(bearing_rad), radius_m * math.sin(bearing_rad)
        state[BEARING] = bearing_rad
    else:
        even = numbers[PATTERN] == EVEN_SPIRAL
        arms_m = numbers[ARMS_M]
        index = 0
        if state[RADIUS] >= 0.0:
            index = math.ceil(spiral_index(state[RADIUS], arms_m, even) - _SAME_INDEX)
            north_m, east_m = spiral_point(index, arms_m, even)
            if state[STAGE] == SEARCH:
                on_the_way = not is_at(state, north_m, east_m)
            if not on_the_way:
                index += 1
        north_m, east_m = spiral_point(index, arms_m, even)
        radius_m = math.hypot(north_m, east_m)
    state[RADIUS] = radius_m
    state[BEST] = 0.0
    state[SINCE_BEST] = 0.0
    if radius_m > numbers[LIMIT_M]:
        state[STAGE] = GIVE_UP
        return
    state[STAGE] = SEARCH
    state[ANCHOR_N] = state[START_N] + north_m
    state[ANCHOR_E] = state[START_E] + east_m


def is_at(state: FloatArray, north_m: float, east_m: float) -> bool:
    """Whether the anchor is at a point that is given from the start."""
    away_n_m = state[ANCHOR_N] - state[START_N] - north_m
    away_e_m = state[ANCHOR_E] - state[START_E] - east_m
    return math.hypot(away_n_m, away_e_m) <= _SAME_PLACE_M
