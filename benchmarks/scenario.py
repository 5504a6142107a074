"""A whole survey in one process: processor time a drone-second, of all and of the agents in it.

`examples/survey.yaml` from power-up to the last landing, without faults, on simulated time. The agents' part is
what a companion computer spends on the same flight; the rest is the world's: vehicles, instruments, radio.
"""

from __future__ import annotations

import pathlib
import time

from benchmarks import Figures
from flightstack.agent import Inputs, Outputs
from flightstack.swarm.wire import CommandName, Phase
from simvehicle.scenario.swarm import Member, Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import load

SURVEY = pathlib.Path(__file__).parent.parent / "examples" / "survey.yaml"
LONGEST_S = 1500.0


class TimedAgents:
    """Processor time that the agents' steps took, seconds."""

    def __init__(self, members: list[Member]) -> None:
        self.took_s = 0.0
        for member in members:
            self._time(member)

    def _time(self, member: Member) -> None:
        step = member.agent.step

        def timed(now_s: float, inputs: Inputs) -> Outputs:
            began_s = time.process_time()
            outputs = step(now_s, inputs)
            self.took_s += time.process_time() - began_s
            return outputs

        member.agent.step = timed  # type: ignore[method-assign]


def main() -> None:
    survey = load(SURVEY)
    drafted = draft(survey, in_process(survey))
    scenario = Scenario(drafted.drones, drafted.fleet)
    agents = TimedAgents(list(scenario.members.values()))
    began_s = time.process_time()  # what others do on this machine is not ours to measure
    scenario.run(5.0)
    scenario.command(CommandName.START)
    scenario.run_until(lambda: scenario.first_takeoff_s is not None, LONGEST_S)
    landed = scenario.run_until(lambda: scenario.phases() <= {Phase.LANDED}, LONGEST_S)
    took_s = time.process_time() - began_s
    if not landed or scenario.source_ned_m is None:
        raise SystemExit(f"the survey did not end well: {scenario.phases()}, source {scenario.source_ned_m}")
    drone_seconds = len(scenario.members) * scenario.now_s
    print(f"{len(scenario.members)} drones, source found, all landed after {scenario.now_s:.0f} s")
    figures = Figures()
    figures.show("processor time a drone-second", 1000.0 * took_s / drone_seconds, "ms", most=5.0)
    figures.show("of it the agents", 1000.0 * agents.took_s / drone_seconds, "ms")
    figures.show(
        "of it vehicles, instruments, radio", 1000.0 * (took_s - agents.took_s) / drone_seconds, "ms"
    )
    figures.show("faster than real time, one process", scenario.now_s / took_s, "times")
    figures.leave()


if __name__ == "__main__":
    main()
