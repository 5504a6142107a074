"""Where a lattice of vehicles goes next, and how wide: algorithms B1 to B4, as plain functions of numbers.

D. V. Zarzhitsky, D. F. Spears, D. R. Thayer: "Experimental studies of swarm robotic chemical plume tracing using
computational fluid dynamics simulations", International Journal of Intelligent Computing and Cybernetics 3 (2010).
Vehicle 0 is the lattice's centre, the others stand on a ring about it in order. Each time everybody has arrived, the
rule is given what all of them read and gives the next centre and radius. The agent calls it, the trials compile it.

What the paper leaves open:

* A waypoint is `STEP_M` away, or nearer where the aim is nearer.
* The ring keeps its order, and a vehicle that is held away from its place reads where it is.
* An edge's flux is the mean of rho V of its two ends, along the outward normal, times its length.
* The three radii are the least, the greatest and their mean; they are visited from the nearer end. With a greatest
  radius equal to the least, fluxotaxis as printed always casts.
* Casting goes side to side by the golden ratio faster than up and down: along 45 degrees its way through a square
  would close on itself after four reflections, and most of the square never be seen.
* Advance along an axis counts as blocked at the limits, and where the centre has not come as far as it was sent.
"""

from __future__ import annotations

import math

from mission.geometry.formation import FloatArray
from mission.strategies.spokes import GOLDEN

# Tracers.
CAST, CHEMOTAXIS, ANEMOTAXIS, FLUXOTAXIS = range(4)

# Places in the numbers.
(
    TRACER,
    LEAST_M,
    MOST_M,
    WIDEN_M,
    STEP_M,
    DETECTION,
    FLUX,
    LOW_N,
    LOW_E,
    HIGH_N,
    HIGH_E,
    LATTICE_NUMBERS,
) = range(12)
"""LEAST_M, MOST_M: of the ring's radius, which changes by WIDEN_M where it is not sensed on purpose. DETECTION:
a reading above it is contact. FLUX: a flux above it counts. LOW_N ...: the rectangle that is not left."""

_UP_AND_DOWN, _SIDE_TO_SIDE = 1.0 / math.hypot(1.0, GOLDEN), GOLDEN / math.hypot(1.0, GOLDEN)
_RADII = 3
_EDGES_FROM = 4
"""With fewer vehicles the ring has no inside."""

# Places in the state.
CENTRE_N, CENTRE_E, RADIUS_M, WIDENING, TOWARD_N, TOWARD_E, SENSING, INWARD, RECORDS = range(9)
"""WIDENING: 1 while casting widens the ring. TOWARD_N, TOWARD_E: casting's direction, 1 or -1. SENSING: which of the
three radii is under way, 0 when none is being sensed. INWARD: 1 where they are visited from the greatest."""
TOTAL, CENTROID_N, CENTROID_E, RECORD = range(4)
"""Of each radius from RECORDS on: the sum of the readings and their centroid."""
INFLUX = RECORDS + _RADII * RECORD
INFLUX_N, INFLUX_E, OUTFLUX, OUTFLUX_N, OUTFLUX_E, LATTICE_STATE = range(INFLUX + 1, INFLUX + 7)
"""The largest fluxes over the radii, above 0, and the middles of their edges."""


def lattice_begin(
    state: FloatArray, numbers: FloatArray, north_m: float, east_m: float, radius_m: float, draw: float
) -> None:
    """Make `state` (LATTICE_STATE numbers) that of a lattice about to cast from here; `draw` in [0, 1) is its way."""
    for place in range(LATTICE_STATE):
        state[place] = 0.0
    state[CENTRE_N], state[CENTRE_E], state[RADIUS_M] = north_m, east_m, radius_m
    state[WIDENING] = 1.0
    state[TOWARD_N] = 1.0 if draw < 0.5 else -1.0
    state[TOWARD_E] = 1.0 if draw % 0.5 < 0.25 else -1.0
    _keep_within(state, numbers)


