"""MAVLink's services as both flavours offer them: messages, parameters, lists, routing, odd requests."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic
from simvehicle.autopilot.fences import Area, FenceError, areas_of, outside
from simvehicle.autopilot.missions import StoredItem
from simvehicle.autopilot.parameters import Parameters, UnknownParameterError
from simvehicle.drone.instrument_lines import felt_wind_mps

MakeGround = Callable[..., Any]
FLAVOURS = pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4


def item(
    sequence: int, command: int = 16, kind: int = 0, p1: float = 0.0, x: int = 0, y: int = 0, z: float = 10.0
) -> Any:
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    x, y = x or -50600000 + 100 * sequence, y or 1513000000
    return mavlink.MAVLink_mission_item_int_message(
        7, 1, sequence, frame, command, 0, 1, p1, 0, 0, 0, x, y, z, kind
    )


def upload(ground: Any, items: list[Any], kind: int = 0, limit_s: float = 20.0) -> int:
    """As a ground station does it: answer what is asked for; MAV_MISSION_RESULT."""
    before, end_s = len(ground.heard), ground.now_s + limit_s
    ground.send(mavlink.MAVLink_mission_count_message(7, 1, len(items), kind))
    while True:
        news, before = ground.heard[before:], len(ground.heard)
        for message in news:
            if message.get_type() == "MISSION_ACK":
                return int(message.type)
            if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                ground.send(items[message.seq])
        if len(ground.heard) == before:
            assert ground.now_s < end_s
            ground.run(0.1)


def download(ground: Any, kind: int = 0) -> list[Any]:
    ground.send(mavlink.MAVLink_mission_request_list_message(7, 1, kind))
    count = ground.of("MISSION_COUNT")[-1].count
    for sequence in range(count):
        ground.send(mavlink.MAVLink_mission_request_int_message(7, 1, sequence, kind))
    return ground.of("MISSION_ITEM_INT")[-count:] if count else []


# -- messages -----------------------------------------------------------------------------------------------


def test_ardupilot_streams_nothing_that_was_not_asked_for(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.run(12.0)
    assert {m.get_type() for m in ground.heard} == {
        "HEARTBEAT",
        "STATUSTEXT",
        "TIMESYNC",
        "HOME_POSITION",
        "GPS_GLOBAL_ORIGIN",
    }


@FLAVOURS
def test_every_message_comes_at_its_rate_on_the_link_that_asked(
    flavour: str, make_ground: MakeGround
) -> None:
    ground = make_ground(flavour, links=2)
    ground.take_off()
    assert ground.command(511, 32, 100_000) == ACCEPTED
    assert ground.command(511, 32, 500_000, link=1) == ACCEPTED
    first, second = (
        sum(m.get_type() == "LOCAL_POSITION_NED" for m in ground.heard_by_link[link]) for link in (0, 1)
    )
    ground.run(10.0)
    assert len(ground.of("LOCAL_POSITION_NED")) - first == pytest.approx(100, abs=1)
    on_second = sum(m.get_type() == "LOCAL_POSITION_NED" for m in ground.heard_by_link[1])
    assert on_second - second == pytest.approx(20, abs=1)
    ground.command(510, 32)
    assert ground.of("MESSAGE_INTERVAL")[-1].interval_us == 100_000
    ground.command(511, 32, -1)
    count = len(ground.of("LOCAL_POSITION_NED"))
    ground.run(2.0)
    assert len(ground.of("LOCAL_POSITION_NED")) == count


@FLAVOURS
def test_every_message_that_can_be_asked_for_can_be_encoded(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour, EKF2_DRAG_CTRL=1.0) if flavour == "px4" else make_ground(flavour)
    messages = set(ground.vehicle.autopilot.streams.messages)
    for _ in range(2):  # before anything is known, and in flight
        for message_id in messages:
            assert ground.command(512, message_id) in (0, 1)
        if not ground.vehicle.airborne:
            ground.take_off()
    heard = {m.get_msgId() for m in ground.heard}
    # What the flavour does not send, and what pymavlink cannot read.
    foreign = {"ardupilot": {231}, "px4": {162, 168, 193, 436}}[flavour]
    assert messages - heard <= foreign
    assert ground.command(512, 11000) in (UNSUPPORTED, FAILED)
    assert ground.command(511, 11000, 1e6) == (FAILED if flavour == "px4" else DENIED)


def test_data_streams_are_groups(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot")
    ground.run(8.0)
    ground.send(mavlink.MAVLink_request_data_stream_message(7, 1, mavlink.MAV_DATA_STREAM_POSITION, 4, 1))
    ground.run(5.0)
    assert len(ground.of("GLOBAL_POSITION_INT")) == pytest.approx(20, abs=1)
    assert not ground.of("ATTITUDE")
    ground.send(mavlink.MAVLink_request_data_stream_message(7, 1, mavlink.MAV_DATA_STREAM_ALL, 0, 0))
    count = len(ground.of("GLOBAL_POSITION_INT"))
    ground.run(2.0)
    assert len(ground.of("GLOBAL_POSITION_INT")) == count


@FLAVOURS
def test_telemetry_tells_the_truth(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour, wind_mps=6.0)
    ground.take_off(12.0)
    for message_id in (30, 31, 32, 33, 147):
        ground.command(511, message_id, 100_000)
    ground.run(5.0)
    vehicle = ground.vehicle
    local, position = ground.of("LOCAL_POSITION_NED")[-1], ground.of("GLOBAL_POSITION_INT")[-1]
    assert math.dist((local.x, local.y, local.z), vehicle.position_ned_m) < 1.0
    assert position.relative_alt / 1000 == pytest.approx(12.0, abs=0.8)
    assert position.alt / 1000 == pytest.approx(512.0, abs=1.0)
    attitude = ground.of("ATTITUDE")[-1]
    assert (attitude.roll, attitude.pitch, attitude.yaw) == pytest.approx(vehicle.attitude_rad, abs=0.05)
    quaternion = ground.of("ATTITUDE_QUATERNION")[-1]
    assert (quaternion.q1, quaternion.q2, quaternion.q3, quaternion.q4) == pytest.approx(
        vehicle.attitude_quaternion, abs=0.05
    )
    assert ground.of("BATTERY_STATUS")[-1].battery_remaining == round(100 * vehicle.battery_fraction)
    wind = vehicle.autopilot.vehicle.world.wind.wind_ned_mps(vehicle.position_ned_m, ground.now_s)
    felt = felt_wind_mps(wind, vehicle.velocity_ned_mps, vehicle.attitude_rad)
    assert felt[0] == pytest.approx(6.0, abs=1.5), "heading north, wind from the south"


@FLAVOURS
def test_equal_seeds_give_equal_flights(flavour: str, make_ground: MakeGround) -> None:
    def flight(seed: int) -> list[tuple[float, ...]]:
        ground = make_ground(flavour, seed=seed)
        ground.take_off()
        ground.run(5.0)
        return [(m.x, m.y, m.z) for m in ground.of("LOCAL_POSITION_NED")] + [ground.vehicle.position_ned_m]

    assert flight(1) == flight(1)
    assert flight(1) != flight(2)


def test_steps_of_any_size_give_the_same_flight(make_ground: MakeGround) -> None:
    def position(steps: int) -> tuple[float, float, float]:
        ground = make_ground("ardupilot")
        ground.take_off()
        start_s = ground.now_s
        for step in range(1, steps + 1):
            ground.vehicle.step(start_s + 6.0 * step / steps)
        return ground.vehicle.position_ned_m

    assert position(7) == position(300)


# -- odd requests -------------------------------------------------------------------------------------------


@FLAVOURS
def test_answers_to_what_is_unknown_or_link_services(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.run(1.0)
    assert ground.command(31999) == UNSUPPORTED
    ground.send(mavlink.MAVLink_timesync_message(0, 12345))
    assert ground.of("TIMESYNC")[-1].ts1 == 12345
    ground.send(mavlink.MAVLink_ping_message(5, 6, 0, 0))
    ping = ground.of("PING")[-1]
    assert (ping.time_usec, ping.seq, ping.target_system, ping.target_component) == (5, 6, 255, 190)
    ground.send(mavlink.MAVLink_log_request_list_message(7, 1, 0, 0xFFFF))
    assert ground.of("LOG_ENTRY")[-1].num_logs == 0
    request = bytearray(251)
    request[0:2], request[3] = (41).to_bytes(2, "little"), 4  # open a file to read
    ground.send(mavlink.MAVLink_file_transfer_protocol_message(0, 7, 1, list(request)))
    reply = bytes(ground.of("FILE_TRANSFER_PROTOCOL")[-1].payload)
    assert int.from_bytes(reply[0:2], "little") == 42
    assert (reply[3], reply[4], reply[5], reply[12]) == (129, 1, 4, 10)


@FLAVOURS
def test_what_is_meant_for_others_is_left_alone_and_handed_on(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour, links=2)
    ground.run(2.0)  # our own heartbeat has been heard
    ground.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 0, 3), link=1, sender=(7, 191))
    from_companion = [m for m in ground.heard if m.get_srcComponent() == 191]
    assert [m.get_type() for m in from_companion] == ["HEARTBEAT"]
    ground.heard_by_link[1].clear()
    ground.send(mavlink.MAVLink_command_long_message(7, 191, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    ground.send(mavlink.MAVLink_command_long_message(8, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert [m.get_type() for m in ground.heard_by_link[1]] == ["COMMAND_LONG"]
    assert not ground.of("COMMAND_ACK")
    assert not ground.vehicle.armed


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=300), flavour=st.sampled_from(["ardupilot", "px4"]))
def test_noise_on_the_line_does_no_harm(make_ground: MakeGround, data: bytes, flavour: str) -> None:
    ground = make_ground(flavour)
    ground.run(1.0)
    ground.vehicle.receive(0, data)
    ground.vehicle.receive(0, bytes(300))
    ground.run(1.0)
    assert ground.command(512, 148) == ACCEPTED


COMMANDS = (
    *(16, 17, 20, 21, 22, 115, 176, 178, 179, 183, 185, 192, 193, 207, 224, 241, 246),
    *(300, 400, 401, 410, 510, 511, 512, 520),
)
_NUMBERS = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 2.0, 1e30]), st.floats(width=32)
)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    flavour=st.sampled_from(["ardupilot", "px4"]),
    number=st.sampled_from(COMMANDS),
    params=st.lists(_NUMBERS, min_size=7, max_size=7),
    frame=st.integers(0, 21),
)
def test_no_command_can_break_it(
    make_ground: MakeGround, flavour: str, number: int, params: list[float], frame: int
) -> None:
    ground = make_ground(flavour, ready_after_s=0.5)
    ground.run(2.0)
    assert 0 <= ground.command(number, *params) <= 9
    p1, p2, p3, p4, *_ = params
    place = (max(-200.0, min(200.0, n)) if math.isfinite(n) else 0.0 for n in params[4:6])
    assert 0 <= ground.command_int(number, frame, p1, p2, p3, p4, *place, params[6]) <= 9
    ground.run(1.0)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    flavour=st.sampled_from(["ardupilot", "px4"]),
    mask=st.integers(0, 0xFFFF),
    frame=st.integers(0, 21),
    numbers=st.lists(_NUMBERS, min_size=11, max_size=11),
)
def test_no_setpoint_can_break_it(
    make_ground: MakeGround, flavour: str, mask: int, frame: int, numbers: list[float]
) -> None:
    ground = make_ground(flavour, ready_after_s=0.5)
    ground.run(2.0)
    ground.command(400, 1)
    ground.mode(4) if flavour == "ardupilot" else ground.mode(6, 0)
    for _ in range(3):
        ground.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 7, 1, frame, mask, *numbers))
        ground.run(0.3)
    assert all(math.isfinite(n) for n in ground.vehicle.position_ned_m)


# -- parameters ---------------------------------------------------------------------------------------------


@FLAVOURS
def test_the_whole_list_arrives(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.run(1.0)
    ground.send(mavlink.MAVLink_param_request_list_message(7, 1))
    ground.run(2.0)
    values = [value for value in ground.of("PARAM_VALUE") if value.param_id != "_HASH_CHECK"]
    assert sorted(v.param_index for v in values) == list(range(values[0].param_count))
    assert len({v.param_id for v in values}) == values[0].param_count
    ground.send(mavlink.MAVLink_param_request_read_message(7, 1, b"", 3))
    assert ground.of("PARAM_VALUE")[-1].param_id == values[3].param_id


def test_setting_a_parameter_is_told_to_all_and_changes_the_flight(make_ground: MakeGround) -> None:
    ground = make_ground("ardupilot", links=2)
    ground.take_off()
    ground.set_parameter("WPNAV_SPEED", 300.0)
    for link in (0, 1):
        last = [m for m in ground.heard_by_link[link] if m.get_type() == "PARAM_VALUE"][-1]
        assert (last.param_id, last.param_value, last.param_index) == ("WPNAV_SPEED", 300.0, 65535)
    ground.position_target(60.0, 0.0, -10.0)
    ground.run(10.0)
    assert ground.vehicle.velocity_ned_mps[0] == pytest.approx(3.0, abs=0.3)
    count = len(ground.of("PARAM_VALUE"))
    ground.set_parameter("NO_SUCH", 1.0)
    assert len(ground.of("PARAM_VALUE")) == count, "ArduPilot says nothing, as recorded"


@given(value=st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_parameters_fit_their_types(value: float) -> None:
    for flavour, whole, real in (
        ("ardupilot", "FENCE_ACTION", "WPNAV_SPEED"),
        ("px4", "GF_ACTION", "MPC_XY_CRUISE"),
    ):
        parameters = Parameters(flavour, {})  # type: ignore[arg-type]
        parameters.set(whole, value)
        assert parameters[whole] == int(parameters[whole])
        encoded, kind = parameters.encoded(whole)
        assert parameters.decoded(whole, encoded, kind) == parameters[whole] or math.isnan(encoded)
        parameters.set(real, value)
        assert parameters[real] == value


def test_overrides_have_to_exist() -> None:
    with pytest.raises(UnknownParameterError, match="NO_SUCH"):
        Parameters("px4", {"NO_SUCH": 1.0})


# -- lists --------------------------------------------------------------------------------------------------


@FLAVOURS
def test_lists_come_back_as_they_went_up(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.run(6.0)
    for kind, command, p1 in ((0, 16, 2.0), (1, 5003, 30.0), (2, 5100, 0.0)):
        sent = [item(n, command, kind, p1) for n in range(4)]
        assert upload(ground, sent, kind) == mavlink.MAV_MISSION_ACCEPTED
        skip = 1 if (flavour, kind) == ("ardupilot", 0) else 0  # item 0 is home
        back = download(ground, kind)[skip:]
        assert [(m.command, m.param1, m.x, m.y, m.z) for m in back] == [
            (m.command, m.param1, m.x, m.y, m.z) for m in sent[skip:]
        ]
        ground.send(mavlink.MAVLink_mission_clear_all_message(7, 1, kind))
        assert download(ground, kind) == []


@FLAVOURS
def test_a_lost_item_is_asked_for_again_and_a_lost_client_is_given_up(
    flavour: str, make_ground: MakeGround
) -> None:
    ground = make_ground(flavour)
    ground.run(6.0)
    ground.send(mavlink.MAVLink_mission_count_message(7, 1, 3, 0))
    ground.run(2.5)
    requests = ground.of("MISSION_REQUEST") + ground.of("MISSION_REQUEST_INT")
    assert [m.seq for m in requests] == [0, 0, 0]
    ground.run(8.0)
    assert ground.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert upload(ground, [item(n) for n in range(3)]) == mavlink.MAV_MISSION_ACCEPTED


@FLAVOURS
def test_a_broken_upload_spares_the_old_list_only_on_px4(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.run(6.0)
    upload(ground, [item(n, z=10.0) for n in range(5)])
    ground.send(mavlink.MAVLink_mission_count_message(7, 1, 3, 0))
    ground.send(item(0, z=20.0))
    ground.send(item(1, z=20.0))
    ground.run(9.0)
    heights = [m.z for m in download(ground)]
    assert heights[1:] == ([20.0, 10.0] if flavour == "ardupilot" else [10.0] * 4)


@FLAVOURS
def test_two_clients_do_not_mix(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.run(6.0)
    ground.send(mavlink.MAVLink_mission_count_message(7, 1, 2, 0))
    ground.send(mavlink.MAVLink_mission_count_message(7, 1, 9, 0), sender=(254, 190))
    ack = ground.of("MISSION_ACK")[-1]
    assert (ack.type, ack.target_system) == (mavlink.MAV_MISSION_DENIED, 254)
    ground.send(item(0), sender=(254, 190))
    assert ground.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_ERROR
    ground.send(item(0))
    ground.send(item(1))
    assert ground.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_ACCEPTED


@FLAVOURS
def test_items_that_cannot_be_flown_are_refused(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.run(6.0)
    assert upload(ground, [item(0, command=4242)]) == mavlink.MAV_MISSION_UNSUPPORTED
    assert upload(ground, [item(0, x=2_000_000_000)]) == mavlink.MAV_MISSION_INVALID_PARAM5_X
    broken = upload(ground, [item(n, 5001, 1, 4.0) for n in range(2)], 1)
    if flavour == "ardupilot":
        assert broken == mavlink.MAV_MISSION_INVALID_PARAM1
    else:
        assert broken == mavlink.MAV_MISSION_ACCEPTED
        ground.run(0.5)
        assert "Geofence invalid, doesn't contain Home position" in ground.texts()
    ground.send(mavlink.MAVLink_mission_request_int_message(7, 1, 77, 0))
    assert ground.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_INVALID_SEQUENCE


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    flavour=st.sampled_from(["ardupilot", "px4"]), lost=st.sets(st.integers(0, 60)), count=st.integers(1, 12)
)
def test_uploads_survive_a_lossy_link(
    make_ground: MakeGround, flavour: str, lost: set[int], count: int
) -> None:
    """Any of the ground's messages may be lost, as long as it answers every request that it gets."""
    ground = make_ground(flavour)
    ground.run(6.0)
    real_send, sent = ground.send, 0

    def lossy(message: Any, *args: Any, **kwargs: Any) -> None:
        nonlocal sent
        sent += 1
        if message.get_type() != "MISSION_ITEM_INT" or sent not in lost:
            real_send(message, *args, **kwargs)

    ground.send = lossy
    result = upload(ground, [item(n) for n in range(count)], limit_s=100.0)
    assert result == mavlink.MAV_MISSION_ACCEPTED
    ground.send = real_send
    assert len(download(ground)) == count


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    flavour=st.sampled_from(["ardupilot", "px4"]),
    kind=st.sampled_from([0, 1, 2]),
    command=st.sampled_from([16, 17, 19, 20, 21, 22, 82, 93, 177, 178, 5001, 5002, 5003, 5004, 5100]),
    frame=st.integers(0, 21),
    numbers=st.lists(_NUMBERS, min_size=5, max_size=5),
    x=st.integers(-(2**31), 2**31 - 1),
)
def test_no_item_can_break_it(
    make_ground: MakeGround, flavour: str, kind: int, command: int, frame: int, numbers: list[float], x: int
) -> None:
    ground = make_ground(flavour, ready_after_s=0.5)
    ground.run(2.0)
    p1, p2, p3, p4, z = numbers
    items = [
        mavlink.MAVLink_mission_item_int_message(7, 1, n, frame, command, 0, 1, p1, p2, p3, p4, x, x, z, kind)
        for n in range(3)
    ]
    upload(ground, items, kind)
    download(ground, kind)
    ground.command(400, 1)
    ground.mode(3) if flavour == "ardupilot" else ground.mode(4, 4)
    ground.run(3.0)
    assert all(math.isfinite(n) for n in ground.vehicle.position_ned_m)


