"""The rule of a reactive strategy: what a robot does next from what it senses now, a plain function of numbers.

A rule is called for every robot at every tick:

    rule(own, neighbours, count, ranges_m, state, word, parameters) -> (north_mps, east_mps)

* `own` (`OwnSenses`): where it is, how it moves, what it smells, the wind, the time, one random number.
* `neighbours` (at least `count` rows, 4 + word size): the others within `TickRule.range_m`. A row is the other's
  place and velocity relative to the robot's own (m and m/s; north, east) and then its word; see NORTH ... WORD.
  The order of rows means nothing, and rows from `count` on hold anything.
* `ranges_m` (beams,): distance to what stands around, by bearing: beam k looks 2 pi k / beams from north towards
  east. `inf` where nothing is near.
* `state` (state size,): the robot's own memory, written in place; zeros at first.
* `word` (word size,): what the neighbours hear from the next tick on, written in place; it holds the robot's
  own last word, zeros at first.
* `parameters`: the strategy's parameters as numbers, in the order of their struct.

It gives the velocity that the robot shall have. All is horizontal; whoever flies the robot keeps its height and its
limits of speed and acceleration. No argument is ever NaN, and only `ranges_m` may be infinite.

The agent calls a rule as it is, the trials compile it with numba: it uses numbers, arrays, `math`, and plain
functions that do the same. It must not keep a reference to any of its arrays: they are used again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from mission.geometry.formation import FloatArray

# Places in a row of neighbours; the word begins at WORD.
NORTH, EAST, NORTH_MPS, EAST_MPS, WORD = range(5)


class OwnSenses(NamedTuple):
    """What a robot knows by itself at one tick."""

    north_m: float
    """From where the swarm began."""
    east_m: float
    velocity_north_mps: float
    velocity_east_mps: float
    gas: float
    """Excess of the gas, 0 where there is no contact. In flight ppm, in trials a share of the plume's maximum: a
    rule compares readings, or takes a level from its parameters."""
    wind_north_mps: float
    """Where the air goes; 0 both when it is calm and when the wind is not known."""
    wind_east_mps: float
    elapsed_s: float
    """Since the swarm began."""
    interval_s: float
    """Since the tick before."""
    draw: float
    """Uniform in [0, 1), new for every robot and tick."""


Rule = Callable[
    [OwnSenses, FloatArray, int, FloatArray, FloatArray, FloatArray, FloatArray], tuple[float, float]
]


class TickRule(msgspec.Struct, frozen=True, kw_only=True):
    """A rule and the sizes of what it is given."""

    rule: Rule
    parameters: type[msgspec.Struct]
    """Numbers only, each with a default."""
    range_m: float
    """Neighbours farther away are not shown."""
    state_size: int = 0
    word_size: int = 0
    beams: int = 0
    """Length of `ranges_m`."""

    def __post_init__(self) -> None:
        if not 0.0 < self.range_m < np.inf:
            raise ValueError(f"a rule's range must be above 0 m, not {self.range_m:g}")
        if min(self.state_size, self.word_size, self.beams) < 0:
            raise ValueError("sizes of a rule's arrays are 0 or more")
        numbers(self.parameters())


def numbers(parameters: msgspec.Struct) -> FloatArray:
    """Parameters as a rule takes them. `TypeError` names the one that is no number."""
    values = msgspec.structs.asdict(parameters)
    for name, value in values.items():
        if not isinstance(value, (int, float)):
            raise TypeError(f"parameter {name} of a rule must be a number, not {value!r}")
    return np.array([float(value) for value in values.values()])
