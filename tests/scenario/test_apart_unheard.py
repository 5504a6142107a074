"""Whoever comes home without hearing the others keeps apart: parted swarms, and agents that froze."""

from __future__ import annotations

import pytest

from simvehicle.scenario.agent_level import fly_scenario
from simvehicle.scenario.scenario_file import parse_scenario

FLIGHT = """
name: apart
origin: {{latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}}
launch_line: {{count: {count}, flavour: {flavour}, spacing_m: 6.0, towards_deg: 50.0}}
formation: {{spacing_m: 10.0, radio_range_m: 80.0}}
limits: {{ceiling_above_home_m: 120.0}}
strategy: {{name: locus, parameters: {{step_m: 4.0, search_radius_m: 20.0}}}}
ready_after_s: 3.0
ground_brings_home: {ground}
swarm_faults: [{faults}]
"""


def violations(count: int, flavour: str, faults: str, *, ground: bool = True) -> list[str]:
    text = FLIGHT.format(count=count, flavour=flavour, faults=faults, ground=str(ground).lower())
    return [violation.text for violation in fly_scenario(parse_scenario(text, "apart.yaml")).violations]


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_an_agent_that_froze_over_anothers_home_comes_down_among_those_who_go_home(flavour: str) -> None:
    """Its slot was over the home of one that the ground station had just sent home: they came as near as 3.1 m."""
    faults = "{kind: freeze, drone: 2, at_s: 10.0}, {kind: command, command: abort, at_s: 20.0}"
    assert violations(3, flavour, faults) == []


@pytest.mark.parametrize(
    "parts", ["[[1, 2, 3], [4, 5]]", "[[1], [2], [3], [4], [5]]"], ids=["two", "each-alone"]
)
@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_swarm_that_comes_apart_over_its_launch_points_comes_home_apart(flavour: str, parts: str) -> None:
    """Some come home, deaf, to where the others search; later these come home, too, without the ground station."""
    faults = f"{{kind: partition, parts: {parts}, at_s: 25.0}}, {{kind: ground_gone, at_s: 25.0}}"
    if flavour == "px4":  # an ArduPilot without an agent would hover until its battery is empty
        faults += ", {kind: kill, drone: 2, at_s: 27.0}"
    assert violations(5, flavour, faults, ground=False) == []
