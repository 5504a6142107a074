"""Randomness of a trial: a pure function of (seed, trial, stream), the same whatever the strategy.

Every kind of chance has a stream of its own, so that trial k of one seed has the same plume, the same start and the
same failures for every strategy and swarm size, however many numbers the strategy itself draws. The generator is
splitmix64 (Steele, Lea, Flood 2014), started from a hash of the three numbers.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simvehicle.compiled import compiled

Stream = NDArray[np.uint64]
"""One number: the generator's state."""

# Streams. Those of single drones are counted from the base.
WORLD, DECISIONS, START, GENERIC, IN_PLUME, OWN, SENSOR = 1, 2, 1000, 2000, 3000, 4000, 5000

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@compiled
def _mixed(z: np.uint64) -> np.uint64:
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@compiled
def open_stream(stream: Stream, seed: int, trial: int, kind: int) -> None:
    """Set `stream` to the beginning of the stream `kind` of this trial."""
    state = _mixed(np.uint64(seed) + _GOLDEN)
    state = _mixed((state ^ np.uint64(trial)) + _GOLDEN)
    stream[0] = _mixed((state ^ np.uint64(kind)) + _GOLDEN)


@compiled
def uniform(stream: Stream) -> float:
    """The next number of the stream, in [0, 1)."""
    stream[0] += _GOLDEN
    return float(_mixed(stream[0]) >> _S11) * (1.0 / 9007199254740992.0)


@compiled
def uniform_at(streams: Stream, place: int) -> float:
    """`uniform` of the stream that stands at `place` of many."""
    streams[place] += _GOLDEN
    return float(_mixed(streams[place]) >> _S11) * (1.0 / 9007199254740992.0)


@compiled
def geometric_tick(draw: float, probability: float) -> int:
    """The tick (from 1) at which something of `probability` a tick happens first, for a uniform `draw`."""
    if probability <= 0.0:
        return 1 << 62
    if probability >= 1.0:
        return 1
    ticks = math.floor(math.log1p(-draw) / math.log1p(-probability)) + 1.0
    return int(ticks) if ticks < 1e18 else 1 << 62


@compiled
def survival_limit(draw: float) -> float:
    """A drone with this uniform `draw` fails when its chance to have survived so far falls below this.

    Drawing once and multiplying up is the same as drawing at every tick with that tick's probability (inverse
    transform), and pairs the trials: the same drone is the unlucky one at every failure rate.
    """
    return 1.0 - draw
