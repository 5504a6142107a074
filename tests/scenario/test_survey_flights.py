"""Whole surveys in one process, on simulated time, under faults. The same agents and bytes as in flight."""

from __future__ import annotations

import math

import msgspec
import pytest

from flightstack.agent import Agent, Inputs, Outputs
from flightstack.config import DroneConfig
from flightstack.recording.fingerprint import fingerprint
from flightstack.swarm.wire import CommandName, Phase, Result
from flightstack.transport.memory import Conditions, MemoryRadio
from mission.geometry.geofence import LocalFence
from mission.strategies.contract import Stage
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import Draft, draft, in_process
from simvehicle.survey.survey_file import parse_survey

SURVEY = """
name: scenario
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: COUNT, flavour: FLAVOUR, spacing_m: 6.0, towards_deg: 50.0}
formation: {spacing_m: 10.0, radio_range_m: 80.0}
limits: {ceiling_above_home_m: 60.0}
geofence:
  inclusion:
    - [[38.4053, 14.9613], [38.4053, 14.9647], [38.4027, 14.9647], [38.4027, 14.9613]]
strategy: {name: locus, parameters: {step_m: 4.0, search_radius_m: 100.0}}
wind: {speed_mps: 3.0, from_deg: 320.0}
plume: {type: gaussian, source_north_m: 20.0, source_east_m: -45.0, vent_sd_m: 4.0, emission_kgps: 2.5}
ready_after_s: 8
seed: SEED
"""


def drafted(count: int = 5, flavour: str = "ardupilot", seed: int = 1) -> Draft:
    text = SURVEY.replace("COUNT", str(count)).replace("FLAVOUR", flavour).replace("SEED", str(seed))
    survey = parse_survey(text, "scenario")
    return draft(survey, in_process(survey))


def scenario(
    *,
    count: int = 5,
    flavour: str = "ardupilot",
    seed: int = 1,
    radio: MemoryRadio | None = None,
    starts: tuple[int, ...] = (0,),
) -> Scenario:
    """A flight that has begun. `starts`: whom each start command is for, 0: everybody."""
    parts = drafted(count, flavour, seed)
    flight = Scenario(parts.drones, parts.fleet, radio)
    flight.run(2.0)
    for target in starts:
        flight.command(CommandName.START, target)
    assert flight.run_until(lambda: flight.first_takeoff_s is not None, 60.0)
    return flight


def all_landed(flight: Scenario) -> bool:
    return flight.phases() <= {Phase.LANDED}


def assert_found(flight: Scenario, limit_s: float = 900.0) -> None:
    """The flight ends with everybody down, the source found within 5 m, nobody too near, nobody over the fence."""
    assert flight.run_until(lambda: all_landed(flight), limit_s), flight.phases()
    assert flight.source_ned_m is not None
    assert math.dist(flight.source_ned_m[:2], flight.world.gas.source_ned_m[:2]) < 5.0
    assert flight.min_separation_m > 4.0
    amiss = ("defect", "crash", "astray")
    assert [event.text for _, event in flight.events if event.code in amiss] == []


def fence_of(flight: Scenario) -> LocalFence:
    config = next(iter(flight.members.values())).config
    assert config.geofence is not None
    return LocalFence(flight.world.frame, config.geofence)


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_five_drones_find_the_source_and_land_at_home(flavour: str) -> None:
    flight = scenario(flavour=flavour)
    fence = fence_of(flight)
    inside = True

    def landed() -> bool:
        nonlocal inside
        for member in flight.members.values():
            inside = inside and fence.contains(*member.vehicle.position_ned_m[:2])
        return all_landed(flight)

    assert flight.run_until(landed, 900.0)
    assert inside
    assert_found(flight, 1.0)
    for state in flight.states.values():
        assert state.position_ned_m is not None
        assert state.home_ned_m is not None
        assert math.dist(state.position_ned_m[:2], state.home_ned_m[:2]) < 2.0


