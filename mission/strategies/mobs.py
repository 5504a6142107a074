"""MoBS: every drone for itself, on golden-ratio spokes, then like a moth (LoCUS paper, section IV).

The rule is a plain function of numbers and one small array: the agent calls it, the trials compile it.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from mission.geometry.formation import FloatArray, Layout
from mission.geometry.frames import Vector3
from mission.strategies.arrival import Arrival
from mission.strategies.contract import Decision, GoTo, Hold, Observation

GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0
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
            state[ALONG] += step_m
            if state[ALONG] > radius_m * (1.0 + 1e-9):
                state[ALONG] = 0.0
                state[BEARING] = (state[BEARING] + 2.0 * math.pi / GOLDEN) % (2.0 * math.pi)
    if state[MOTH] == 1.0:
        if reading == 0.0 and state[BEFORE] == 0.0:
            state[ZEROS] += 1.0
        else:
            state[ZEROS] = 0.0
        if state[ZEROS] > _ZEROS:
            state[MOTH] = 0.0
            state[ALONG] = 0.0
            state[BEARING] = (state[BEARING] + 2.0 * math.pi / GOLDEN) % (2.0 * math.pi)
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


class Mobs:
    """One independent drone. It gives no orders and no readings, and nothing ends its search but the survey's end."""

    Parameters = MobsParameters

    def __init__(self, layout: Layout, parameters: MobsParameters | None = None) -> None:
        del layout  # independent drones hold no formation once they have formed up
        self._p = parameters or MobsParameters()
        self._arrival = Arrival(
            arrival_m=self._p.arrival_m,
            settle_mps=self._p.settle_mps,
            settle_s=self._p.settle_s,
            blocked_s=self._p.blocked_s,
        )
        self._state = np.zeros(STATE_SIZE)
        self._start: Vector3 | None = None
        self._target: Vector3 | None = None

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision:
        own = observation.own
        if self._start is None:
            if self._p.start_ned_m is None and observation.order is None:
                return Decision(Hold())
            anchor = observation.order.anchor_ned_m if observation.order else own.position_ned_m
            self._start = self._p.start_ned_m or anchor
            # The members share the seed of their randomness: the drone's own number sets the spokes apart.
            first = (rng.random() + own.drone / GOLDEN) % 1.0
            mobs_begin(self._state, 2.0 * math.pi * first)
            self._target = self._start
        start = self._start
        target = self._target or start
        if self._arrival.step(observation.elapsed_s, own.position_ned_m, own.velocity_ned_mps, target):
            co2 = own.excess_co2_ppm
            reading = 0.0
            if co2 is not None and co2.mean > max(
                self._p.detection_ppm, self._p.detection_sigmas * math.sqrt(max(co2.variance, 0.0))
            ):
                reading = co2.mean
            north_m, east_m = mobs_next(
                self._state,
                own.position_ned_m[0] - start[0],
                own.position_ned_m[1] - start[1],
                reading,
                self._p.radius_m,
                self._p.step_m,
                float(rng.random()),
            )
            self._target = (start[0] + north_m, start[1] + east_m, start[2])
            target = self._target
        return Decision(GoTo(target))
