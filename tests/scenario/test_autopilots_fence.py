"""A fence of the autopilot's own: no survey starts against it, and nobody slides along it without a word."""

from __future__ import annotations

import pytest

from flightstack.swarm.wire import CommandName, Phase, Severity
from simvehicle.scenario.swarm import Scenario
from tests.scenario.test_survey_flights import drafted


def on_the_ground(flavour: str = "ardupilot", count: int = 3, **parameters: float) -> Scenario:
    """Agents and vehicles whose autopilots hold these parameters, two seconds after they were switched on."""
    parts = drafted(count, flavour, 2)
    flight = Scenario(parts.drones, parts.fleet)
    for member in flight.members.values():
        for name, value in parameters.items():
            member.vehicle.autopilot.parameters.set(name, value)
    flight.run(2.0)
    return flight


def told(flight: Scenario, code: str) -> list[tuple[int, str]]:
    return [(event.sender, event.text) for _, event in flight.events if event.code == code]


@pytest.mark.parametrize(
    ("flavour", "parameters", "says"),
    [
        (
            "ardupilot",
            {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 2.0, "FENCE_RADIUS": 30.0},
            "FENCE_RADIUS 30 m around home, AVOID_ENABLE holds 2 m before it",
        ),
        (
            "ardupilot",
            {"FENCE_AUTOENABLE": 3.0, "FENCE_TYPE": 1.0, "FENCE_ALT_MAX": 20.0},
            "FENCE_ALT_MAX 20 m",
        ),
        ("px4", {"GF_ACTION": 3.0, "GF_MAX_HOR_DIST": 30.0}, "GF_MAX_HOR_DIST 30 m around home"),
        ("px4", {"GF_ACTION": 3.0, "GF_MAX_VER_DIST": 15.0}, "GF_MAX_VER_DIST 15 m"),
    ],
)
def test_no_survey_starts_against_a_fence_that_is_tighter(
    flavour: str, parameters: dict[str, float], says: str
) -> None:
    flight = on_the_ground(flavour, **parameters)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: len(told(flight, "arming")) == 3, 30.0)
    assert all(says in text for _, text in told(flight, "arming"))
    assert flight.phases() == {Phase.DISARMED}
    assert flight.first_takeoff_s is None


@pytest.mark.parametrize(
    "parameters",
    [
        {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 7.0},  # with the stock circle of 300 m and ceiling of 100 m
        {"FENCE_ENABLE": 0.0, "FENCE_TYPE": 2.0, "FENCE_RADIUS": 30.0},
    ],
    ids=["wide", "off"],
)
def test_one_that_is_wide_enough_or_off_is_in_nobodys_way(parameters: dict[str, float]) -> None:
    flight = on_the_ground(**parameters)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.phases() == {Phase.SEARCHING}, 60.0)
    assert told(flight, "arming") == []


def test_a_fence_that_is_turned_on_in_the_air_is_noticed_within_seconds() -> None:
    flight = on_the_ground()
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.phases() <= {Phase.SEARCHING, Phase.TRACKING}, 60.0)
    victim = 2
    parameters = flight.members[victim].vehicle.autopilot.parameters
    for name, value in {"FENCE_TYPE": 2.0, "FENCE_RADIUS": 30.0, "FENCE_ENABLE": 1.0}.items():
        parameters.set(name, value)
    assert flight.run_until(lambda: bool(told(flight, "astray")), 200.0)
    flight.run(0.5)
    ((sender, text),) = told(flight, "astray")
    assert (sender, flight.states[victim].astray) == (victim, text)
    assert text.startswith("does not go where it is sent: asked for ")
    assert {e.severity for _, e in flight.events if e.code == "astray"} == {Severity.WARNING}
    parameters.set("FENCE_ENABLE", 0.0)
    assert flight.run_until(lambda: len(told(flight, "astray")) == 2, 60.0)
    assert told(flight, "astray")[-1] == (victim, "goes where it is sent again")
    flight.run(0.5)  # its next state
    assert flight.states[victim].astray == ""
