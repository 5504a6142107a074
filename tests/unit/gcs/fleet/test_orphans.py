"""Bringing orphans home: who is one, what is done, and when hands are kept off."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.commands import set_mode
from flightstack.mavlink.modes import Duty, mode_of
from flightstack.swarm.wire import Phase
from gcs.fleet.orphans import OrphanKeeper
from gcs.fleet.vehicles import Source
from gcs.station_config import OrphanConfig

GRACE_S = 5.0


def run(keeper, swarm, start_s, end_s, step_s=0.1):
    """All requests with their times."""
    requests = []
    tick = 0
    while (now_s := start_s + tick * step_s) <= end_s + 1e-9:
        requests += [(now_s, request) for request in keeper.step(now_s, swarm.tick(now_s))]
        tick += 1
    return requests


def texts(keeper):
    return [action.text for action in keeper.take_actions()]


@pytest.fixture
def swarm(fleet, autopilot):
    made = fleet()
    made.flying = {2: autopilot(2)}
    return made


@pytest.fixture
def keeper():
    return OrphanKeeper(OrphanConfig(grace_s=GRACE_S))


def test_a_flown_vehicle_is_left_to_its_agent(swarm, keeper):
    assert run(keeper, swarm, 0.0, 30.0) == []


def test_an_orphan_is_called_home_after_the_grace_until_the_mode_is_seen(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    requests = run(keeper, swarm, 10.1, 18.0)
    times = [now_s for now_s, _ in requests]
    assert times[0] == pytest.approx(10.0 + GRACE_S, abs=0.2)
    assert times[1] - times[0] == pytest.approx(0.5, abs=0.11)
    assert {request.duty for _, request in requests} == {Duty.RETURN}
    assert [request.confirmation for _, request in requests] == list(range(len(requests)))
    assert requests[0][1].vehicle.source == Source(0, 2, 1)
    swarm.flying[2].mode = 6
    assert run(keeper, swarm, 18.1, 40.0) == []
    swarm.flying[2].armed = False
    run(keeper, swarm, 40.1, 42.0)
    said = texts(keeper)
    assert "commanded to return" in said[0]
    assert "RTL" in said[1]
    assert "on the ground" in said[2]


def test_px4_is_commanded_by_its_own_numbers(fleet, autopilot, keeper):
    swarm = fleet()
    swarm.flying = {2: autopilot(2, px4=True)}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    (_, request), *_ = run(keeper, swarm, 10.1, 16.0)
    command = set_mode(request.vehicle, mode_of(request.vehicle.flavour, request.duty))
    assert (command.command, command.param1, command.param2, command.param3) == (
        mavlink.MAV_CMD_DO_SET_MODE,
        1.0,
        4.0,
        5.0,
    )


def test_px4_that_fell_into_hold_by_itself_is_still_brought_home(fleet, autopilot, keeper):
    swarm = fleet()
    swarm.flying = {2: autopilot(2, px4=True)}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    run(keeper, swarm, 10.1, 11.0)
    swarm.flying[2].mode = 3 << 24 | 4 << 16
    assert run(keeper, swarm, 11.1, 16.0)


def test_px4_that_sinks_in_a_pilots_mode_without_a_pilot_is_brought_home(fleet, autopilot, keeper):
    swarm = fleet()
    swarm.flying = {2: autopilot(2, px4=True)}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    run(keeper, swarm, 10.1, 11.0)
    swarm.flying[2].mode, swarm.flying[2].status = 3 << 16, mavlink.MAV_STATE_CRITICAL
    assert run(keeper, swarm, 11.1, 16.0)


def test_px4_that_a_pilot_took_into_position_is_the_pilots(fleet, autopilot, keeper):
    swarm = fleet()
    swarm.flying = {2: autopilot(2, px4=True)}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    run(keeper, swarm, 10.1, 11.0)
    swarm.flying[2].mode = 3 << 16
    assert run(keeper, swarm, 11.1, 30.0) == []


def test_px4_put_into_hold_later_is_the_pilots(fleet, autopilot, keeper):
    swarm = fleet()
    swarm.flying = {2: autopilot(2, px4=True)}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    run(keeper, swarm, 10.1, 14.5)
    swarm.flying[2].mode = 3 << 24 | 4 << 16
    assert run(keeper, swarm, 14.6, 30.0) == []


def test_a_pilot_who_has_the_vehicle_keeps_it(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    run(keeper, swarm, 10.1, 12.0)
    swarm.flying[2].mode = 5  # LOITER
    assert run(keeper, swarm, 12.1, 60.0) == []
    (said,) = texts(keeper)
    assert "LOITER" in said
    assert "left alone" in said


def test_a_pilot_who_takes_it_from_us_keeps_it(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    run(keeper, swarm, 10.1, 16.0)
    swarm.flying[2].mode = 6
    run(keeper, swarm, 16.1, 18.0)
    swarm.flying[2].mode = 0  # STABILIZE
    assert run(keeper, swarm, 18.1, 60.0) == []
    swarm.flying[2].mode = 4
    assert run(keeper, swarm, 60.1, 90.0) == [], "what the pilot flies in GUIDED is the pilot's too"


def test_a_vehicle_that_its_agent_never_flew_needs_nothing(swarm, keeper):
    swarm.talking[2] = {"phase": Phase.DISARMED, "armed": False, "airborne": False}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    assert run(keeper, swarm, 10.1, 40.0) == []
    assert texts(keeper) == []


def test_one_that_landed_needs_nothing(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    swarm.flying[2].armed = False
    del swarm.talking[2]
    assert run(keeper, swarm, 10.1, 40.0) == []


@pytest.mark.parametrize("phase", [Phase.DISARMED, Phase.PILOT])
def test_a_restarted_agent_that_does_not_fly_its_vehicle_leaves_an_orphan(swarm, keeper, phase):
    run(keeper, swarm, 0.0, 10.0)
    swarm.talking[2] = {"phase": phase, "incarnation": 9}
    requests = run(keeper, swarm, 10.1, 16.0)
    assert requests[0][0] == pytest.approx(15.0, abs=0.2)


def test_an_agent_that_gave_its_vehicle_to_the_pilot_has_not_lost_it(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    swarm.talking[2] = {"phase": Phase.PILOT}
    assert run(keeper, swarm, 10.1, 40.0) == []


def test_an_agent_that_comes_back_flying_is_believed(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    told = swarm.talking.pop(2)
    assert run(keeper, swarm, 10.1, 14.0) == []
    swarm.talking[2] = told
    assert run(keeper, swarm, 14.1, 40.0) == []


def test_a_companion_heard_over_mavlink_tells_that_the_agent_lives(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=191)
    for step in range(200):
        now_s = 10.0 + step * 0.1
        beat = mavlink.MAVLink_heartbeat_message(18, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
        codec = MavlinkCodec(255, 190, {mavlink.MAVLINK_MSG_ID_HEARTBEAT})
        for message in codec.receive(now_s, bytes(beat.pack(mav))):
            swarm.view.receive_mavlink(now_s, 0, message)
        assert keeper.step(now_s, swarm.tick(now_s)) == []


def test_an_agent_that_is_heard_and_says_that_it_flies_nothing_is_believed(swarm, keeper):
    """It was restarted in the air; that its heartbeats come as well does not make it fly."""
    run(keeper, swarm, 0.0, 10.0)
    swarm.talking[2] = {"phase": Phase.DISARMED, "incarnation": 900}
    mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=191)
    beat = mavlink.MAVLink_heartbeat_message(18, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    swarm.beside = lambda: bytes(beat.pack(mav))
    assert run(keeper, swarm, 10.1, 16.0)


def test_a_take_off_whose_agent_died_on_the_ground_is_brought_home(swarm, keeper):
    swarm.talking[2] = {"phase": Phase.TAKEOFF, "airborne": False}
    run(keeper, swarm, 0.0, 1.0)
    del swarm.talking[2]
    assert run(keeper, swarm, 1.1, 10.0)


@pytest.fixture
def two_orphans(fleet, autopilot):
    """2 hovers beside the way home of 3."""
    swarm = fleet()
    swarm.flying = {2: autopilot(2), 3: autopilot(3)}
    swarm.flying[3].north_m, swarm.flying[3].east_m, swarm.flying[3].home_north_m = 20.0, 40.0, 6.0
    return swarm


def test_of_two_that_might_meet_on_their_ways_home_one_waits_for_the_other(two_orphans, keeper):
    swarm = two_orphans
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2], swarm.talking[3]
    requests = run(keeper, swarm, 10.1, 20.0)
    assert {request.vehicle.source.system for _, request in requests} == {2}
    swarm.flying[2].mode = 6
    assert run(keeper, swarm, 20.1, 60.0) == []
    assert any("after drone 2" in text for text in texts(keeper))
    swarm.flying[2].armed, swarm.flying[2].landed_state = False, mavlink.MAV_LANDED_STATE_ON_GROUND
    requests = run(keeper, swarm, 60.1, 62.0)
    assert {request.vehicle.source.system for _, request in requests} == {3}


def test_nobody_waits_for_ever(two_orphans, keeper):
    swarm = two_orphans
    run(keeper, swarm, 0.0, 1.0)
    del swarm.talking[2], swarm.talking[3]
    run(keeper, swarm, 1.1, 7.0)
    swarm.flying[2].mode = 6
    requests = run(keeper, swarm, 7.1, 310.0, step_s=0.5)
    assert [request.vehicle.source.system for _, request in requests][:1] == [3]
    assert requests[0][0] > 300.0


def test_two_far_apart_are_brought_home_together(two_orphans, keeper):
    swarm = two_orphans
    swarm.flying[3].north_m, swarm.flying[3].east_m = 26.0, -40.0
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2], swarm.talking[3]
    requests = run(keeper, swarm, 10.1, 16.0)
    assert {request.vehicle.source.system for _, request in requests} == {2, 3}


def test_surveying_drones_that_count_it_in_tell_that_the_agent_lives(swarm, keeper, table):
    swarm.tables = {1: table(1, (1, 2, 3)), 3: table(3, (1, 2, 3))}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    assert run(keeper, swarm, 10.1, 30.0) == []
    swarm.tables = {1: table(1, (1, 3), epoch=2), 3: table(3, (1, 3), epoch=2)}
    requests = run(keeper, swarm, 30.1, 32.0)
    assert requests, "once the swarm has healed round it, it is an orphan"


def test_drones_on_their_way_home_do_not_testify(swarm, keeper, table):
    swarm.tables = {1: table(1, (1, 2, 3)), 3: table(3, (1, 2, 3))}
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    for drone in (1, 3):
        swarm.talking[drone] = {"phase": Phase.RETURNING}
    assert run(keeper, swarm, 10.1, 17.0)


def test_when_all_fall_silent_at_once_our_own_radio_is_suspected_first(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    swarm.talking = {}
    assert run(keeper, swarm, 10.1, 39.0) == []
    assert run(keeper, swarm, 39.1, 42.0), "but nobody is left hovering for ever"


def test_one_that_cannot_return_is_landed(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    requests = run(keeper, swarm, 10.1, 40.0)
    duties = [request.duty for _, request in requests]
    assert duties[0] is Duty.RETURN
    assert duties[-1] is Duty.LAND
    assert any("land where it is" in text for text in texts(keeper))


def test_policy_none_keeps_hands_off(swarm):
    keeper = OrphanKeeper(OrphanConfig(action="none"))
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    assert run(keeper, swarm, 10.1, 60.0) == []


def test_policy_land(swarm):
    keeper = OrphanKeeper(OrphanConfig(action="land"))
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    assert run(keeper, swarm, 10.1, 16.0)[0][1].duty is Duty.LAND


def test_nothing_is_sent_to_a_vehicle_that_is_not_heard(swarm, keeper):
    run(keeper, swarm, 0.0, 10.0)
    del swarm.talking[2]
    vehicle = swarm.flying.pop(2)
    late = [now_s for now_s, _ in run(keeper, swarm, 10.1, 40.0)]
    assert all(now_s <= 15.1 for now_s in late)
    swarm.flying = {2: vehicle}
    assert run(keeper, swarm, 40.1, 42.0), "as soon as it is heard again it is called home"


def test_the_operators_command_goes_before_everything(swarm, keeper):
    run(keeper, swarm, 0.0, 1.0)
    swarm.flying[2].mode = 0
    keeper.command(1.0, 2, Duty.LAND)
    requests = run(keeper, swarm, 1.1, 2.0)
    assert requests[0][1].duty is Duty.LAND
    assert "by the operator" in texts(keeper)[0]


def test_a_pilot_who_takes_it_while_the_operators_command_is_repeated_keeps_it(swarm, keeper):
    """The autopilot would not return; the pilot flies it down by hand."""
    run(keeper, swarm, 0.0, 1.0)
    del swarm.talking[2]
    run(keeper, swarm, 1.1, 6.0)
    keeper.command(6.0, 2, Duty.RETURN)
    assert run(keeper, swarm, 6.1, 8.0)
    swarm.flying[2].mode = 2  # ALT_HOLD
    assert run(keeper, swarm, 8.1, 60.0) == []
    assert "somebody chose ALT_HOLD: left alone" in texts(keeper)


def test_px4_that_holds_for_want_of_setpoints_still_gets_the_operators_command(fleet, autopilot, keeper):
    swarm = fleet()
    swarm.flying = {2: autopilot(2, px4=True)}
    run(keeper, swarm, 0.0, 1.0)
    del swarm.talking[2]
    keeper.command(1.0, 2, Duty.RETURN)
    run(keeper, swarm, 1.1, 2.0)
    swarm.flying[2].mode = 3 << 24 | 4 << 16
    assert run(keeper, swarm, 2.1, 5.0)


def test_an_operators_command_is_not_kept_for_the_next_flight(swarm, keeper):
    run(keeper, swarm, 0.0, 1.0)
    del swarm.talking[2]
    keeper.command(1.0, 2, Duty.RETURN)
    run(keeper, swarm, 1.1, 2.0)
    vehicle = swarm.flying.pop(2)
    run(keeper, swarm, 2.1, 70.0)
    swarm.flying[2] = vehicle
    swarm.talking[2] = {}
    assert run(keeper, swarm, 70.1, 80.0) == [], "a new battery, a new flight, by its own agent"
