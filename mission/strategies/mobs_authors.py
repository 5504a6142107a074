"""MoBS as the LoCUS paper's authors programmed it, where their program differs from the paper's text (`mobs`).

1. A spoke is flown out and back in waypoints.
2. The plume is tested at every tick; at the first contact the drone stops where it is and turns moth.
3. The first moth decision comes a tick later and compares with the reading of the contact; only if the reading has
   grown since then does the drone go on outwards.
4. Decisions with nothing before and nothing now are counted over the whole moth phase; the fifth ends it.
5. A drone turns moth once. Afterwards it flies spokes and heeds no reading.
6. A new direction is drawn from a square; a waypoint takes a tick more and a moth step two.

The rule is a plain function of numbers and one small array: the agent calls it, the trials compile it.
"""

from __future__ import annotations

import math

import numpy as np

from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from mission.strategies.contract import OwnState
from mission.strategies.entry import StrategyEntry
from mission.strategies.mobs import Mobs, MobsParameters, MobsWord, waypoint_arrival
from mission.strategies.spokes import next_bearing

_ZEROS = 4
"""After more than so many moth decisions with nothing before and nothing now, back to the spokes."""

# Places in the state array of one drone.
(
    PHASE,
    WAIT,
    TURNED,
    BEARING,
    ALONG,
    BACK,
    TARGET_N,
    TARGET_E,
    GOAL_N,
    GOAL_E,
    HEADING_N,
    HEADING_E,
    BEFORE,
    ZEROS,
    AUTHORS_STATE_SIZE,
) = range(15)
"""WAIT: ticks until the next decision or command; 0: the drone is on its way to TARGET, or there. TURNED: 1 once it
has turned moth. ALONG: how far out the waypoint is on the spoke at BEARING, below 0 where the spoke's first, the
centre, is still to come; BACK: 1 on the way back. GOAL: where the next moth step leads, HEADING its direction."""

# Phases: on the spokes; the moth's decision is next; a moth step is decided on or flown.
SPOKES, DECISION, STEP = range(3)

# Ticks from an arrival (or the decision that a moth's search is over) to the next command.
_NEXT, _FROM_CENTRE, _NEXT_SPOKE, _OVER = 1, 2, 4, 2


def mobs_authors_begin(state: FloatArray, bearing_rad: float) -> None:
    """Make `state` (AUTHORS_STATE_SIZE numbers) that of a drone on its way to the centre, (0, 0), of its spokes."""
    for k in range(AUTHORS_STATE_SIZE):
        state[k] = 0.0
    state[BEARING] = bearing_rad


def mobs_authors_next(
    state: FloatArray,
    ticks: int,
    north_m: float,
    east_m: float,
    reading: float,
    there: bool,
    radius_m: float,
    step_m: float,
    draw_n: float,
    draw_e: float,
) -> tuple[float, float]:
    """Where the drone flies from now on (north, east from the centre).

    To be called every tick, or only when something happens: at the first contact, then `state[WAIT]` ticks after the
    last call or, where that is 0, on arrival. `ticks` have passed since the last call. `there`: the drone is at the
    point that the rule gave last. `reading` is 0 where there is no contact; the draws, uniform in [0, 1), are for a
    new direction.
    """
    if reading > 0.0 and state[TURNED] == 0.0:
        _stop(state, north_m, east_m, reading)
    elif state[WAIT] > 0.0:
        state[WAIT] = max(state[WAIT] - ticks, 0.0)
        if state[WAIT] == 0.0:
            if state[PHASE] == DECISION:
                _decide(state, north_m, east_m, reading, step_m, draw_n, draw_e)
            elif state[PHASE] == STEP:
                state[TARGET_N] = state[GOAL_N]
                state[TARGET_E] = state[GOAL_E]
            else:
                _next_waypoint(state, radius_m, step_m)
    elif there:
        state[WAIT] = _NEXT
        if state[PHASE] == STEP:
            state[PHASE] = DECISION
        elif state[ALONG] == 0.0 and state[BACK] == 0.0:
            state[WAIT] = _FROM_CENTRE
        elif state[ALONG] == 0.0:
            state[BACK] = 0.0
            state[BEARING] = next_bearing(state[BEARING])
            state[WAIT] = _NEXT_SPOKE
    return state[TARGET_N], state[TARGET_E]


