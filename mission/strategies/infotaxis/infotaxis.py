"""Infotaxis: a step in the direction that is expected to leave least doubt about where the source is.

M. Vergassola, E. Villermaux, B. I. Shraiman, "'Infotaxis' as a strategy for searching without gradients", Nature 445
(2007). A robot keeps a posterior on a grid (`posterior`), updates it after every step by whether it met gas on it,
and takes the step, or the stay, whose expected entropy is least. Towards the probable source and towards places that
tell much are one and the same there: it surges after contact and casts where that is lost, without being told to.

Cooperative: C. Masson, M. Bailly Bechet, M. Vergassola, "Chasing information to search in random environments",
Journal of Physics A 42 (2009). Every robot also learns from what the others meet: a robot tells its newest
observation, and takes each that it hears into its own posterior. Nobody waits for anybody; robots that heard the same
think the same, but each chooses its own step.

The paper's steps are those of a lattice; here they are `step_m` to the north, east, south or west, at `speed_mps`. A
step that could not be made (a wall) is not tried again at once, and none leads off the grid. A robot that stays looks
around in its cell of the grid.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from mission.geometry.formation import FloatArray
from mission.strategies.infotaxis.posterior import (
    CELL_M,
    CELLS,
    begin_grid,
    cell_at,
    cell_centre_m,
    expected_entropy,
    observe,
)
from mission.strategies.reactive import reactive_strategy
from mission.strategies.surging.surge import keep_apart
from mission.strategies.tick_rule import WORD, OwnSenses, TickRule
from mission.strategies.tracing.swarming import SPEED_MPS

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]

# Places in the parameters, beside those of `swarming` and `posterior`.
STEP_M = 3
# Places in the state, behind the wanted velocity.
BEGUN, SPENT_S, HIT, MOVE_N, MOVE_E, FROM_N, FROM_E, HEARD = range(2, 10)
_RING = 128
"""So many observations of others are known again."""
IDENTITIES = HEARD + 1
FIRST = IDENTITIES + _RING
STATE_SIZE = FIRST + CELLS
# Places in the word: one observation.
IDENTITY, PLACE_N, PLACE_E, MET, WIND_N, WIND_E, TIME_S, WORD_SIZE = range(8)

_MOVED = 0.25
"""Less than this share of a step: something held the robot."""
_FARTHEST_M = 200.0
_LONGEST_S = 600.0
_FASTEST_MPS = 100.0


class InfotaxisParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The defaults are those of small robots, as in `tracing.swarming`; for drones lengths grow with the spacing, and
    the diffusivity with length and wind."""

    spacing_m: Positive = 0.8
    """Robots nearer than this give way to each other."""
    range_m: Annotated[float, Meta(gt=0.0, le=_FARTHEST_M)] = 1.0
    """Who is farther away is not seen. Observations are heard over the radio, as far as that reaches."""
    speed_mps: Positive = 0.1
    step_m: Positive = 1.0
    cell_m: Positive = 3.0
    """Of the grid of 31 by 31 cells about where the swarm began: the source has to be on it."""
    rate_hz: Positive = 1.0
    """R: how often the source emits a patch."""
    diffusivity_m2ps: Positive = 0.1
    """D: by which the plume widens, x downwind to a standard deviation of sqrt(2 D x / V)."""
    lifetime_s: Positive = 300.0
    """tau: how long a patch can be smelt."""
    sensor_m: Positive = 0.5
    """a: the size of the sensor, and of a patch."""


