"""Scenarios flown by whole agents: what is told, what is checked, and what each fault does."""

from __future__ import annotations

import pathlib
import re

import msgspec
import pytest
from typer.testing import CliRunner

from flightstack.mavlink.modes import Duty, Flavour, mode_of
from flightstack.swarm.wire import CommandName
from flightstack.transport.memory import Conditions, MemoryRadio
from flightstack.transport.radio_model import RadioModel
from flightstack.transport.terrain import Ridge
from simvehicle.cli.main import app
from simvehicle.faults.fault_table import SwarmFaultSpec
from simvehicle.faults.schedule import SwarmFaultSchedule
from simvehicle.scenario.afflicted_swarm import AfflictedSwarm
from simvehicle.scenario.agent_level import AgentFlight, fly_scenario
from simvehicle.scenario.ground_keeper import GroundKeeper
from simvehicle.scenario.own_matters import OwnReturns, astray, kept_up
from simvehicle.scenario.scenario_file import parse_scenario
from simvehicle.scenario.swarm import GROUND, Scenario
from simvehicle.survey.draft import draft, in_process

SHORT = """
name: short
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 3, flavour: FLAVOUR, spacing_m: 6.0, towards_deg: 50.0}
formation: {spacing_m: 10.0, radio_range_m: 80.0}
limits: {ceiling_above_home_m: 60.0}
ready_after_s: 3.0
ends_within_s: 120.0
swarm_faults:
  - {kind: command, command: abort, at_s: 20.0}
"""


def flown(*faults: str, flavour: str = "ardupilot", ends: str = "120.0"):
    text = SHORT.replace("FLAVOUR", flavour).replace("120.0", ends)
    return fly_scenario(parse_scenario(text + "".join(f"  - {{{fault}}}\n" for fault in faults), "short"))


def hovering() -> tuple[Scenario, AfflictedSwarm]:
    scenario = parse_scenario(SHORT.replace("FLAVOUR", "ardupilot"), "short")
    parts = draft(scenario.survey, in_process(scenario.survey))
    flight = Scenario(parts.drones, parts.fleet)
    flight.run(1.0)
    return flight, AfflictedSwarm(flight)


def struck(swarm: AfflictedSwarm, *faults: SwarmFaultSpec, at_s: float) -> SwarmFaultSchedule:
    schedule = SwarmFaultSchedule(faults)
    schedule.strike(at_s, swarm)
    return schedule


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_short_flight_is_told_in_order_and_violates_nothing(flavour: str) -> None:
    result = flown(flavour=flavour)
    assert result.violations == ()
    text = "\n".join(result.transcript)
    told = ["1 2 3       takeoff", "fault command abort", "returning", "landed", "over"]
    places = [text.index(word) for word in told]
    assert places == sorted(places)
    assert flown(flavour=flavour) == result


def test_a_frozen_drone_is_brought_home_and_told() -> None:
    transcript = flown("kind: freeze, drone: 2, at_s: 10.0", "kind: ground_gone, at_s: 16.0").transcript
    assert "  15 s  2           sent home by the ground station" in transcript


def test_without_a_ground_station_nobody_is_brought_home() -> None:
    transcript = flown(
        "kind: freeze, drone: 2, at_s: 10.0", "kind: ground_gone, at_s: 9.0", ends="60.0"
    ).transcript
    assert not any("sent home" in line for line in transcript)


def test_a_flight_that_does_not_end_in_time_is_a_violation() -> None:
    result = flown(ends="1.0")
    assert [violation.kind for violation in result.violations] == ["ends"]
    assert result.transcript[-1].endswith(
        "drones 1 2 3: not on the ground with motors off 1 s after the last fault"
    )


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_vehicle_that_its_pilot_keeps_is_the_pilots_matter(flavour: str) -> None:
    result = flown("kind: pilot, drone: 2, at_s: 21.0", flavour=flavour)
    assert result.violations == ()
    assert result.transcript[-2].endswith("2           still in the air: a pilot has it")


def test_a_pilot_has_a_vehicle_until_its_agent_obeys_a_command() -> None:
    result = flown("kind: pilot, drone: 2, at_s: 10.0")  # everybody is told to come home afterwards
    assert result.violations == ()
    assert not any("still in the air" in line for line in result.transcript)


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_failsafe_by_name_brings_its_vehicle_home_and_is_told(flavour: str) -> None:
    fault = "{kind: failsafe, unheard: remote_control, drone: 2, at_s: 12.0, until_s: 13.0}"
    text = SHORT.replace("FLAVOUR", flavour) + f"faults: [{fault}]\n"
    transcript = "\n".join(fly_scenario(parse_scenario(text, "short")).transcript)
    assert "12 s  2           fault failsafe remote_control" in transcript
    assert re.search(r"1[278] s  2           rtl\n", transcript)
    assert re.search(r"s  [1 ]*2[ 3]* +landed\n", transcript)
    assert re.search(r"s  2           failsafe: rtl: failsafe of the autopilot", transcript)