def _stop(state: FloatArray, north_m: float, east_m: float, reading: float) -> None:
    """First contact: the drone stays where it is, and decides at the next tick."""
    state[TURNED] = 1.0
    state[PHASE] = DECISION
    state[WAIT] = _NEXT
    state[TARGET_N] = north_m
    state[TARGET_E] = east_m
    out_m = max(math.hypot(north_m, east_m), 1e-9)
    state[HEADING_N] = north_m / out_m
    state[HEADING_E] = east_m / out_m
    state[BEFORE] = reading


def _decide(
    state: FloatArray,
    north_m: float,
    east_m: float,
    reading: float,
    step_m: float,
    draw_n: float,
    draw_e: float,
) -> None:
    """The moth's next step, or that it has lost the plume."""
    if reading <= state[BEFORE]:
        state[HEADING_N] = 2.0 * draw_n - 1.0
        state[HEADING_E] = 2.0 * draw_e - 1.0
        if reading == 0.0 and state[BEFORE] == 0.0:
            state[ZEROS] += 1.0
    if state[ZEROS] > _ZEROS:
        state[PHASE] = SPOKES
        state[WAIT] = _OVER
        state[BEARING] = next_bearing(state[BEARING])
        state[ALONG] = -1.0
        state[BACK] = 0.0
        return
    share = step_m / max(math.hypot(state[HEADING_N], state[HEADING_E]), 1e-9)
    state[GOAL_N] = north_m + share * state[HEADING_N]
    state[GOAL_E] = east_m + share * state[HEADING_E]
    state[PHASE] = STEP
    state[WAIT] = _NEXT
    state[BEFORE] = reading


def _next_waypoint(state: FloatArray, radius_m: float, step_m: float) -> None:
    """One step farther out, from the spoke's end one step back."""
    if state[ALONG] < 0.0:
        state[ALONG] = 0.0
    elif state[BACK] > 0.0:
        along_m = state[ALONG] - step_m
        state[ALONG] = along_m if along_m > 1e-9 * radius_m else 0.0
    elif state[ALONG] + step_m < radius_m * (1.0 - 1e-9):
        state[ALONG] += step_m
    else:
        state[ALONG] = radius_m
        state[BACK] = 1.0
    state[TARGET_N] = state[ALONG] * math.cos(state[BEARING])
    state[TARGET_E] = state[ALONG] * math.sin(state[BEARING])


class MobsAuthorsFlight:
    """One drone's way by the rule, tick after tick."""

    def __init__(self, centre_ned_m: Vector3, bearing_rad: float, p: MobsParameters) -> None:
        self._centre = centre_ned_m
        self._p = p
        self._arrival = waypoint_arrival(p)
        self._state = np.zeros(AUTHORS_STATE_SIZE)
        mobs_authors_begin(self._state, bearing_rad)
        self._target = centre_ned_m
        self.arrived = False
        """Whether the newest step compared a reading or arrived at a waypoint."""

    def step(self, elapsed_s: float, own: OwnState, reading: float, rng: np.random.Generator) -> Vector3:
        """The waypoint to fly to. `reading` is what is read now, 0 without contact."""
        there = self._arrival.step(elapsed_s, own.position_ned_m, own.velocity_ned_mps, self._target)
        draws = rng.random(2)
        before = self._state[WAIT]
        north_m, east_m = mobs_authors_next(
            self._state,
            1,
            own.position_ned_m[0] - self._centre[0],
            own.position_ned_m[1] - self._centre[1],
            reading,
            there,
            self._p.radius_m,
            self._p.step_m,
            float(draws[0]),
            float(draws[1]),
        )
        self.arrived = bool(before == 0.0 and self._state[WAIT] > 0.0)
        self._target = (self._centre[0] + float(north_m), self._centre[1] + float(east_m), self._centre[2])
        return self._target


class MobsAuthors(Mobs):
    """`Mobs` with the program's rule."""

    Flight = MobsAuthorsFlight


ENTRY = StrategyEntry(
    name="mobs-authors",
    make=MobsAuthors,
    parameters=MobsParameters,
    rules=(mobs_authors_next,),
    word=MobsWord,
    legs=True,
)
