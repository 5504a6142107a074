"""Virtual-force plume tracking: robots drawn up the gas gradient and the wind, and to each other by what they smell.

A. Marjovi, L. Marques: "Swarm robotic plume tracking for intermittent and time-variant odor dispersion", ECMR 2013.
The force on robot i is `F_i = G_i + F_i^co + F_i^obs` (equation 9); the velocity is the force, cut at `speed_mps`.

What departs from the printed paper, and why:

* The signs of equation (5) are reversed against the paper's own text; here who is far attracts, who is near repels.
* A neighbour that smells nothing has weight 0 by equation (6), and would be run into: it repels with weight 1.
* Raw concentrations make the gradient vanish beside the wind. Here they are shares of the largest that the swarm has
  reported: `(C - C0) / (Cmax - C0)`, cut to [0, 1], and `k1` and `k2` are of such shares.
* Forces grow without bound as a distance goes to 0: below `least_m` it counts as `least_m`.

The defaults are for drones. They are the paper's large arena (R1 2.2 m, R2 3.3 m, range 6 m, 0.5 m/s in a wind of
0.5 m/s; k1 50, k2 20, mu and c1 1) with lengths times 40/11, so that R1 is 8 m, speeds times 4 and the wind's speed
times 10: k1 grows with length and speed, k2 with speed over wind, mu and c1 with length squared and speed. Only mu1
is fifty times what would follow: the paper's robots draw as near as a tenth of R1, drones half of it.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from mission.geometry.formation import FloatArray
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import EAST, NORTH, WORD, OwnSenses, TickRule

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e6)]

BEAMS = 8
RANGE_M = 60.0
"""No `range_m` of a parameter reaches farther."""

# Places in a robot's word: what it smells on average, and the largest such average that it knows of.
MEAN, LARGEST, WORD_SIZE = range(3)
_MOST = 1e6
"""Pure gas in ppm, and no concentration in another unit in use is larger: who tells of one is not believed."""


class UpwindParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What both strategies have."""

    speed_mps: Positive = 2.0
    upwind: NotNegative = 8.0
    """k2: speed against the wind per speed of the wind."""
    repulsion_m3ps: NotNegative = 2650.0
    """mu1: speed times the square of the distance."""
    obstacle_m3ps: NotNegative = 53.0
    """c1: the same from a beam that meets something."""
    near_m: Positive = 8.0
    """R1: who is nearer repels."""
    sight_m: Positive = 8.0
    """How far the range sensors see."""
    least_m: Positive = 0.1
    """Shorter distances count as this."""


class VirtualForcesParameters(UpwindParameters, frozen=True, forbid_unknown_fields=True, kw_only=True):
    gradient_m2ps: NotNegative = 727.0
    """k1: speed per share of the largest concentration and metre."""
    attraction_m3ps: NotNegative = 53.0
    """mu2: speed times the square of the distance."""
    weight: NotNegative = 1.0
    """beta of every neighbour: how strongly those attract that smell something."""
    far_m: Positive = 12.0
    """R2: who is farther attracts."""
    range_m: Annotated[float, Meta(gt=0.0, le=RANGE_M)] = 22.0
    """How far robots hear each other."""
    clean_air: NotNegative = 0.0
    """C0: what a sensor reads in clean air, in the unit of the gas."""
    filter_s: Positive = 3.0
    """Time constant of the low-pass of each robot's readings."""

    def __post_init__(self) -> None:
        if not self.near_m < self.far_m < self.range_m:
            raise ValueError(
                f"near_m ({self.near_m:g}) < far_m ({self.far_m:g}) < range_m ({self.range_m:g}) must hold"
            )


# Places in the numbers of the parameters: the order of their structs' fields.
SPEED, UPWIND, REPULSION, OBSTACLE, NEAR, SIGHT, LEAST = range(7)
GRADIENT, ATTRACTION, WEIGHT, FAR, RANGE, CLEAN_AIR, FILTER = range(LEAST + 1, LEAST + 8)


def saturated(north: float, east: float, most: float) -> tuple[float, float]:
    """The vector, shortened to `most` where it is longer."""
    size = math.hypot(north, east)
    if size > most:
        return north * (most / size), east * (most / size)
    return north, east


