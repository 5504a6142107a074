"""The surveys of `examples/` that fly other strategies than LoCUS, whole agents and bytes, to their end."""

from __future__ import annotations

import math
import pathlib

import pytest

from flightstack.swarm.wire import CommandName, Phase
from mission.strategies.contract import Stage
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import load

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"


def begun(name: str) -> Scenario:
    """A survey of `examples/` in the air."""
    survey = load(EXAMPLES / f"{name}.yaml")
    drafted = draft(survey, in_process(survey))
    flight = Scenario(drafted.drones, drafted.fleet)
    flight.run(30.0)  # autopilots are heard; instruments and position estimates are ready
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.first_takeoff_s is not None, 60.0)
    return flight


def assert_ends(flight: Scenario, within_m: float) -> None:
    """Everybody lands, the source is told to within `within_m`, nobody came too near to another."""
    assert flight.run_until(lambda: flight.phases() <= {Phase.LANDED}, 1400.0), flight.phases()
    assert flight.source_ned_m is not None
    assert math.dist(flight.source_ned_m[:2], flight.world.gas.source_ned_m[:2]) < within_m
    assert flight.min_separation_m > 4.0


def test_hybrid_drones_part_gather_around_the_caller_and_find_the_source() -> None:
    flight = begun("survey_hybrid")
    stages: list[Stage] = []

    def gathered() -> bool:
        order = flight.orders[1].order if 1 in flight.orders else None
        if order is not None and (not stages or stages[-1] is not order.stage):
            stages.append(order.stage)
        return Stage.TRACK in stages

    assert flight.run_until(gathered, 600.0)
    assert stages == [Stage.FORM, Stage.SEARCH, Stage.FORM, Stage.TRACK]
    assert_ends(flight, 5.0)


def test_a_sub_swarm_finds_the_source_and_a_lost_member_moves_nobody_to_a_slot() -> None:
    """The first drone of the second sub-swarm is lost: the tree heals, its sub-swarm goes on, no heir flies."""
    flight = begun("survey_multi")

    def parted() -> bool:
        return 1 in flight.orders and flight.orders[1].order.apart

    assert flight.run_until(parted, 120.0)
    flight.run(20.0)
    flight.kill(4)
    assert flight.run_until(lambda: 4 not in flight.tables[1].held, 15.0)
    flight.run(2.0)
    assert not any(state.healing for drone, state in flight.states.items() if drone != 4)
    assert_ends(flight, 5.0)


def test_mobs_drones_end_where_the_best_reading_stood_longest() -> None:
    assert_ends(begun("survey_mobs"), 25.0)


@pytest.mark.parametrize(
    ("name", "strategy"),
    [
        ("survey", "locus"),
        ("survey_hybrid", "locus-hybrid"),
        ("survey_multi", "locus-multi"),
        ("survey_mobs", "mobs"),
        ("survey_fluxotaxis", "fluxotaxis"),
        ("survey_virtual_forces", "virtual-forces"),
        ("survey_infotaxis", "cooperative-infotaxis"),
    ],
)
def test_every_example_is_a_survey_that_can_be_planned(name: str, strategy: str) -> None:
    survey = load(EXAMPLES / f"{name}.yaml")
    assert survey.warnings == ()
    drafted = draft(survey, in_process(survey))
    assert {config.strategy.name for config in drafted.drones} == {strategy}