@pytest.mark.parametrize("starts", [(3, 1, 0), (1, 2, 3, 5)], ids=["two-operators", "one-did-not-hear-it"])
def test_drones_that_took_different_starts_fly_one_survey(starts: tuple[int, ...]) -> None:
    flight = scenario(starts=starts)
    again = flight.command(CommandName.START)
    flight.run(1.0)
    accepted = {o.sender for o in flight.outcomes if (o.command, o.result) == (again, Result.ACCEPTED)}
    assert accepted == set(flight.members)

    def search_goes_on() -> bool:
        """The root orders a next place only when it has a reading of everybody."""
        return 1 in flight.orders and flight.orders[1].order.sequence > 2

    assert flight.run_until(search_goes_on, 120.0)
    assert len({table.survey for table in flight.tables.values()}) == 1
    assert all(len(table.held) == 5 for table in flight.tables.values()), "nobody was counted out"


@pytest.mark.parametrize("victim", [1, 3, 5])
def test_an_agent_killed_in_flight_is_healed_around(victim: int) -> None:
    flight = scenario(seed=victim)
    flight.run(40.0)
    flight.kill(victim)
    orphan = flight.members[victim].vehicle
    flight.run(10.0)
    assert math.hypot(*orphan.velocity_ned_mps) < 0.5  # without its agent the vehicle stops and hovers
    assert orphan.airborne
    assert victim not in flight.tables[2 if victim == 1 else 1].held
    assert_found(flight)
    assert max(table.heals for table in flight.tables.values()) == 1


def test_two_members_lost_at_once_and_a_third_later() -> None:
    flight = scenario(seed=7)
    flight.run(45.0)
    flight.kill(1)
    flight.kill(2)
    flight.run(60.0)
    flight.kill(3)
    assert_found(flight, 1200.0)


def test_a_vehicle_that_hovers_in_the_roots_slot_does_not_stop_the_swarm() -> None:
    """The root's agent dies when it has just formed up, and nobody takes its vehicle away."""
    flight = scenario()
    assert flight.run_until(lambda: flight.members[1].agent.phase.phase is Phase.SEARCHING, 60.0)
    flight.kill(1)
    assert flight.run_until(lambda: flight.phases() <= {Phase.SEARCHING, Phase.TRACKING}, 90.0), (
        flight.phases()
    )

    def ordered() -> bool:
        return 4 in flight.orders and flight.orders[4].order.stage is not Stage.FORM

    assert flight.run_until(ordered, 60.0)
    assert flight.min_separation_m > 4.0


def test_an_heir_does_not_wait_long_for_a_slot_in_which_a_vehicle_hovers() -> None:
    """The root's agent dies in flight; its vehicle stays exactly where its heir is to go."""
    flight = scenario(seed=2)
    flight.run(40.0)
    flight.kill(1)
    assert flight.run_until(lambda: flight.states[4].healing, 8.0)
    assert flight.run_until(lambda: not flight.states[4].healing, 40.0)
    assert flight.phases() <= {Phase.SEARCHING, Phase.TRACKING}
    assert flight.min_separation_m > 4.0


def test_a_radio_that_loses_a_third_of_everything() -> None:
    radio = MemoryRadio(
        seed=3, conditions=Conditions(loss=0.33, delay_s=0.05, jitter_s=0.05, duplication=0.1)
    )
    assert_found(scenario(seed=3, radio=radio))


def test_a_drone_whose_radio_fails_goes_home_and_does_not_search_on_its_own() -> None:
    """Nobody hears it and it hears nobody: searching on it would meet the others at the same points of the spiral."""
    flight = scenario(seed=2)
    flight.run(40.0)
    flight.radio.switch_off(3)
    flight.run(6.0)
    deaf = flight.members[3].agent
    assert deaf.phase.phase is Phase.RETURNING
    # Others search near its home: it waits in its layer until those whom it does not hear would be down.
    assert flight.run_until(lambda: deaf.phase.phase is Phase.LANDED, 200.0)
    assert 3 not in flight.tables[1].held
    assert flight.phases() <= {Phase.SEARCHING, Phase.TRACKING, Phase.LANDED}
    assert flight.min_separation_m > 4.0


