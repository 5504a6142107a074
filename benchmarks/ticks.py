"""What reactive swarms cost in tick mode: robot-steps a second of processor time, one trial and 100 trials a call.

A robot-step is one robot's tick: gas sampled, neighbours searched, the rule called, the robot moved. The rule is
trivial (a random walk about the launch point), so that it is the engine that is measured.
"""

from __future__ import annotations

import time

import msgspec
import numpy as np

from benchmarks import Figures
from mission.geometry.formation import FloatArray
from mission.strategies.tick_rule import OwnSenses, TickRule, numbers
from simvehicle.trials.cell import Cell
from simvehicle.trials.flight import NOW
from simvehicle.trials.outcome import kernel_setup
from simvehicle.trials.ticks.flying import TICK_RESULTS, Sizes, swarm_numbers, tick_kernel

_ONE_PER_S = 1e7
_BATCH_PER_S = 5e7
_BATCH = 100
_SIZES = (7, 20, 50, 100, 200, 500, 1000)
_ROBOTS = 20
_STEPS = 2e7
"""Robot-steps of one measurement: of 100 trials, each has 10,000 ticks."""


class WalkParameters(msgspec.Struct, frozen=True):
    turn: float = 0.6
    home_per_s: float = 0.002


def walk(
    own: OwnSenses,
    neighbours: FloatArray,  # noqa: ARG001 (one signature for all rules)
    count: int,
    ranges_m: FloatArray,  # noqa: ARG001
    state: FloatArray,
    word: FloatArray,  # noqa: ARG001
    parameters: FloatArray,
) -> tuple[float, float]:
    """A random walk that is drawn home, and counts the neighbours that it is shown."""
    turn = parameters[0] * (own.draw - 0.5)
    state[0] += count
    return (
        own.velocity_north_mps - turn * own.velocity_east_mps - parameters[1] * own.north_m + turn,
        own.velocity_east_mps + turn * own.velocity_north_mps - parameters[1] * own.east_m - turn,
    )


_RULE = TickRule(rule=walk, parameters=WalkParameters, range_m=10.0, state_size=1)


def per_s(robots: int, trials: int, repeats: int = 5) -> float:
    """Robot-steps a second of processor time, the best of `repeats` calls; the swarm is equally dense.

    The best, since whatever else runs on the processor only takes away.
    """
    cell = Cell(strategy="mobs", drones=robots, arena_m=1000.0, source=(900.0, 0.0))
    setup = kernel_setup(cell)
    home_per_s = WalkParameters().home_per_s * _ROBOTS / robots
    ticks = round(_STEPS / robots / trials)

    def call(limit: int) -> int:
        results = np.zeros((trials, TICK_RESULTS), np.int64)
        tick_kernel(walk)(
            setup.scene,
            setup.setup,
            swarm_numbers(_RULE, 5.0, 2.0),
            numbers(WalkParameters(home_per_s=home_per_s)),
            Sizes(robots, 1, 0, 0),
            1,
            0,
            limit,
            results,
            np.zeros((trials, 2)),
            np.zeros((0, robots, 2)),
            1,
        )
        return int(results[:, NOW].sum()) * robots

    call(1)
    rates = []
    for _ in range(repeats):
        began_s = time.process_time()
        steps = call(ticks)
        rates.append(steps / (time.process_time() - began_s))
    return max(rates)


def main() -> None:
    batch_ticks = round(_STEPS / _ROBOTS / _BATCH)
    print("20 robots at random some 40 m about the launch point, one core: 0.5 neighbours within 10 m each;")
    print(f"1.0 in trials of {batch_ticks} ticks, which begin crowded in a square of 16 m.")
    one, batch = per_s(_ROBOTS, 1), per_s(_ROBOTS, _BATCH)
    print("   robot-steps/s by robots (as dense; one trial): ", end="")
    print(", ".join(f"{size}: {per_s(size, 1, 1):.2g}" for size in _SIZES))
    figures = Figures()
    figures.show("robot-steps a second, one trial", one / 1e6, "M/s", least=_ONE_PER_S / 1e6)
    figures.show(
        f"robot-steps a second, {_BATCH} trials a call", batch / 1e6, "M/s", least=_BATCH_PER_S / 1e6
    )
    figures.leave()


if __name__ == "__main__":
    main()