@FLAVOURS
def test_missions_are_flown_with_speed_changes_jumps_and_delays(
    flavour: str, make_ground: MakeGround
) -> None:
    ground = make_ground(flavour, RTL_LOIT_TIME=500.0) if flavour == "ardupilot" else make_ground(flavour)
    ground.command(511, 42, 500_000)
    ground.take_off()
    north = [-50600000 + int(n / 0.0110574) for n in (0, 0, 20, 40)]
    items = [
        item(0, 16),
        item(1, mavlink.MAV_CMD_DO_CHANGE_SPEED, p1=1.0),
        item(2, 16, x=north[2], p1=3.0),
        item(3, 16, x=north[3]),
        item(4, mavlink.MAV_CMD_DO_JUMP, p1=2.0),
        item(5, mavlink.MAV_CMD_NAV_DELAY, p1=2.0),
    ]
    items[1].param2 = 4.0
    items[4].param2 = 1.0  # once
    assert upload(ground, items) == mavlink.MAV_MISSION_ACCEPTED
    fastest = 0.0

    def look() -> None:
        nonlocal fastest
        fastest = max(fastest, math.hypot(*ground.vehicle.velocity_ned_mps[:2]))

    if flavour == "ardupilot":
        ground.mode(3)
    else:
        assert ground.command(300) == ACCEPTED
    ground.run_until(lambda: ground.vehicle.autopilot.personality.progress.complete, each=look)
    reached = [seq for seq, _ in itertools.groupby(m.seq for m in ground.of("MISSION_ITEM_REACHED"))]
    assert reached == [2, 3, 2, 3, 5] if flavour == "ardupilot" else reached == [0, 2, 3, 2, 3, 5]
    assert 3.5 < fastest < 5.0
    ground.run(2.0)
    assert ground.of("MISSION_CURRENT")[-1].mission_state == mavlink.MISSION_STATE_COMPLETE


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_mission_that_is_cleared_while_it_is_flown_is_over(flavour: str, make_ground: MakeGround) -> None:
    ground = make_ground(flavour)
    ground.take_off()
    assert upload(ground, [item(n, 16, x=-50500000) for n in range(3)]) == mavlink.MAV_MISSION_ACCEPTED
    if flavour == "ardupilot":
        ground.mode(3)
    else:
        assert ground.command(300) == ACCEPTED
    ground.run(3.0)
    ground.send(mavlink.MAVLink_mission_clear_all_message(7, 1, 0))
    ground.run(10.0)
    assert ground.vehicle.airborne
    assert math.hypot(*ground.vehicle.velocity_ned_mps[:2]) < 0.5