@pytest.mark.parametrize("apart", [{1, 2}, {4, 5}], ids=["with-the-root", "without-the-root"])
def test_the_smaller_part_of_a_swarm_that_comes_apart_goes_home(apart: set[int]) -> None:
    """A ridge stands between them: two swarms on one spiral would meet, and neither hears the other come."""
    flight = scenario(seed=1)
    flight.run(80.0)  # by now the search has left the launch points, over which the others will land
    flight.radio.cut("ridge", apart)
    flight.run(6.0)
    phases = {drone: member.agent.phase.phase for drone, member in flight.members.items()}
    assert {drone for drone, phase in phases.items() if phase is Phase.RETURNING} == apart
    assert flight.run_until(
        lambda: all(flight.members[drone].agent.phase.phase is Phase.LANDED for drone in apart), 120.0
    )
    assert_found(flight)


def test_an_unplugged_co2_instrument_leaves_the_others_tracking() -> None:
    flight = scenario(seed=4)
    flight.run(40.0)
    flight.unplug(2, "co2")
    flight.run(20.0)
    assert any("unplugged" in note for note in flight.states[2].notes), flight.states[2].notes
    assert flight.states[2].excess_co2_ppm is None
    assert_found(flight)


def test_a_pilots_mode_switch_ends_our_authority_and_the_swarm_goes_on() -> None:
    flight = scenario(seed=5)
    flight.run(45.0)
    pilot = flight.members[4]
    pilot.vehicle.switch_mode(5)  # LOITER, as by the remote control's switch
    sent: list[bytes] = []
    flight.tap = lambda drone, _now, _inputs, outputs: sent.append(outputs.autopilot) if drone == 4 else None
    flight.run(5.0)
    assert pilot.agent.phase.phase is Phase.PILOT
    assert 4 not in flight.tables[1].held
    assert pilot.vehicle.mode == "LOITER"
    assert b"\x54\x00\x00" not in b"".join(sent[10:])  # SET_POSITION_TARGET_LOCAL_NED is message 84
    flight.command(CommandName.RTL, 4)
    assert_found(flight)


def test_pause_holds_everybody_and_resume_goes_on() -> None:
    flight = scenario(seed=6)
    flight.run(45.0)
    pause = flight.command(CommandName.PAUSE)
    flight.run(8.0)
    assert flight.phases() == {Phase.HOLDING}
    still = {d: m.vehicle.position_ned_m for d, m in flight.members.items()}
    flight.run(15.0)
    for drone, member in flight.members.items():
        assert math.dist(member.vehicle.position_ned_m, still[drone]) < 1.0
    assert {o.result for o in flight.outcomes if o.command == pause} == {Result.ACCEPTED}
    flight.command(CommandName.RESUME)
    assert_found(flight)


@pytest.mark.parametrize("name", [CommandName.ABORT, CommandName.RTL, CommandName.LAND])
def test_commands_that_end_a_survey_bring_everybody_down(name: CommandName) -> None:
    flight = scenario(seed=8)
    flight.run(50.0)
    flight.command(name)
    assert flight.run_until(lambda: all_landed(flight), 200.0), flight.phases()
    assert flight.min_separation_m > 4.0
    if name is not CommandName.LAND:
        for state in flight.states.values():
            assert state.position_ned_m is not None
            assert state.home_ned_m is not None
            assert math.dist(state.position_ned_m[:2], state.home_ned_m[:2]) < 2.0


def test_a_drone_that_is_disarmed_in_the_air_is_told_to_have_crashed() -> None:
    flight = scenario(seed=8)
    flight.run(40.0)
    flight.members[2].vehicle.stop_motors("Disarming motors")
    assert flight.run_until(lambda: 2 not in flight.tables[1].held, 15.0)
    told = {e.code: e.text for at_s, e in flight.events if e.sender == 2 and at_s > flight.now_s - 15.0}
    assert told["crash"].startswith("crashed: fell and hit the ground at ")
    assert "leaving" not in told


