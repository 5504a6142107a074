"""One agent on one core: time of a step with 20 peers, start-up. Its memory in flight is measured by `fly`.

The inputs are those that one of 20 drones got in a simulated survey, byte for byte; they are then given to a new
agent as fast as it takes them.
"""

from __future__ import annotations

import json
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

from benchmarks import Figures
from flightstack.agent import Agent, Inputs, Outputs
from flightstack.swarm.wire import CommandName
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.launch import write_files
from simvehicle.survey.survey_file import parse_survey

DRONES = 20
WATCHED = 7
FLIGHT_S = 150.0

SURVEY = f"""
name: bench
origin: {{latitude_deg: -5.06, longitude_deg: 151.3, amsl_m: 500.0}}
launch_line: {{count: {DRONES}, spacing_m: 8.0}}
formation: {{layers: 5}}
limits: {{ceiling_above_home_m: 60.0}}
plume: {{type: gaussian, source_north_m: 60.0, source_east_m: 40.0}}
geofence:
  inclusion:
    - [[-5.063, 151.297], [-5.063, 151.303], [-5.057, 151.303], [-5.057, 151.297]]
ready_after_s: 10
"""

PROBE = """
import json, sys, time
began = time.perf_counter()
from flightstack.agent import Agent
from flightstack.config_file import load
import flightstack.runner
agent = Agent(load(sys.argv[1]), incarnation=1)
agent.step(0.0, flightstack.runner.Inputs())  # what is imported late is imported by now
imported = time.perf_counter() - began
print(json.dumps({
    "import_s": imported,
    "compilers": [m for m in ("numba", "matplotlib", "pandas", "mavsdk", "textual") if m in sys.modules],
}))
"""


def main() -> None:
    survey = parse_survey(SURVEY, "bench")
    drafted = draft(survey, in_process(survey))
    config = next(d for d in drafted.drones if d.drone == WATCHED)
    with tempfile.TemporaryDirectory() as name:
        directory = pathlib.Path(name)
        write_files(drafted, directory)
        probe = subprocess.run(
            [sys.executable, "-c", PROBE, str(directory / f"drone-{WATCHED}.yaml")],
            capture_output=True,
            text=True,
            check=True,
        )
    scenario = Scenario(drafted.drones, drafted.fleet)
    ticks: list[tuple[float, Inputs]] = []

    def tap(drone: int, now_s: float, inputs: Inputs, _: Outputs) -> None:
        if drone == WATCHED:
            ticks.append((now_s, inputs))

    scenario.tap = tap
    scenario.run(5.0)
    scenario.command(CommandName.START)
    scenario.run(FLIGHT_S)
    agent = Agent(config, incarnation=WATCHED)
    took_ms = np.empty(len(ticks))
    for index, (now_s, inputs) in enumerate(ticks):
        began = time.thread_time()  # what others do on this machine is not ours to measure
        agent.step(now_s, inputs)
        took_ms[index] = 1000.0 * (time.thread_time() - began)
    facts = json.loads(probe.stdout)
    p50, p99 = np.percentile(took_ms, (50.0, 99.0))
    if facts["compilers"]:
        raise SystemExit(f"imported on board but must not be: {facts['compilers']}")
    print(f"agent step, {DRONES - 1} peers, {len(ticks)} ticks, ended in phase {agent.phase.phase}")
    figures = Figures()
    figures.show("step p50", p50, "ms")
    figures.show("step p99", p99, "ms", most=5.0)
    figures.show("share of one core at 10 Hz", took_ms.mean() * 10.0 / 1000.0 * 100.0, "%")
    figures.show("imports and first step", facts["import_s"], "s")
    figures.leave()


if __name__ == "__main__":
    main()
