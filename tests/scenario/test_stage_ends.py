"""No stage of a flight goes on for ever: what takes too long ends at home, for a swarm by its root's order."""

from __future__ import annotations

import pytest

from flightstack.flight.transitions import STEERING
from flightstack.swarm.wire import CommandName, Phase
from mission.strategies.contract import Stage
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import parse_survey
from tests.scenario.test_survey_flights import SURVEY, all_landed


def begun(stages: str, *, emission_kgps: float = 2.5, flavour: str = "ardupilot", seed: int = 1) -> Scenario:
    """A flight of five drones that has begun, with these `limits.stages`."""
    text = SURVEY.replace("COUNT", "5").replace("FLAVOUR", flavour).replace("SEED", str(seed))
    text = text.replace("limits: {", f"limits: {{stages: {{{stages}}}, ")
    text = text.replace("emission_kgps: 2.5", f"emission_kgps: {emission_kgps}")
    survey = parse_survey(text, "stages")
    parts = draft(survey, in_process(survey))
    flight = Scenario(parts.drones, parts.fleet)
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.first_takeoff_s is not None, 60.0)
    return flight


def overdue(flight: Scenario) -> list[str]:
    return [event.text for _, event in flight.events if event.code == "overdue"]


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_search_that_takes_too_long_is_given_up_by_all_together(flavour: str) -> None:
    flight = begun("searching_s: 30", emission_kgps=1e-6, flavour=flavour)
    assert flight.run_until(lambda: Phase.RETURNING in flight.phases(), 120.0)
    flight.run(1.5)
    assert flight.phases() == {Phase.RETURNING}
    assert {told.order.stage for told in flight.orders.values()} == {Stage.GIVE_UP}
    assert overdue(flight) == [
        "the search for contact has taken more than 30 s (limits.stages.searching_s): giving up"
    ]
    assert flight.run_until(lambda: all_landed(flight), 200.0), flight.phases()
    assert flight.min_separation_m > 4.0


def test_a_plume_that_is_followed_for_too_long_is_given_up_also_by_a_new_root() -> None:
    flight = begun("tracking_s: 40", seed=2)
    assert flight.run_until(lambda: flight.phases() == {Phase.TRACKING}, 120.0)
    flight.run(20.0)
    flight.kill(1)
    assert flight.run_until(lambda: not flight.phases() & STEERING, 300.0), flight.phases()
    assert flight.source_ned_m is None
    assert len(overdue(flight)) == 1


def test_a_pause_without_an_end_ends_at_home() -> None:
    flight = begun("holding_s: 30")
    flight.run(45.0)
    flight.command(CommandName.PAUSE)
    flight.run(28.0)
    assert flight.phases() == {Phase.HOLDING}
    assert flight.run_until(lambda: all_landed(flight), 200.0), flight.phases()
    left = [event.text for _, event in flight.events if event.code == "leaving"]
    assert left == ["leaving: the pause has taken more than 30 s (limits.stages.holding_s)"] * 5