def test_who_waits_for_an_operator_or_for_a_ground_station_is_not_judged_by_the_end() -> None:
    text = SHORT.replace("FLAVOUR", "ardupilot").replace("command: abort", "command: pause")
    text += "  - {kind: ground_gone, at_s: 22.0}\n  - {kind: kill, drone: 3, at_s: 24.0}\n"
    result = fly_scenario(parse_scenario(text, "short"))
    assert result.violations == ()
    assert [line.split(maxsplit=2)[2] for line in result.transcript[-3:-1]] == [
        "1 2         still in the air: the operator has paused the swarm",
        "3           still in the air: it has no agent, and no ground station brings it home",
    ]


def test_a_vehicle_that_does_not_know_where_it_is_is_not_judged_by_where_it_is() -> None:
    scenario = parse_scenario(SHORT.replace("FLAVOUR", "ardupilot"), "short")
    flying = AgentFlight(scenario)
    flight = flying.flight
    swarm = AfflictedSwarm(flight)
    flight.run(1.0)
    member = flight.members[2]
    assert not astray(member)
    member.vehicle.set_gps(False)
    flight.run(60.0)
    assert astray(member)
    member.vehicle.set_gps(True)
    flight.run(3.0)
    assert not astray(member)
    assert kept_up(flight, swarm, ground_brings_home=True) == {}


def in_the_air(flavour: str = "ardupilot") -> Scenario:
    """Three drones on their way up."""
    scenario = parse_scenario(SHORT.replace("FLAVOUR", flavour), "short")
    parts = draft(scenario.survey, in_process(scenario.survey))
    flight = Scenario(parts.drones, parts.fleet, ground_beats=True)
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: all(m.vehicle.airborne for m in flight.members.values()), 30.0)
    return flight


def test_an_agent_that_was_started_in_the_air_leaves_its_vehicle_to_the_ground_station() -> None:
    flight = in_the_air()
    swarm, keeper = AfflictedSwarm(flight), GroundKeeper(flight)
    keeper.step()
    flight.start_again(2)
    assert kept_up(flight, swarm, ground_brings_home=False).keys() == {2}
    assert kept_up(flight, swarm, ground_brings_home=True) == {}
    sent: list[int] = []
    assert flight.run_until(lambda: bool(sent.extend(keeper.step()) or sent), 7.0)
    assert sent == [2]


def test_a_ground_station_leaves_vehicles_alone_whose_agents_run_unheard() -> None:
    flight = in_the_air()
    keeper = GroundKeeper(flight)
    keeper.step()
    flight.radio.switch_off(2)
    sent: list[int] = []
    flight.run_until(lambda: bool(sent.extend(keeper.step())), 8.0)
    assert sent == []


def test_of_two_ways_home_by_themselves_none_is_judged_but_that_of_one_that_was_sent() -> None:
    flight = in_the_air()
    keeper = GroundKeeper(flight)
    returns = OwnReturns(flight, keeper)
    for drone in (1, 2):
        flight.members[drone].vehicle.switch_mode(mode_of(Flavour.ARDUPILOT, Duty.RETURN))
        returns.look()
        flight.step()
    returns.look()
    assert returns.meet_by_themselves((1, 2))
    assert not returns.meet_by_themselves((1, 3)), "its agent steers the third"
    keeper.sent.add(1)
    assert returns.meet_by_themselves((1, 2)), "the second did not ask whether it could"
    keeper.sent.add(2)
    assert not returns.meet_by_themselves((1, 2))