def lattice_next(
    state: FloatArray,
    numbers: FloatArray,
    north_m: FloatArray,
    east_m: FloatArray,
    gas: FloatArray,
    wind_north_mps: FloatArray,
    wind_east_mps: FloatArray,
    count: int,
    draw: float,
) -> None:
    """Set the next centre and radius in `state`, given where `count` (1 or more) vehicles are and what they read.

    Readings are 0 or more; `draw` is uniform in [0, 1).
    """
    tracer = int(numbers[TRACER])
    total, best = 0.0, 0
    for k in range(count):
        total += gas[k]
        if gas[k] > gas[best]:
            best = k
    contact = gas[best] > numbers[DETECTION]
    if tracer == CHEMOTAXIS and contact:
        _go(state, numbers, north_m[0], east_m[0], north_m[best], east_m[best])
        _breathe(state, numbers, draw)
    elif tracer == ANEMOTAXIS and contact:
        wind_n, wind_e = 0.0, 0.0
        for k in range(count):
            wind_n += wind_north_mps[k] / count
            wind_e += wind_east_mps[k] / count
        speed_mps = math.hypot(wind_n, wind_e)
        if speed_mps > 0.0:
            step_m = numbers[STEP_M]
            state[CENTRE_N] = north_m[0] - step_m * (wind_n / speed_mps)
            state[CENTRE_E] = east_m[0] - step_m * (wind_e / speed_mps)
            _breathe(state, numbers, draw)
        else:
            _cast(state, numbers, north_m[0], east_m[0])
    elif tracer == FLUXOTAXIS and state[SENSING] > 0.0:
        _record(state, north_m, east_m, gas, wind_north_mps, wind_east_mps, count, total)
        if state[SENSING] <= _RADII:
            state[RADIUS_M] = _radius(state, numbers)
        else:
            state[SENSING] = 0.0
            _chem_region(state, numbers, north_m[0], east_m[0])
    elif tracer == FLUXOTAXIS and contact:
        if count > 1 and gas[0] > 0.5 * total:
            state[CENTRE_N], state[CENTRE_E] = north_m[0], east_m[0]
            state[RADIUS_M] = numbers[LEAST_M]
        else:
            state[CENTRE_N], state[CENTRE_E] = north_m[0], east_m[0]
            nearer_to_most = 2.0 * state[RADIUS_M] > numbers[LEAST_M] + numbers[MOST_M]
            state[INWARD] = 1.0 if nearer_to_most else 0.0
            state[SENSING] = 1.0
            for place in range(RECORDS, LATTICE_STATE):
                state[place] = 0.0
            there_m = state[RADIUS_M]
            state[RADIUS_M] = _radius(state, numbers)
            if there_m == state[RADIUS_M]:
                _record(state, north_m, east_m, gas, wind_north_mps, wind_east_mps, count, total)
                state[RADIUS_M] = _radius(state, numbers)
    else:
        _cast(state, numbers, north_m[0], east_m[0])
    _keep_within(state, numbers)


def _keep_within(state: FloatArray, numbers: FloatArray) -> None:
    """Radius and centre within their limits."""
    half_m = 0.5 * min(numbers[HIGH_N] - numbers[LOW_N], numbers[HIGH_E] - numbers[LOW_E])
    radius_m = min(max(state[RADIUS_M], numbers[LEAST_M]), numbers[MOST_M], half_m)
    state[RADIUS_M] = radius_m
    state[CENTRE_N] = min(max(state[CENTRE_N], numbers[LOW_N] + radius_m), numbers[HIGH_N] - radius_m)
    state[CENTRE_E] = min(max(state[CENTRE_E], numbers[LOW_E] + radius_m), numbers[HIGH_E] - radius_m)


def _go(
    state: FloatArray, numbers: FloatArray, from_n: float, from_e: float, aim_n: float, aim_e: float
) -> None:
    """Send the centre from where it is to the aim, or a step towards it."""
    away_m = math.hypot(aim_n - from_n, aim_e - from_e)
    share = min(1.0, numbers[STEP_M] / away_m) if away_m > 0.0 else 0.0
    state[CENTRE_N] = from_n + share * (aim_n - from_n)
    state[CENTRE_E] = from_e + share * (aim_e - from_e)


def _breathe(state: FloatArray, numbers: FloatArray, draw: float) -> None:
    """Chemotaxis and anemotaxis change the radius at random."""
    state[RADIUS_M] += numbers[WIDEN_M] if draw < 0.5 else -numbers[WIDEN_M]


def _cast(state: FloatArray, numbers: FloatArray, from_n: float, from_e: float) -> None:
    """Algorithm B1: the ring pulsates, the centre goes along a straight line that is reflected."""
    if state[WIDENING] == 1.0:
        if state[RADIUS_M] < numbers[MOST_M]:
            state[RADIUS_M] += numbers[WIDEN_M]
        else:
            state[WIDENING] = 0.0
    elif state[RADIUS_M] > numbers[LEAST_M]:
        state[RADIUS_M] -= numbers[WIDEN_M]
    else:
        state[WIDENING] = 1.0
    radius_m = min(max(state[RADIUS_M], numbers[LEAST_M]), numbers[MOST_M])
    step_m = numbers[STEP_M] * _UP_AND_DOWN
    low, high = numbers[LOW_N] + radius_m, numbers[HIGH_N] - radius_m
    state[TOWARD_N] = _reflected(state[TOWARD_N], from_n, state[CENTRE_N], low, high, step_m)
    state[CENTRE_N] = from_n + step_m * state[TOWARD_N]
    step_m = numbers[STEP_M] * _SIDE_TO_SIDE
    low, high = numbers[LOW_E] + radius_m, numbers[HIGH_E] - radius_m
    state[TOWARD_E] = _reflected(state[TOWARD_E], from_e, state[CENTRE_E], low, high, step_m)
    state[CENTRE_E] = from_e + step_m * state[TOWARD_E]