def test_a_drone_that_was_landed_and_is_started_again_joins_the_survey_that_the_others_fly() -> None:
    """It does not fly one of its own: it takes the first free slot, in the air."""
    flight = scenario(seed=8)
    flight.run(30.0)
    flight.command(CommandName.LAND, 4)
    assert flight.run_until(lambda: flight.members[4].agent.phase.phase is Phase.LANDED, 60.0)
    assert 4 not in flight.tables[1].held
    again = flight.command(CommandName.START)
    flight.run(2.0)
    assert {o.result for o in flight.outcomes if o.command == again} == {Result.ACCEPTED}
    surveying = {Phase.SEARCHING, Phase.TRACKING}
    assert flight.run_until(lambda: flight.members[4].agent.phase.phase in surveying, 90.0)
    assert len({table.survey for table in flight.tables.values()}) == 1
    assert all(sorted(table.held) == [1, 2, 3, 4, 5] for table in flight.tables.values())
    assert_found(flight)


def test_an_agent_that_stood_still_takes_a_free_slot_when_it_wakes() -> None:
    """Its own was given away meanwhile."""
    flight = scenario(seed=11)
    flight.run(40.0)
    held = flight.tables[1].held
    flight.freeze(1)
    assert flight.run_until(lambda: 1 not in flight.tables[2].held, 5.0)
    assert flight.run_until(lambda: held[1] in flight.tables[2].held.values(), 5.0), "its heir has claimed it"
    flight.run(20.0)
    flight.thaw(1)
    assert flight.run_until(lambda: sorted(flight.tables[2].held) == [1, 2, 3, 4, 5], 10.0)
    assert flight.tables[2].held[1] != held[1]
    assert flight.tables[2].held[4] == held[1], "and keeps it"
    flight.run(1.0)
    assert flight.states[1].healing
    assert flight.run_until(lambda: not flight.states[1].healing, 45.0)
    assert flight.phases() <= {Phase.SEARCHING, Phase.TRACKING}
    assert_found(flight)


@pytest.mark.parametrize("apart", [{1, 2}, {4, 5}, {3}], ids=["with-the-root", "without-the-root", "alone"])
def test_the_part_that_goes_home_takes_part_again_when_it_hears_the_others(apart: set[int]) -> None:
    flight = scenario(seed=1)
    flight.run(80.0)
    flight.radio.cut("ridge", apart)
    flight.run(8.0)
    assert {flight.members[drone].agent.phase.phase for drone in apart} == {Phase.RETURNING}
    flight.radio.mend("ridge")
    surveying = {Phase.SEARCHING, Phase.TRACKING}
    assert flight.run_until(lambda: flight.phases() <= surveying, 90.0), flight.phases()
    root = next(drone for drone, slot in flight.tables[3].held.items() if slot == 0)
    assert root not in apart
    assert all(sorted(table.held) == [1, 2, 3, 4, 5] for table in flight.tables.values())
    assert_found(flight)


def test_a_weak_battery_announces_its_own_loss() -> None:
    flight = scenario(seed=9)
    flight.run(45.0)
    flight.members[5].vehicle.drop_battery_to(0.2)
    assert flight.run_until(lambda: 5 not in flight.tables[1].held, 15.0)
    assert_found(flight)


def test_the_same_inputs_give_the_same_outputs() -> None:
    """A recorded flight replays byte for byte: the root's and a leaf's, through a heal."""
    flight = scenario(seed=10)
    configs: dict[int, DroneConfig] = {d: m.config for d, m in flight.members.items()}
    again = scenario(seed=10)
    flown: dict[int, list[tuple[float, Inputs, int]]] = {1: [], 4: []}

    def tap(drone: int, now_s: float, inputs: Inputs, outputs: Outputs) -> None:
        if drone in flown:
            flown[drone].append((now_s, inputs, fingerprint(outputs)))

    fresh = Scenario(list(configs.values()), drafted(seed=10).fleet, MemoryRadio(seed=10))
    fresh.tap = tap
    fresh.run(2.0)
    fresh.command(CommandName.START)
    fresh.run(60.0)
    fresh.kill(3)
    fresh.run(40.0)
    for drone, ticks in flown.items():
        agent = Agent(configs[drone], incarnation=drone)
        for now_s, inputs, crc in ticks:
            packed = msgspec.msgpack.decode(msgspec.msgpack.encode(inputs), type=Inputs)
            assert fingerprint(agent.step(now_s, packed)) == crc, f"drone {drone} at {now_s:.1f} s"
    assert again.states.keys() == flight.states.keys()