def test_pausing_and_resuming_a_mission(make_ground: MakeGround) -> None:
    ground = make_ground("px4")
    ground.take_off()
    upload(ground, [item(0, x=-50596000), item(1, x=-50594000)])
    ground.command(300)
    ground.run(5.0)
    assert ground.command(193, 0) == ACCEPTED
    ground.run(5.0)
    assert math.hypot(*ground.vehicle.velocity_ned_mps) < 0.4
    assert ground.command(193, 1) == ACCEPTED
    ground.run_until(lambda: ground.vehicle.autopilot.personality.progress.complete)
    assert ground.vehicle.mode == "HOLD"


# -- fences -------------------------------------------------------------------------------------------------


def fence_items(corners: list[tuple[float, float]], command: int) -> list[StoredItem]:
    return [
        StoredItem(3, command, float(len(corners)), 0.0, 0.0, 0.0, round(n * 100), round(e * 100), 0.0)
        for n, e in corners
    ]


def flat(point: Geodetic) -> tuple[float, float, float]:
    """A local frame for tests in which a degree is 100 km: 1e-7 degrees are a centimetre."""
    return point.latitude_deg * 1e5, point.longitude_deg * 1e5, 0.0


@settings(max_examples=60, deadline=None)
@given(
    angles=st.lists(st.floats(0.05, 1.0), min_size=3, max_size=9),
    radii=st.lists(st.floats(20.0, 100.0), min_size=9, max_size=9),
    north=st.floats(-120.0, 120.0),
    east=st.floats(-120.0, 120.0),
    clockwise=st.booleans(),
)
def test_polygons_contain_what_shapely_says(
    angles: list[float], radii: list[float], north: float, east: float, clockwise: bool
) -> None:
    """Star-shaped polygons, convex or not, in both directions."""
    total, angle, corners = sum(angles), 0.0, []
    for step, radius in zip(angles, radii, strict=False):
        angle += step / total * math.tau
        corners.append((round(radius * math.cos(angle), 2), round(radius * math.sin(angle), 2)))
    if clockwise:
        corners.reverse()
    (area,) = areas_of(fence_items(corners, mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION), flat)
    polygon = shapely.Polygon(corners)
    if polygon.is_valid and polygon.exterior.distance(shapely.Point(north, east)) > 0.01:
        assert area.contains(north, east) == polygon.contains(shapely.Point(north, east))


def test_exclusions_and_unions() -> None:
    left, right = (
        Area(True, center_m=(0.0, -30.0), radius_m=40.0),
        Area(True, center_m=(0.0, 30.0), radius_m=40.0),
    )
    hole = Area(False, center_m=(0.0, 0.0), radius_m=5.0)
    assert outside([left, right], 0.0, 50.0, any_inclusion=False)
    assert not outside([left, right], 0.0, 50.0, any_inclusion=True)
    assert not outside([left, right], 0.0, 8.0, any_inclusion=False)
    assert outside([left, right, hole], 0.0, 3.0, any_inclusion=True)
    assert not outside([], 1e6, 0.0, any_inclusion=False)


def test_impossible_fences_are_refused() -> None:
    circle = StoredItem(0, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, -1.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    with pytest.raises(FenceError, match="radius"):
        areas_of([circle], flat)
    corners = fence_items([(0, 0), (0, 1), (1, 1)], mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
    with pytest.raises(FenceError, match="vertices"):
        areas_of([*corners[:2], dataclasses.replace(corners[2], command=5001)], flat)
    with pytest.raises(FenceError, match="not a fence"):
        areas_of([dataclasses.replace(circle, command=16)], flat)