def test_an_error_in_an_agent_is_a_violation(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ValueError("a defect on purpose")

    monkeypatch.setattr("flightstack.flight.guard.Guard.apply", broken)
    result = flown()
    assert [(v.kind, v.text) for v in result.violations] == [("error", "ValueError: a defect on purpose")]


def test_drones_too_near_each_other_are_a_violation_told_once() -> None:
    scenario = parse_scenario(SHORT.replace("FLAVOUR", "ardupilot"), "short")
    survey = scenario.survey
    limits = msgspec.structs.replace(survey.config.limits, separation_m=30.0)  # more than the checks let pass
    config = msgspec.structs.replace(survey.config, limits=limits)
    result = fly_scenario(
        msgspec.structs.replace(scenario, survey=msgspec.structs.replace(survey, config=config))
    )
    near = [
        violation.text.partition(":")[0] for violation in result.violations if violation.kind == "separation"
    ]
    assert sorted(near) == ["drones 1 and 2", "drones 1 and 3", "drones 2 and 3"]


def test_a_started_agent_remembers_nothing() -> None:
    flight, swarm = hovering()
    before = flight.members[2].agent
    schedule = struck(swarm, SwarmFaultSpec(kind="reboot", drone=2, at_s=1.0, until_s=2.0), at_s=1.0)
    assert not flight.members[2].runs
    schedule.strike(2.0, swarm)
    flight.run(1.0)
    assert flight.members[2].runs
    assert flight.members[2].agent is not before
    assert flight.states[2].incarnation not in {1, 2, 3}


def test_a_frozen_agent_hears_afterwards_what_came_meanwhile() -> None:
    flight, swarm = hovering()
    sizes: list[int] = []
    flight.tap = lambda drone, _now_s, heard, _said: (
        sizes.append(len(heard.autopilot)) if drone == 2 else None
    )
    flight.run(1.0)
    a_second = sum(sizes)
    schedule = struck(swarm, SwarmFaultSpec(kind="freeze", drone=2, at_s=1.0, until_s=2.0), at_s=1.0)
    sizes.clear()
    flight.run(5.0)
    assert sizes == []
    schedule.strike(2.0, swarm)
    flight.run(0.2)
    assert sizes[0] > 3 * a_second


def test_faults_of_the_radio_end_as_they_began() -> None:
    flight, swarm = hovering()
    radio, everybody = flight.radio, {"1", "2", "3", GROUND}
    schedule = struck(
        swarm,
        SwarmFaultSpec(kind="partition", parts=((1,), (2,), (3,)), at_s=1.0, until_s=2.0),
        SwarmFaultSpec(kind="one_way", drone=1, towards=2, at_s=3.0, until_s=4.0),
        SwarmFaultSpec(kind="radio_dead", drone=3, at_s=5.0, until_s=6.0),
        SwarmFaultSpec(kind="ground_gone", at_s=7.0, until_s=8.0),
        SwarmFaultSpec(kind="loss", loss=0.5, at_s=9.0, until_s=10.0),
        at_s=1.0,
    )
    assert [radio.audible(node) for node in ("1", "2", "3")] == [{GROUND}, set(), set()]
    schedule.strike(3.0, swarm)
    assert radio.audible("2") == everybody - {"1", "2"}
    assert radio.audible("1") == everybody - {"1"}
    schedule.strike(5.0, swarm)
    assert radio.audible("1") == {"2", GROUND}
    schedule.strike(7.0, swarm)
    assert radio.audible("1") == {"2", "3"}
    schedule.strike(9.0, swarm)
    assert radio.audible("1") == everybody - {"1"}
    assert radio.conditions == Conditions(loss=0.5)
    schedule.strike(10.0, swarm)
    assert radio.conditions == Conditions()


def test_the_ground_station_hears_behind_a_ridge_nobody_and_drones_each_other() -> None:
    text = SHORT.replace("FLAVOUR", "ardupilot") + "ground_ned_m: [-50.0, 0.0, 0.0]\n"
    text += "radio: {ridges: [{crest_ned_m: [[-20.0, -500.0, -40.0], [-20.0, 500.0, -40.0]]}]}\n"
    flight = AgentFlight(parse_scenario(text, "short")).flight
    flight.run(2.0)
    assert flight.states == {}
    assert flight.radio.audible("1") == {"2", "3"}
    flight.radio.place(GROUND, (-50.0, 0.0, -200.0))  # onto the next hill
    flight.run(2.0)
    assert sorted(flight.states) == [1, 2, 3]


def test_a_scenario_with_a_model_of_the_radio_has_the_fleets_seed() -> None:
    scenario = parse_scenario(SHORT.replace("FLAVOUR", "ardupilot"), "short")
    parts = draft(scenario.survey, in_process(scenario.survey))
    ridge = Ridge(crest_ned_m=((0.0, 1.0, -9.0), (9.0, 1.0, -9.0)))
    model = RadioModel(loss=0.2, ridges=(ridge,))
    given = Scenario(parts.drones, parts.fleet, MemoryRadio(parts.fleet.seed, model=model))
    made = Scenario(parts.drones, parts.fleet, model)
    for flight in (given, made):
        flight.run(2.0)
    assert given.states == made.states
    assert made.radio.audible("3") == {GROUND}


def test_a_clock_that_jumps_and_a_pilot() -> None:
    flight, swarm = hovering()
    struck(
        swarm,
        SwarmFaultSpec(kind="clock_jump", drone=1, by_s=4.0, at_s=1.0),
        SwarmFaultSpec(kind="pilot", drone=2, at_s=1.0),
        at_s=1.0,
    )
    assert flight.members[1].clock_ahead_s == 4.0
    assert flight.members[2].vehicle.mode == "LOITER"
    assert swarm.pilot_flies(2)
    flight.members[2].vehicle.switch_mode(9)  # LAND
    assert not swarm.pilot_flies(2)


def test_the_command_prints_writes_and_says_by_its_code(tmp_path: pathlib.Path) -> None:
    file, out = tmp_path / "short.yaml", tmp_path / "short.txt"
    file.write_text(SHORT.replace("FLAVOUR", "ardupilot"))
    done = CliRunner().invoke(app, ["scenario", "run", str(file), "--transcript", str(out)])
    assert done.exit_code == 0
    assert done.output == out.read_text()
    file.write_text(file.read_text().replace("120.0", "1.0"))
    done = CliRunner().invoke(app, ["scenario", "run", str(file), "--json"])
    assert done.exit_code == 1
    assert done.output.startswith('{"violations":[{"kind":"ends"')