def away_from_obstacles(ranges_m: FloatArray, parameters: FloatArray) -> tuple[float, float]:
    """Equation (8) with n = 2: the sum over the beams that see something."""
    north, east = 0.0, 0.0
    beams = ranges_m.shape[0]
    for k in range(beams):
        if ranges_m[k] <= parameters[SIGHT]:
            away_m = max(ranges_m[k], parameters[LEAST])
            push = parameters[OBSTACLE] / (away_m * away_m)
            north -= push * math.cos(2.0 * math.pi * k / beams)
            east -= push * math.sin(2.0 * math.pi * k / beams)
    return north, east


def wind_and_obstacles(own: OwnSenses, ranges_m: FloatArray, parameters: FloatArray) -> tuple[float, float]:
    """The force against the wind, and off what stands around."""
    north, east = away_from_obstacles(ranges_m, parameters)
    return (
        north - parameters[UPWIND] * own.wind_north_mps,
        east - parameters[UPWIND] * own.wind_east_mps,
    )


def share(concentration: float, clean_air: float, largest: float) -> float:
    """A concentration as a share of the largest, both over clean air, in [0, 1]; 0 while all the air is clean."""
    if not largest > clean_air:
        return 0.0
    return min(max((concentration - clean_air) / (largest - clean_air), 0.0), 1.0)


def upwind(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,  # noqa: ARG001
    word: FloatArray,  # noqa: ARG001
    parameters: FloatArray,
) -> tuple[float, float]:
    """The baseline: against the wind whatever it smells, off obstacles and off its neighbours."""
    north, east = wind_and_obstacles(own, ranges_m, parameters)
    for k in range(count):
        away_m = math.hypot(neighbours[k, NORTH], neighbours[k, EAST])
        if 0.0 < away_m < parameters[NEAR]:
            push = parameters[REPULSION] / max(away_m, parameters[LEAST]) ** 2
            north -= push * (neighbours[k, NORTH] / away_m)
            east -= push * (neighbours[k, EAST] / away_m)
    return saturated(north, east, parameters[SPEED])


def virtual_forces(
    own: OwnSenses,
    neighbours: FloatArray,
    count: int,
    ranges_m: FloatArray,
    state: FloatArray,  # noqa: ARG001
    word: FloatArray,
    parameters: FloatArray,
) -> tuple[float, float]:
    """Equations (1) to (9). The word, which is the robot's memory too, carries its average and the largest known."""
    blend = -math.expm1(-own.interval_s / parameters[FILTER])
    mean = word[MEAN] + blend * (own.gas - word[MEAN])
    largest = max(word[LARGEST], mean)
    for k in range(count):
        if neighbours[k, WORD + LARGEST] <= _MOST:
            largest = max(largest, neighbours[k, WORD + LARGEST])
    word[MEAN], word[LARGEST] = mean, largest
    clean_air = parameters[CLEAN_AIR]
    mine = share(mean, clean_air, largest)
    north, east = wind_and_obstacles(own, ranges_m, parameters)
    for k in range(count):
        away_m = math.hypot(neighbours[k, NORTH], neighbours[k, EAST])
        if not 0.0 < away_m <= parameters[RANGE]:
            continue  # in the same place there is no direction
        counted_m = max(away_m, parameters[LEAST])
        theirs = share(neighbours[k, WORD + MEAN], clean_air, largest)
        pull = parameters[GRADIENT] * (theirs - mine) / counted_m
        if away_m < parameters[NEAR]:
            pull -= parameters[REPULSION] / (counted_m * counted_m)
        elif away_m > parameters[FAR]:
            weight = parameters[WEIGHT]
            if largest > clean_air:
                weight *= theirs
            pull += parameters[ATTRACTION] * min(weight, 1.0) / (counted_m * counted_m)
        north += pull * (neighbours[k, NORTH] / away_m)
        east += pull * (neighbours[k, EAST] / away_m)
    return saturated(north, east, parameters[SPEED])


UPWIND_ENTRY = reactive_strategy(
    "upwind", TickRule(rule=upwind, parameters=UpwindParameters, range_m=RANGE_M, beams=BEAMS)
)
ENTRY = reactive_strategy(
    "virtual-forces",
    TickRule(
        rule=virtual_forces,
        parameters=VirtualForcesParameters,
        range_m=RANGE_M,
        word_size=WORD_SIZE,
        beams=BEAMS,
    ),
)