def _reflected(toward: float, here: float, sent: float, low: float, high: float, step_m: float) -> float:
    """The direction along one axis: the other where the advance is blocked, away from a limit that is passed."""
    if here + step_m > high and here - step_m < low:
        return -toward
    if here + toward * step_m > high:
        return -1.0
    if here + toward * step_m < low:
        return 1.0
    return -toward if (sent - here) * toward > 0.5 * step_m else toward


def _radius(state: FloatArray, numbers: FloatArray) -> float:
    """The radius at which the lattice senses next."""
    place = _place(state)
    if place == 0:
        return float(numbers[LEAST_M])
    return float(0.5 * (numbers[LEAST_M] + numbers[MOST_M]) if place == 1 else numbers[MOST_M])


def _place(state: FloatArray) -> int:
    """Which of the radii is being sensed, 0 for the least."""
    place = int(state[SENSING]) - 1
    return _RADII - 1 - place if state[INWARD] == 1.0 else place


def _record(
    state: FloatArray,
    north_m: FloatArray,
    east_m: FloatArray,
    gas: FloatArray,
    wind_north_mps: FloatArray,
    wind_east_mps: FloatArray,
    count: int,
    total: float,
) -> None:
    """Keep the total, the centroid and the fluxes of the radius that is being sensed, and turn to the next."""
    at = RECORDS + RECORD * _place(state)
    state[SENSING] += 1.0
    state[at + TOTAL] = total
    if total > 0.0:
        for k in range(count):
            state[at + CENTROID_N] += gas[k] / total * north_m[k]
            state[at + CENTROID_E] += gas[k] / total * east_m[k]
    ring_flux(state, north_m, east_m, gas, wind_north_mps, wind_east_mps, count)


def ring_flux(
    state: FloatArray,
    north_m: FloatArray,
    east_m: FloatArray,
    gas: FloatArray,
    wind_north_mps: FloatArray,
    wind_east_mps: FloatArray,
    count: int,
) -> None:
    """Algorithm B4, flux_ring: keep the largest fluxes into the ring and out of it, if larger than before."""
    if count < _EDGES_FROM:
        return
    middle_n, middle_e = 0.0, 0.0
    for k in range(1, count):
        middle_n += north_m[k] / (count - 1)
        middle_e += east_m[k] / (count - 1)
    for a in range(1, count):
        b = a + 1 if a + 1 < count else 1
        at_n, at_e = 0.5 * (north_m[a] + north_m[b]), 0.5 * (east_m[a] + east_m[b])
        # Perpendicular to the edge and as long: the outward normal times the length, once it points outward.
        out_n, out_e = east_m[b] - east_m[a], north_m[a] - north_m[b]
        if out_n * (at_n - middle_n) + out_e * (at_e - middle_e) < 0.0:
            out_n, out_e = -out_n, -out_e
        flow_n = 0.5 * (gas[a] * wind_north_mps[a] + gas[b] * wind_north_mps[b])
        flow_e = 0.5 * (gas[a] * wind_east_mps[a] + gas[b] * wind_east_mps[b])
        flux = flow_n * out_n + flow_e * out_e
        if -flux > state[INFLUX]:
            state[INFLUX], state[INFLUX_N], state[INFLUX_E] = -flux, at_n, at_e
        if flux > state[OUTFLUX]:
            state[OUTFLUX], state[OUTFLUX_N], state[OUTFLUX_E] = flux, at_n, at_e


def _chem_region(state: FloatArray, numbers: FloatArray, from_n: float, from_e: float) -> None:
    """Algorithm B4, chem_region, once all three radii are sensed."""
    inner, middle, outer = RECORDS, RECORDS + RECORD, RECORDS + 2 * RECORD
    low, between, high = state[inner + TOTAL], state[middle + TOTAL], state[outer + TOTAL]
    if low < between < high:
        aim_n, aim_e, known = 0.0, 0.0, 0
        for place in range(_RADII):
            at = RECORDS + RECORD * place
            if state[at + TOTAL] > 0.0:  # where nothing is read there is no centroid
                aim_n += state[at + CENTROID_N]
                aim_e += state[at + CENTROID_E]
                known += 1
        _go(state, numbers, from_n, from_e, aim_n / known, aim_e / known)
    elif high > low:
        _go(state, numbers, from_n, from_e, state[outer + CENTROID_N], state[outer + CENTROID_E])
    elif low > between > high:
        if state[INFLUX] > numbers[FLUX]:
            _go(state, numbers, from_n, from_e, state[INFLUX_N], state[INFLUX_E])
        elif state[OUTFLUX] > numbers[FLUX]:
            _go(state, numbers, from_n, from_e, state[OUTFLUX_N], state[OUTFLUX_E])
        else:
            _cast(state, numbers, from_n, from_e)
    else:
        _cast(state, numbers, from_n, from_e)
