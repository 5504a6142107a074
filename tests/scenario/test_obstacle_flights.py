"""Whole agents among obstacles, known and unknown: nobody touches one, and the survey ends where it should."""

from __future__ import annotations

import math
import pathlib

import pytest

from flightstack.agent import Agent, Inputs, Outputs
from flightstack.recording.fingerprint import fingerprint
from flightstack.swarm.wire import CommandName, Phase
from mission.geometry.geofence import LocalFence
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import Survey, load, parse_survey

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"
SURVEY = """
name: among-rocks
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 2, spacing_m: 8.0, towards_deg: 0.0}
formation: {spacing_m: 10.0, radio_range_m: 80.0}
strategy: {name: locus, parameters: {step_m: 4.0, search_radius_m: 60.0}}
wind: {speed_mps: 3.0, from_deg: 270.0}
plume: {type: gaussian, source_north_m: 0.0, source_east_m: -45.0, vent_sd_m: 4.0, emission_kgps: 2.5}
range_finder: {}
obstacles:
- {type: rectangle, centre_north_m: 2, centre_east_m: -22, length_north_m: 10, length_east_m: 6, unknown: true}
- {type: rectangle, centre_north_m: 16, centre_east_m: -34, length_north_m: 8, length_east_m: 8, top_above_home_m: 20}
ready_after_s: 8
seed: 2
"""


def begun(survey: Survey, wait_s: float) -> Scenario:
    parts = draft(survey, in_process(survey))
    flight = Scenario(parts.drones, parts.fleet)
    flight.run(wait_s)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.first_takeoff_s is not None, 90.0)
    return flight


def landed(flight: Scenario) -> bool:
    return all(m.agent.phase.phase is Phase.LANDED for m in flight.members.values() if m.alive)


def assert_found(flight: Scenario, within_m: float, clear_m: float, limit_s: float) -> None:
    assert flight.run_until(lambda: landed(flight), limit_s), flight.phases()
    assert flight.source_ned_m is not None
    assert math.dist(flight.source_ned_m[:2], flight.world.gas.source_ned_m[:2]) < within_m
    assert flight.min_separation_m > 4.0
    assert flight.min_clearance_m > clear_m


def test_a_rock_that_nobody_knew_is_seen_and_gone_around_and_the_flight_replays() -> None:
    survey = parse_survey(SURVEY, "among-rocks")
    parts = draft(survey, in_process(survey))
    assert [len(config.obstacles) for config in parts.drones] == [1, 1]
    heard: list[tuple[float, Inputs, int]] = []

    def tap(drone: int, now_s: float, inputs: Inputs, outputs: Outputs) -> None:
        if drone == 1:
            heard.append((now_s, inputs, fingerprint(outputs)))

    flight = Scenario(parts.drones, parts.fleet)
    flight.tap = tap
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.first_takeoff_s is not None, 90.0)
    assert_found(flight, 5.0, 2.0, 600.0)
    again = Agent(parts.drones[0], incarnation=1)
    assert all(fingerprint(again.step(now_s, inputs)) == said for now_s, inputs, said in heard)


@pytest.mark.parametrize("killed", [None, 3])
@pytest.mark.parametrize("name", ["fluxotaxis", "virtual_forces", "infotaxis"])
@pytest.mark.long
def test_tracing_swarms_find_the_vent_between_rocks(name: str, killed: int | None) -> None:
    """The surveys of `examples/` as they stand there, whole and with an agent that dies on the way."""
    survey = load(EXAMPLES / f"survey_{name}.yaml")
    assert survey.warnings == ()
    assert survey.geofence is not None
    flight = begun(survey, 45.0)
    fence = LocalFence(flight.world.frame, survey.geofence)
    least_m = math.inf

    def tap(_drone: int, _now_s: float, _inputs: Inputs, _outputs: Outputs) -> None:
        nonlocal least_m
        for member in flight.members.values():
            least_m = min(least_m, fence.clearance_m(*member.vehicle.position_ned_m[:2]))

    flight.tap = tap
    if killed is not None:
        flight.run(70.0)
        flight.kill(killed)
    assert_found(flight, 15.0, 1.5, 1500.0)
    assert least_m > 0.0
