"""A reactive swarm ends its survey: whole agents declare the source, also when the root is lost on the way."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from flightstack.swarm.wire import CommandName, Phase
from mission.strategies import registry
from mission.strategies.contract import Stage
from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import OwnSenses, TickRule
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import parse_survey

SURVEY = """
name: weaving
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 3, spacing_m: 10.0, towards_deg: 90.0}
formation: {spacing_m: 10.0, radio_range_m: 100.0}
limits: {ceiling_above_home_m: 60.0}
strategy: {name: weave, parameters: {upwind_mps: 0.7, declared_sd_m: 4.0}}
wind: {speed_mps: 3.0, from_deg: 0.0}
plume: {type: gaussian, source_north_m: 45.0, source_east_m: 3.0, vent_sd_m: 4.0, emission_kgps: 2.5}
ready_after_s: 8
seed: 4
"""


class WeaveParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    upwind_mps: float = 1.0


def weave(
    own: OwnSenses, neighbours: Any, count: int, ranges_m: Any, state: Any, word: Any, parameters: Any
) -> tuple[float, float]:
    """North, from side to side: whatever it smells."""
    return parameters[0], 2.0 * math.cos(own.elapsed_s / 6.0)


def test_a_new_root_declares_the_source_and_says_how_well_it_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    entry = reactive_strategy("weave", TickRule(rule=weave, parameters=WeaveParameters, range_m=15.0))
    monkeypatch.setitem(registry.BUILT_IN, "weave", entry)
    survey = parse_survey(SURVEY, "weaving")
    parts = draft(survey, in_process(survey))
    flight = Scenario(parts.drones, parts.fleet)
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.phases() == {Phase.TRACKING}, 200.0), flight.phases()
    root = next(drone for drone, slot in flight.tables[1].held.items() if slot == 0)
    flight.kill(root)
    assert flight.run_until(lambda: flight.source_ned_m is not None, 200.0)
    flight.run(1.5)
    (order,) = {told.order for drone, told in flight.orders.items() if drone != root}
    assert order.stage is Stage.FOUND
    assert order.source_ned_m is not None
    assert order.source_sd_m is not None
    assert 5.0 <= order.source_sd_m <= math.hypot(4.0, 5.0)
    error_m = math.dist(order.source_ned_m[:2], flight.world.gas.source_ned_m[:2])
    assert error_m <= 2.0 * order.source_sd_m
    told = [event.text for _, event in flight.events if event.code == "found"]
    assert told
    assert all(f"known to {order.source_sd_m:.1f} m (standard deviation)" in text for text in told)
    assert flight.run_until(lambda: flight.phases() <= {Phase.LANDED}, 200.0), flight.phases()
    assert flight.min_separation_m > 4.0