def infotaxis(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    advance(own, state, word, parameters)
    return keep_apart(neighbours, count, state[MOVE_N], state[MOVE_E], state, parameters)


def cooperative_infotaxis(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001 (one signature for all rules)
    state: FloatArray,
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    if state[BEGUN] != 0.0:
        for k in range(count):
            listen(neighbours, k, state, parameters)
    advance(own, state, word, parameters)
    return keep_apart(neighbours, count, state[MOVE_N], state[MOVE_E], state, parameters)


def listen(neighbours: FloatArray, k: int, state: FloatArray, parameters: FloatArray) -> None:
    """Take neighbour k's newest observation in, if it is none that was heard already."""
    identity, time_s = neighbours[k, WORD + IDENTITY], neighbours[k, WORD + TIME_S]
    wind_n, wind_e = neighbours[k, WORD + WIND_N], neighbours[k, WORD + WIND_E]
    fast = max(abs(wind_n), abs(wind_e)) > _FASTEST_MPS
    if identity == 0.0 or fast or not 0.0 < time_s <= _LONGEST_S:
        return  # it has said nothing yet, or what cannot be
    for place in range(_RING):
        if state[IDENTITIES + place] == identity:
            return
    state[IDENTITIES + int(state[HEARD])] = identity
    state[HEARD] = (state[HEARD] + 1.0) % _RING
    north_m, east_m = neighbours[k, WORD + PLACE_N], neighbours[k, WORD + PLACE_E]
    if cell_at(north_m, east_m, parameters[CELL_M]) >= 0:
        met = neighbours[k, WORD + MET] > 0.0
        observe(state, FIRST, north_m, east_m, met, wind_n, wind_e, time_s, parameters)


def advance(own: OwnSenses, state: FloatArray, word: FloatArray, parameters: FloatArray) -> None:
    """At the end of a step: what it has told, and the next one as a unit vector in MOVE."""
    if state[BEGUN] == 0.0:
        state[BEGUN] = 1.0
        begin_grid(state, FIRST)
        choose(own, state, parameters)
        return
    state[SPENT_S] += own.interval_s
    if own.gas > 0.0:
        state[HIT] = 1.0
    time_s = min(parameters[STEP_M] / parameters[SPEED_MPS], _LONGEST_S)
    if state[SPENT_S] < time_s:
        return
    hit = state[HIT] > 0.0
    observe(
        state,
        FIRST,
        own.north_m,
        own.east_m,
        hit,
        own.wind_north_mps,
        own.wind_east_mps,
        state[SPENT_S],
        parameters,
    )
    word[IDENTITY] = 1.0 + own.draw
    word[PLACE_N], word[PLACE_E] = own.north_m, own.east_m
    word[MET] = state[HIT]
    word[WIND_N], word[WIND_E] = own.wind_north_mps, own.wind_east_mps
    word[TIME_S] = min(state[SPENT_S], _LONGEST_S)
    choose(own, state, parameters)


def choose(own: OwnSenses, state: FloatArray, parameters: FloatArray) -> None:
    """The next step: of a stay and the four directions the one with the least expected entropy."""
    moved_m = math.sqrt((own.north_m - state[FROM_N]) ** 2 + (own.east_m - state[FROM_E]) ** 2)
    wanted_m = parameters[SPEED_MPS] * state[SPENT_S]
    wanted_m *= math.sqrt(state[MOVE_N] ** 2 + state[MOVE_E] ** 2)
    held = wanted_m > 0.0 and moved_m < _MOVED * wanted_m
    before_n, before_e = state[MOVE_N], state[MOVE_E]
    time_s = min(parameters[STEP_M] / parameters[SPEED_MPS], _LONGEST_S)
    least = math.inf
    for k in range(5):
        step_n, step_e = 0.0, 0.0
        if k > 0:
            # From one direction on that differs from time to time: of equal ones it is not always the same.
            quarter = (k + int(4.0 * own.draw)) % 4
            step_n = 1.0 if quarter == 0 else -1.0 if quarter == 2 else 0.0
            step_e = 1.0 if quarter == 1 else -1.0 if quarter == 3 else 0.0
        if held and step_n == before_n and step_e == before_e:
            continue
        north_m = own.north_m + parameters[STEP_M] * step_n
        east_m = own.east_m + parameters[STEP_M] * step_e
        if k > 0 and cell_at(north_m, east_m, parameters[CELL_M]) < 0:
            continue
        left = expected_entropy(
            state, FIRST, north_m, east_m, own.wind_north_mps, own.wind_east_mps, time_s, parameters
        )
        if left < least:
            least = left
            state[MOVE_N], state[MOVE_E] = step_n, step_e
    if state[MOVE_N] == 0.0 and state[MOVE_E] == 0.0:
        look_around(own, state, parameters)
    state[SPENT_S], state[HIT] = 0.0, 0.0
    state[FROM_N], state[FROM_E] = own.north_m, own.east_m


def look_around(own: OwnSenses, state: FloatArray, parameters: FloatArray) -> None:
    """Stay in the cell, which may be larger than what a robot can see: towards any point of it."""
    cell = cell_at(own.north_m, own.east_m, parameters[CELL_M])
    if cell < 0:
        return
    centre_n, centre_e = cell_centre_m(cell, parameters[CELL_M])
    north_m = centre_n + (own.draw - 0.5) * parameters[CELL_M] - own.north_m
    east_m = centre_e + (1000.0 * own.draw % 1.0 - 0.5) * parameters[CELL_M] - own.east_m
    longest_m = max(math.sqrt(north_m * north_m + east_m * east_m), parameters[STEP_M])
    state[MOVE_N], state[MOVE_E] = north_m / longest_m, east_m / longest_m


ENTRY = reactive_strategy(
    "infotaxis",
    TickRule(
        rule=infotaxis,
        parameters=InfotaxisParameters,
        range_m=_FARTHEST_M,
        state_size=STATE_SIZE,
        word_size=WORD_SIZE,
    ),
)
COOPERATIVE = reactive_strategy(
    "cooperative-infotaxis",
    TickRule(
        rule=cooperative_infotaxis,
        parameters=InfotaxisParameters,
        range_m=_FARTHEST_M,
        state_size=STATE_SIZE,
        word_size=WORD_SIZE,
    ),
)
