"""The failure monitor: which alarm, when, and how it ends."""

from __future__ import annotations

import inspect
import re

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.swarm import topics
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import Command, CommandName, CommandOutcome, Phase, Result, Severity
from gcs.fleet.monitor import ENDS, Monitor, ended, on_the_wire
from gcs.fleet.view import FleetView
from gcs.station_config import AlarmLimits
from mission.geometry.geofence import Geofence, LocalFence


def codes(monitor: Monitor) -> dict[int, set[str]]:
    found: dict[int, set[str]] = {}
    for alarm in monitor.alarms:
        found.setdefault(alarm.drone, set()).add(alarm.code)
    return found


def run(monitor, swarm, start_s, end_s, step_s=0.5):
    changes = []
    now_s = start_s
    while now_s <= end_s:
        changes.append(monitor.step(now_s, swarm.tick(now_s)))
        now_s += step_s
    return changes


def test_a_healthy_swarm_has_no_alarms(fleet):
    monitor = Monitor(AlarmLimits())
    run(monitor, fleet(), 0.0, 60.0)
    assert monitor.alarms == []


def test_agent_and_vehicle_silent_in_the_air_is_a_lost_drone(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    run(monitor, swarm, 0.0, 5.0)
    del swarm.talking[2]
    run(monitor, swarm, 5.5, 7.5)
    assert monitor.alarms == []
    run(monitor, swarm, 8.0, 10.0)
    (alarm,) = monitor.alarms
    assert (alarm.drone, alarm.code, alarm.severity) == (2, "lost", Severity.CRITICAL)


def test_a_flying_vehicle_without_its_agent_is_an_orphan(fleet, autopilot):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.flying = {2: autopilot(2)}
    run(monitor, swarm, 0.0, 5.0)
    del swarm.talking[2]
    run(monitor, swarm, 5.5, 10.0)
    (alarm,) = monitor.alarms
    assert (alarm.code, alarm.severity) == ("orphan", Severity.CRITICAL)
    assert "GUIDED" in alarm.text
    swarm.flying[2].landed_state, swarm.flying[2].armed = 1, False
    run(monitor, swarm, 10.5, 14.0)
    assert codes(monitor) == {2: {"agent_silent"}}


def test_an_agent_that_ended_on_the_ground_is_worth_a_line_only(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.talking[2] = {"phase": Phase.LANDED, "armed": False, "airborne": False}
    run(monitor, swarm, 0.0, 5.0)
    del swarm.talking[2]
    run(monitor, swarm, 5.5, 10.0)
    (alarm,) = monitor.alarms
    assert (alarm.code, alarm.severity) == ("agent_silent", Severity.INFO)


def test_a_silent_autopilot_with_a_live_agent(fleet, autopilot):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.flying = {2: autopilot(2)}
    run(monitor, swarm, 0.0, 5.0)
    swarm.flying = {}
    run(monitor, swarm, 5.5, 12.0)
    assert codes(monitor) == {2: {"vehicle_silent"}}


def test_members_that_never_came_are_reported_after_a_while(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits(absent_s=20.0))
    del swarm.talking[3]
    run(monitor, swarm, 0.0, 19.0)
    assert monitor.alarms == []
    run(monitor, swarm, 19.5, 21.0)
    assert codes(monitor) == {3: {"absent"}}


def test_a_short_gap_neither_clears_nor_raises_again(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    trouble = {"notes": ("co2: error, supply voltage low",)}
    swarm.talking[1] = trouble
    run(monitor, swarm, 0.0, 5.0)
    swarm.talking[1] = {}
    changes = run(monitor, swarm, 5.5, 6.5)
    swarm.talking[1] = trouble
    changes += run(monitor, swarm, 7.0, 9.0)
    assert not any(change.raised or change.cleared for change in changes)
    swarm.talking[1] = {}
    (cleared,) = [alarm for change in run(monitor, swarm, 9.5, 14.0) for alarm in change.cleared]
    assert cleared.code == "sensor"
    assert monitor.alarms == []


def test_an_instruments_trouble_is_told_with_its_reason(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    notes = (
        "co2: zeroing 12 of 25",
        "guard: held back by drone 4",
        "setpoint withheld: the autopilot is silent",
    )
    swarm.talking[1] = {"notes": notes}
    run(monitor, swarm, 0.0, 3.0)
    (alarm,) = monitor.alarms
    assert (alarm.code, alarm.text) == ("sensor", "co2: zeroing 12 of 25")


def test_a_severity_that_flickers_is_told_once(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    raised = []
    for tick in range(40):
        swarm.talking[1] = {"notes": ("co2: silent, no answer",), "armed": tick % 2 == 0}
        raised += monitor.step(tick * 0.5, swarm.tick(tick * 0.5)).raised
    assert [alarm.severity for alarm in raised] == [Severity.WARNING]


def test_battery_alarms_have_two_levels_and_hysteresis(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.talking[1] = {"battery_fraction": 0.29}
    run(monitor, swarm, 0.0, 4.0)
    (alarm,) = monitor.alarms
    assert (alarm.code, alarm.severity) == ("battery", Severity.WARNING)
    swarm.talking[1] = {"battery_fraction": 0.31}
    run(monitor, swarm, 4.5, 10.0)
    assert codes(monitor) == {1: {"battery"}}, "a battery that recovers by 2 % is still low"
    swarm.talking[1] = {"battery_fraction": 0.14}
    raised = [a for change in run(monitor, swarm, 10.5, 12.0) for a in change.raised]
    assert [a.severity for a in raised] == [Severity.CRITICAL], "said again when it gets worse, once"


def test_fence_breaches_count_in_the_air_and_end_well_inside(fleet, frame):
    corners = [(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)]
    points = [frame.to_geodetic((north, east, 0.0)) for north, east in corners]
    polygon = tuple((point.latitude_deg, point.longitude_deg) for point in points)
    fence = LocalFence(frame, Geofence(inclusion=(polygon,)))
    swarm, monitor = fleet(), Monitor(AlarmLimits(), fence)
    run(monitor, swarm, 0.0, 2.0)
    assert monitor.alarms == []
    swarm.talking[1] = {"position_ned_m": (53.0, 0.0, -10.0)}
    run(monitor, swarm, 2.5, 3.0)
    (alarm,) = monitor.alarms
    assert (alarm.code, alarm.severity) == ("fence", Severity.CRITICAL)
    assert "3 m outside" in alarm.text
    swarm.talking[1] = {"position_ned_m": (49.5, 0.0, -10.0)}
    run(monitor, swarm, 3.5, 8.0)
    assert codes(monitor) == {1: {"fence"}}
    swarm.talking[1] = {"position_ned_m": (45.0, 0.0, -10.0)}
    run(monitor, swarm, 8.5, 12.0)
    assert monitor.alarms == []
    swarm.talking[1] = {"position_ned_m": (80.0, 0.0, 0.0), "airborne": False}
    run(monitor, swarm, 12.5, 16.0)
    assert monitor.alarms == []


def test_ceiling(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits(ceiling_above_home_m=30.0))
    swarm.talking[1] = {"position_ned_m": (0.0, 0.0, -31.0)}
    run(monitor, swarm, 0.0, 2.0)
    assert codes(monitor) == {1: {"ceiling"}}


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"frame": 1}, "frame"),
        ({"position_ned_m": None}, "position"),
        ({"phase": Phase.DISARMED}, "unflown"),
    ],
)
def test_what_the_agent_says_of_itself(fleet, changes, code):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.talking[1] = changes
    run(monitor, swarm, 0.0, 5.0)
    assert codes(monitor) == {1: {code}}


def test_late_ticks(fleet, state, on_air, frame):
    view, monitor = FleetView((1,), frame, 0.0), Monitor(AlarmLimits())
    for second in range(20):
        told = state(1, sequence=second, ticks=10 * second, late_ticks=2 * second)
        view.receive_peer(float(second), on_air(told))
        monitor.step(float(second), view)
    assert codes(monitor) == {1: {"late_ticks"}}


def test_two_agents_with_one_id(fleet, state, on_air, frame):
    view, monitor = FleetView((1,), frame, 0.0), Monitor(AlarmLimits())
    for tick in range(20):
        view.receive_peer(tick * 0.2, on_air(state(1, sequence=tick, incarnation=1 + tick % 2)))
        monitor.step(tick * 0.2, view)
    assert "identity" in codes(monitor)[1]


def test_what_is_not_recorded_is_an_alarm_while_it_lasts(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    full = "flights/drone-1-7.mcap: recording has ended: No space left on device"
    swarm.talking[1] = {"storage": full}
    swarm.view.storage = "flights/swarm.mcap: recording has ended: No space left on device"
    run(monitor, swarm, 0.0, 5.0)
    assert codes(monitor) == {0: {"recording"}, 1: {"recording"}}
    own, drones = monitor.alarms
    assert own.text == f"the ground station's {swarm.view.storage}"
    assert (drones.severity, drones.text) == (Severity.WARNING, full)
    assert swarm.view.rows(5.0)[0].storage == full
    swarm.talking[1], swarm.view.storage = {}, ""
    run(monitor, swarm, 5.5, 10.0)
    assert monitor.alarms == []
    assert swarm.view.rows(10.0)[0].storage == ""


def test_a_command_that_a_live_drone_does_not_answer(fleet, on_air):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.tick(1.0)
    swarm.view.receive_peer(1.0, on_air(Command("abcdefgh-1", "op", 0, CommandName.PAUSE)))
    for drone in (1, 3):
        swarm.view.receive_peer(1.1, on_air(CommandOutcome("abcdefgh-1", drone, Result.ACCEPTED)))
    run(monitor, swarm, 1.5, 5.5)
    assert monitor.alarms == []
    run(monitor, swarm, 6.0, 8.0)
    (alarm,) = monitor.alarms
    assert (alarm.drone, alarm.code) == (2, "no_ack:abcdefgh")
    assert "pause" in alarm.text
    run(monitor, swarm, 8.5, 40.0)
    assert monitor.alarms == []


def test_unreadable_messages(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.tick(1.0)
    swarm.view.receive_peer(1.0, Received(topics.TABLE, "9", b"\x01\xff"))
    run(monitor, swarm, 1.0, 2.0)
    assert "wire" in codes(monitor)[9]


def test_vehicles_of_others_are_mentioned_not_alarmed_about(fleet, autopilot):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.flying = {77: autopilot(77)}
    run(monitor, swarm, 0.0, 10.0)
    (alarm,) = monitor.alarms
    assert (alarm.drone, alarm.code, alarm.severity) == (77, "foreign", Severity.INFO)


@pytest.mark.parametrize("drone", [77, 251, 255])
def test_a_vehicle_that_passed_is_foreign_and_then_gone(fleet, autopilot, drone):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.flying = {drone: autopilot(drone)}
    run(monitor, swarm, 0.0, 10.0)
    assert codes(monitor) == {drone: {"foreign"}}
    swarm.flying = {}
    changes = run(monitor, swarm, 10.1, 80.0)
    assert monitor.alarms == []
    assert [alarm for change in changes for alarm in change.raised] == []
    assert swarm.view.drones(80.0) == [1, 2, 3]


def test_an_agent_that_is_no_member_is_foreign_and_then_gone(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.talking[9] = {}
    run(monitor, swarm, 0.0, 10.0)
    assert codes(monitor) == {9: {"foreign"}}
    assert "swarm.members" in monitor.alarms[0].text
    del swarm.talking[9]
    run(monitor, swarm, 10.1, 80.0)
    assert monitor.alarms == []
    assert swarm.view.drones(80.0) == [1, 2, 3]


@pytest.mark.parametrize(
    "kind", ["ping0", "gimbal3", "copter154", "qgc", "sys0", "gcs1", "generic1", "rover1"]
)
def test_what_else_is_on_the_link_raises_no_alarm(fleet, autopilot, neighbours, kind):
    swarm, monitor = fleet((1,)), Monitor(AlarmLimits())
    swarm.flying = {1: autopilot(1)}
    swarm.beside = lambda: neighbours.heartbeat(kind)
    run(monitor, swarm, 0.0, 30.0)
    assert monitor.alarms == []
    assert swarm.view.flying(1, 30.0)


def test_a_twin_that_comes_and_goes_is_an_alarm_while_it_lasts(fleet, state, on_air):
    swarm, monitor = fleet((1,)), Monitor(AlarmLimits())
    swarm.talking[1] = {"ticks": 5000}
    run(monitor, swarm, 0.0, 10.0)
    for tick in range(25):
        now_s = 10.1 + 0.2 * tick
        monitor.step(now_s, swarm.tick(now_s))
        twin = state(
            1, incarnation=999, sequence=tick, phase=Phase.DISARMED, armed=False, airborne=False, ticks=tick
        )
        swarm.view.receive_peer(now_s, on_air(twin))
        assert swarm.view.agents[1].state.phase is Phase.SEARCHING, "who flies the drone speaks for it"
    assert codes(monitor) == {1: {"identity"}}
    run(monitor, swarm, 15.1, 30.0)
    assert monitor.alarms == []
    row = swarm.view.rows(30.0)[0]
    assert (row.agent, row.phase, row.restarts) == ("live", "searching", 0)


def test_two_autopilots_under_one_system_id(fleet, autopilot):
    swarm, monitor = fleet((1,)), Monitor(AlarmLimits())
    swarm.flying = {1: autopilot(1)}
    other = autopilot(1, px4=True)
    swarm.beside = other.heartbeat
    run(monitor, swarm, 0.0, 15.0)
    assert codes(monitor) == {1: {"identity"}}
    swarm.beside = None
    run(monitor, swarm, 15.1, 30.0)
    assert monitor.alarms == []


def test_a_station_that_starts_in_mid_flight_waits_for_the_agents_to_be_found(fleet, autopilot):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.flying = {2: autopilot(2)}
    talking = swarm.talking.pop(2)
    run(monitor, swarm, 0.0, 3.0)
    assert monitor.alarms == []
    swarm.talking[2] = talking
    run(monitor, swarm, 3.5, 20.0)
    assert monitor.alarms == []


def test_alarms_travel_with_ages(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    swarm.talking[1] = {"frame": 1}
    run(monitor, swarm, 10.0, 12.0)
    (told,) = on_the_wire(monitor.alarms, 15.0)
    assert (told.drone, told.code, told.age_s) == (1, "frame", 5.0)


def test_without_patience_it_judges_at_first_sight(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits(), patience=0.0)
    swarm.talking[1] = {"battery_fraction": 0.1}
    monitor.step(0.0, swarm.tick(0.0))
    assert codes(monitor) == {1: {"battery"}}


CRASH = "fell and hit the ground at 9.8 m/s, at 28.272490, -16.642296"


def test_a_crash_that_its_agent_tells_is_one_critical_alarm_with_the_place(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    run(monitor, swarm, 0.0, 5.0)
    swarm.talking[2] = {"phase": Phase.CRASHED, "airborne": False, "crash": CRASH}
    changes = run(monitor, swarm, 5.5, 20.0)
    (alarm,) = monitor.alarms
    assert (alarm.drone, alarm.code, alarm.severity) == (2, "crash", Severity.CRITICAL)
    assert alarm.text == f"crashed: {CRASH}; still armed, its propellers may turn"
    assert sum(len(change.raised) for change in changes) == 1
    swarm.talking[2] |= {"armed": False}
    run(monitor, swarm, 20.5, 22.0)
    assert [alarm.text for alarm in monitor.alarms] == [f"crashed: {CRASH}"]
    (row,) = (row for row in swarm.tick(22.5).rows(22.5) if row.drone == 2)
    assert (row.crash, row.phase, row.airborne) == (CRASH, "crashed", False)


def test_a_crash_that_took_the_agent_with_it_is_seen_over_mavlink(fleet, autopilot):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    vehicle = swarm.flying[2] = autopilot(2)
    run(monitor, swarm, 0.0, 5.0)
    del swarm.talking[2]
    vehicle.up_m = 0.0
    said = vehicle.frame(mavlink.MAVLink_statustext_message(0, b"Crash: Disarming", 0, 0))
    whole = vehicle.everything
    vehicle.everything = lambda: whole() + said
    run(monitor, swarm, 5.5, 12.0)
    alarms = {alarm.code: alarm for alarm in monitor.alarms}
    assert set(alarms) == {"crash", "agent_silent"}, (
        "neither lost nor an orphan: nobody is to send a wreck home"
    )
    assert alarms["crash"].text.startswith('crashed: the autopilot says "Crash: Disarming", at 28.27')


def test_a_drone_that_does_not_go_where_it_is_sent_is_an_alarm_until_it_does(fleet):
    swarm, monitor = fleet(), Monitor(AlarmLimits())
    text = "does not go where it is sent: asked for 4.0 m/s towards 010 degrees, flies nothing"
    swarm.talking[1] = {"astray": text}
    run(monitor, swarm, 0.0, 5.0)
    (alarm,) = monitor.alarms
    assert (alarm.drone, alarm.code, alarm.text) == (1, "astray", text)
    swarm.talking[1] = {}
    changes = run(monitor, swarm, 5.5, 10.0)
    (over,) = (alarm for change in changes for alarm in change.cleared)
    assert ended(over) == "it goes where it is sent again, or is not steered any more"


def test_every_alarm_has_words_for_its_end():
    source = inspect.getsource(Monitor)
    codes = set(re.findall(r'Condition\(f?"([a-z_]+)[":]', source))
    assert codes - ENDS.keys() == set()
    assert not any(text.startswith("over") for text in ENDS.values())
