"""The state of a swarm in tick mode: one array a quantity, one entry or row a robot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray, IntArray
from mission.strategies.tick_rule import WORD
from simvehicle.compiled import kernel

BitArray = NDArray[np.uint64]


class Robots(NamedTuple):
    """All of it is allocated once for many trials: nothing is allocated at a tick."""

    north_m: FloatArray
    east_m: FloatArray
    north_mps: FloatArray
    east_mps: FloatArray
    wanted_north_mps: FloatArray
    """What the rule gave at this tick."""
    wanted_east_mps: FloatArray
    gas: FloatArray
    """The reading where the robot is now."""
    alive: IntArray
    fails: IntArray
    """The tick at which a robot fails of itself."""
    limits: FloatArray
    """It fails in the plume when its chance to have survived so far falls below this."""
    survival: FloatArray
    """That chance."""
    draws: BitArray
    """Each robot's own stream of random numbers."""
    state: FloatArray
    """(n, state size) the rule's memory."""
    heard: FloatArray
    """(n, word size) the words that neighbours hear at this tick."""
    said: FloatArray
    """(n, word size) the words that are written at this tick."""
    rows: FloatArray
    """(n, WORD + word size) scratch: the neighbours that the rule is shown."""


@kernel
def new_robots(count: int, state_size: int, word_size: int) -> Robots:
    return Robots(
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.ones(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count),
        np.ones(count),
        np.zeros(count, np.uint64),
        np.zeros((count, state_size)),
        np.zeros((count, word_size)),
        np.zeros((count, word_size)),
        np.zeros((count, WORD + word_size)),
    )
