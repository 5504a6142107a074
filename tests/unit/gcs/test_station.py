"""The station's core, tick by tick: what it sends, tells and records, without any I/O."""

from __future__ import annotations

import itertools

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.swarm import topics
from flightstack.swarm.wire import Command, CommandName, Event, GroundBeat, Phase, Result, Severity
from flightstack.transport.memory import MemoryRadio
from gcs.connection import RECEIVED
from gcs.station import Station


class Surroundings:
    """A station with agents on its radio and vehicles on its link, at 10 Hz of simulated time."""

    def __init__(self, config, state, on_air):
        self.station = Station(config, None, 0.0)
        self.state, self.on_air = state, on_air
        self.radio = MemoryRadio()
        self.nodes = {"ground": self.radio.join("ground", RECEIVED)}
        self.agents = {1: {}, 2: {}, 3: {}}
        self.vehicles = []
        self.beside = None
        self.published = []
        self.sent = []
        self.sequences = []
        self.timeline = []
        self.frames = []
        self.log = []
        self._tick = itertools.count()
        self._reader = MavlinkCodec(1, 1, events=mavlink.mavlink_map.keys())
        self.now_s = 0.0

    def say(self, message):
        """Put a message on the air as its sender."""
        topic, sender, payload = self.on_air(message)
        if sender not in self.nodes:
            self.nodes[sender] = self.radio.join(sender, ())
        self.nodes[sender].publish(topic, payload)

    def run(self, seconds, *messages):
        for index in range(round(seconds * 10)):
            tick = next(self._tick)
            self.now_s = tick / 10
            for message in messages if index == 0 else ():
                self.say(message)
            if tick % 2 == 0:
                for drone, changes in self.agents.items():
                    self.say(self.state(drone, sequence=tick, **changes))
            self.radio.step(self.now_s)
            data = b"".join(v.everything() for v in self.vehicles) if tick % 5 == 0 else b""
            if self.beside is not None and tick % 5 == 0:
                data += self.beside()
            outputs = self.station.step(self.now_s, self.nodes["ground"].receive(), [data])
            self.published += [(self.now_s, topic, message) for topic, message in outputs.publish]
            for frame, message in self._reader.receive_frames(self.now_s, outputs.writes[0]):
                self.sequences.append(frame.sequence)
                self.sent.append((self.now_s, message))
            self.timeline += outputs.timeline
            self.frames += outputs.frames
            self.log += outputs.log

    def told(self, topic):
        return [message for _, t, message in self.published if t is topic]

    def commands(self, number):
        commands = [(at, m.fields) for at, m in self.sent if m.name == "COMMAND_LONG"]
        return [(at, fields) for at, fields in commands if fields.command == number]


@pytest.fixture
def world(ground_config, state, on_air):
    return Surroundings(ground_config, state, on_air)


def test_heartbeats_and_beats_once_a_second(world):
    world.run(10.0)
    beats = [m for _, m in world.sent if m.name == "HEARTBEAT"]
    assert len(beats) == 10
    assert {(m.fields.type, m.fields.autopilot, m.system, m.component) for m in beats} == {(6, 8, 255, 190)}
    assert world.sequences == list(range(10))
    assert len(world.told(topics.GROUND)) == 10
    assert len(world.told(topics.REPORT)) == 10
    assert world.told(topics.TRAFFIC) == []


def test_asks_for_few_streams_and_asks_again_when_they_stop(world, autopilot):
    vehicle = autopilot(2)
    quiet = autopilot(2)
    quiet.everything = vehicle.heartbeat
    world.vehicles = [quiet]
    world.run(5.0)
    asked = {int(m.param1): m.param2 for _, m in world.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)}
    assert asked == {33: 250_000, 1: 1_000_000, 245: 1_000_000}
    assert {int(m.param1) for _, m in world.commands(mavlink.MAV_CMD_REQUEST_MESSAGE)} == {242}
    assert {
        (m.fields.target_system, m.fields.target_component) for _, m in world.sent if m.name == "COMMAND_LONG"
    } == {(2, 1)}
    world.vehicles = [vehicle]
    world.run(2.0)
    world.sent.clear()
    world.run(20.0)
    assert world.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL) == [], "what comes is not asked for"
    world.vehicles = [quiet]
    world.run(5.0)
    assert world.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL), "after a restart of the autopilot"


def test_a_vehicle_that_never_sends_is_not_flooded(world, autopilot):
    vehicle = autopilot(2)
    vehicle.everything = vehicle.heartbeat
    world.vehicles = [vehicle]
    world.run(120.0)
    assert len(world.commands(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)) < 60


def test_an_orphan_becomes_traffic_and_is_called_home(world, autopilot):
    vehicle = autopilot(2)
    world.vehicles = [vehicle]
    world.run(10.0)
    assert world.told(topics.TRAFFIC) == []
    del world.agents[2]
    world.run(10.0)
    told = world.told(topics.TRAFFIC)
    assert 25 <= len(told) <= 35, "4 a second from 2 s after the last word"
    assert told[-1].vehicles[0].drone == 2
    assert told[-1].vehicles[0].position_ned_m == pytest.approx((10.0, 20.0, -12.0), abs=0.1)
    modes = world.commands(mavlink.MAV_CMD_DO_SET_MODE)
    assert modes[0][0] == pytest.approx(15.0, abs=0.5)
    assert modes[0][1].param2 == 6.0
    vehicle.mode = 6
    world.run(2.0)
    world.sent.clear()
    vehicle.armed = False
    world.run(5.0)
    assert world.commands(mavlink.MAV_CMD_DO_SET_MODE) == []
    codes = [event.code for event in world.told(topics.EVENT)]
    assert "orphan" in codes
    assert codes.count("bring_home") == 3
    said = [entry.message.text for entry in world.timeline if entry.topic == "/action"]
    assert any("commanded to return" in text for text in said)
    assert world.told(topics.TRAFFIC)[-1] is not None
    report = world.told(topics.REPORT)[-1]
    assert [v.mode for v in report.vehicles] == ["RTL"]


def test_each_part_of_a_swarm_that_came_apart_is_told_where_the_other_is(world, autopilot, table):
    """We hear both; they do not hear each other."""
    world.vehicles = [autopilot(2)]
    for _ in range(10):
        world.run(1.0, table(1, (1, 2, 3)), table(2, (1, 2, 3)))
    assert world.told(topics.TRAFFIC) == []
    for _ in range(2):
        world.run(1.0, table(1, (1, 3)), table(2, (2,)))
    assert [vehicle.drone for vehicle in world.told(topics.TRAFFIC)[-1].vehicles] == [2]


def test_alarms_are_events_once_and_reported_every_second(world):
    world.agents[1] = {"battery_fraction": 0.1}
    world.run(10.0)
    alarms = [e for e in world.told(topics.EVENT) if e.code == "battery"]
    assert len(alarms) == 1
    assert any(a.code == "battery" for a in world.told(topics.REPORT)[-1].alarms)
    world.agents[1] = {}
    world.run(5.0)
    texts = [e.text for e in world.told(topics.EVENT) if e.code == "battery"]
    assert texts[1:] == ["its battery is above the limit again"]
    assert world.told(topics.REPORT)[-1].alarms == ()


def test_everything_heard_is_on_the_timeline_and_frames_go_to_their_vehicles_logs(world, autopilot):
    world.vehicles = [autopilot(2), autopilot(3)]
    world.run(2.0, Command("id-1", "op", 0, CommandName.PAUSE))
    heard = {entry.topic for entry in world.timeline}
    assert {"/state/1", "/state/2", "/state/3", "/command/op"} <= heard
    systems = {frame.system for frame in world.frames}
    assert systems == {2, 3}
    for frame in world.frames:
        (message,) = MavlinkCodec(1, 1, events=mavlink.mavlink_map.keys()).receive(0.0, frame.data)
        assert frame.system in (message.system, getattr(message.fields, "target_system", None))
    for entry in world.timeline:
        msgspec.json.encode(entry.message)


def outcomes(world):
    return {o.sender: o for o in world.told(topics.OUTCOME)}


def test_the_operators_rtl_reaches_a_vehicle_whose_agent_is_silent(world, autopilot):
    vehicle = autopilot(2)
    world.vehicles = [vehicle, autopilot(1)]
    world.run(10.0)
    del world.agents[2]
    world.run(4.0)
    world.run(0.5, Command("id-1", "op", 0, CommandName.LAND))
    modes = world.commands(mavlink.MAV_CMD_DO_SET_MODE)
    assert [(m.target_system, m.param2) for _, m in modes] == [(2, 9.0)]
    assert outcomes(world) == {}
    vehicle.mode = 9
    world.run(1.0)
    answer = outcomes(world)[2]
    assert (answer.command, answer.result) == ("id-1", Result.ACCEPTED)
    assert "agent is silent" in answer.reason
    assert set(outcomes(world)) == {2}, "live agents answer for themselves"
    count = len(world.told(topics.OUTCOME))
    world.run(0.5, Command("id-1", "op", 0, CommandName.LAND))
    assert len(world.told(topics.OUTCOME)) == count + 1, "asked again, answered again"


def test_an_autopilot_that_does_not_obey_is_told_as_such(world, autopilot):
    world.vehicles = [autopilot(2)]
    world.run(10.0)
    del world.agents[2]
    world.run(4.0)
    world.run(5.0, Command("id-1", "op", 2, CommandName.RTL))
    assert outcomes(world)[2].result is Result.REFUSED


def test_a_command_to_all_leaves_a_pilots_vehicle_alone_and_one_by_name_does_not(world, autopilot):
    vehicle = autopilot(2)
    vehicle.mode = 5
    world.vehicles = [vehicle]
    world.agents[2] = {"phase": Phase.PILOT, "mode": "LOITER"}
    world.run(10.0)
    del world.agents[2]
    world.run(4.0)
    world.run(1.0, Command("id-1", "op", 0, CommandName.RTL))
    assert outcomes(world)[2].result is Result.REFUSED
    assert "--drone 2" in outcomes(world)[2].reason
    assert world.commands(mavlink.MAV_CMD_DO_SET_MODE) == []
    world.run(1.0, Command("id-2", "op", 2, CommandName.RTL))
    assert world.commands(mavlink.MAV_CMD_DO_SET_MODE)[0][1].param2 == 6.0


def test_a_silent_drone_on_the_ground_is_said_to_be_there(world, autopilot):
    vehicle = autopilot(2)
    vehicle.armed = False
    world.vehicles = [vehicle]
    world.agents[2] = {"phase": Phase.LANDED, "armed": False, "airborne": False}
    world.run(10.0)
    del world.agents[2]
    world.run(4.0)
    world.run(1.0, Command("id-1", "op", 0, CommandName.RTL))
    assert "disarmed" in outcomes(world)[2].reason


def test_start_is_for_agents_only(world, autopilot):
    world.vehicles = [autopilot(2)]
    world.run(10.0)
    del world.agents[2]
    world.run(4.0)
    world.run(5.0, Command("id-1", "op", 0, CommandName.START))
    assert outcomes(world) == {}


def test_status_texts_of_orphans_are_passed_on(world, autopilot):
    vehicle = autopilot(2)
    world.vehicles = [vehicle]
    world.run(10.0)
    del world.agents[2]
    world.run(4.0)
    text = mavlink.MAVLink_statustext_message(2, b"Battery failsafe")
    outputs = world.station.step(world.now_s + 0.2, [], [vehicle.frame(text)])
    events = [m for t, m in outputs.publish if t is topics.EVENT]
    assert ("statustext", "Battery failsafe") in [(e.code, e.text) for e in events]
    assert any(entry.topic == "/statustext/2" for entry in outputs.timeline)


def alarm_codes(world):
    return {(alarm.drone, alarm.code) for alarm in world.told(topics.REPORT)[-1].alarms}


def test_a_vehicle_that_is_no_member_is_sent_nothing_and_is_gone_when_it_is_gone(world, autopilot):
    world.vehicles = [autopilot(251)]
    world.run(10.0)
    assert (251, "foreign") in alarm_codes(world)
    assert [v.drone for v in world.told(topics.TRAFFIC)[-1].vehicles] == [251], "the drones keep clear of it"
    world.run(1.0, Command("op-1", "op", 251, CommandName.RTL))
    world.vehicles = []
    world.run(60.0)
    assert [m for _, m in world.sent if m.name != "HEARTBEAT"] == []
    (outcome,) = world.told(topics.OUTCOME)
    assert (outcome.sender, outcome.result) == (251, Result.REFUSED)
    assert "no member of this swarm" in outcome.reason
    assert alarm_codes(world) == set()
    assert world.told(topics.REPORT)[-1].vehicles == ()
    codes = {event.code for event in world.told(topics.EVENT) if event.sender == 251}
    assert codes == {"foreign"}


@pytest.mark.parametrize("kind", ["ping0", "ping8", "gimbal3", "copter154", "camera", "sys0"])
def test_what_else_is_on_the_link_changes_nothing_of_a_flying_drone(world, autopilot, neighbours, kind):
    """Also while its agent is silent: then the vehicle's own word is all that there is."""
    world.vehicles = [autopilot(1)]
    world.beside = lambda: neighbours.talkative(kind)
    world.run(10.0)
    assert alarm_codes(world) == set()
    del world.agents[1]
    world.run(4.0)
    assert alarm_codes(world) == {(1, "orphan")}
    (heard,) = world.told(topics.REPORT)[-1].vehicles
    assert (heard.drone, heard.mode, heard.airborne) == (1, "GUIDED", True)


def test_a_twin_that_comes_and_goes_sends_no_drone_home(world, autopilot, state):
    world.vehicles = [autopilot(1)]
    world.agents[1] = {"ticks": 9000}
    world.run(10.0)
    for tick in range(25):
        twin = state(
            1,
            incarnation=999,
            sequence=tick,
            phase=Phase.DISARMED,
            armed=False,
            airborne=False,
            position_ned_m=None,
        )
        world.run(0.2, twin)
    assert alarm_codes(world) == {(1, "identity")}
    world.run(60.0)
    assert alarm_codes(world) == set()
    assert world.commands(mavlink.MAV_CMD_DO_SET_MODE) == []


def rivals(world):
    return {code for _, code in alarm_codes(world) if code.startswith("station")}


def test_a_second_ground_station_of_our_name_is_told_while_it_is_heard(world):
    world.run(10.0)
    assert rivals(world) == set()
    other = world.radio.join("other", ())
    for number in range(8):
        other.publish(topics.GROUND, topics.GROUND.codec.encode(GroundBeat("ground", number, 254)))
        world.run(1.0)
    assert rivals(world) == {"station:name"}
    world.run(10.0)
    assert rivals(world) == set()


def test_a_second_ground_station_of_our_system_id_is_told_by_the_network_or_the_link(world, neighbours):
    for number in range(8):
        world.run(1.0, GroundBeat("truck", number, 254))
    assert rivals(world) == set()
    for number in range(8):
        world.run(1.0, GroundBeat("truck", 100 + number, 255))
    assert rivals(world) == {"station:system"}
    world.run(10.0)
    assert rivals(world) == set()
    world.beside = lambda: neighbours.heartbeat("qgc")
    world.run(8.0)
    (alarm,) = world.told(topics.REPORT)[-1].alarms
    assert (alarm.code, alarm.severity) == ("station:system", Severity.WARNING)
    assert "component 190" in alarm.text
    assert "udpin:127.0.0.1:0" in alarm.text
    world.beside = None
    world.run(10.0)
    assert rivals(world) == set()


def test_our_own_heartbeat_that_comes_back_is_no_second_station(world):
    echo = []
    world.beside = lambda: echo.pop() if echo else b""
    for _ in range(100):
        world.run(0.1)
        outputs = world.station.step(world.now_s + 0.05, [], [b""])
        echo += [outputs.writes[0]] if outputs.writes[0] else []
    assert rivals(world) == set()


def statustexts(world):
    return [event.text for event in world.told(topics.EVENT) if event.code == "statustext"]


def test_a_text_is_told_once_by_the_agent_or_by_our_own_link(world, autopilot):
    vehicle = autopilot(1)
    world.vehicles = [vehicle]
    world.run(5.0)

    def warn(text, severity=4):
        world.beside = lambda: vehicle.frame(mavlink.MAVLink_statustext_message(severity, text, 0, 0))
        world.run(0.5)
        world.beside = None

    warn(b"PreArm: heard by both")
    world.run(3.0, Event(1, 1, Severity.WARNING, "statustext", "PreArm: heard by both"))
    assert statustexts(world) == [], "the agent has told it"
    warn(b"only here")
    assert statustexts(world) == []
    world.run(3.0)
    assert statustexts(world) == ["only here"]
    warn(b"no matter", severity=6)
    world.run(3.0)
    assert statustexts(world) == ["only here"]


def test_what_another_component_says_is_not_the_autopilots_word(world, autopilot, neighbours):
    world.vehicles = [autopilot(1)]
    world.run(5.0)
    world.beside = lambda: neighbours.text(b"gimbal stuck", component=154)
    world.run(0.5)
    assert statustexts(world) == ["component 154: gimbal stuck"]


def test_texts_in_parts_are_told_whole_in_order_and_visible(world, autopilot, neighbours):
    """Without its last part, in another order, with a hole, with control characters: as the agent tells them."""
    world.vehicles = [autopilot(1)]
    world.run(5.0)
    parts = [
        (b"A" * 50, 7, 0), (b"tail", 7, 1),
        (b"B" * 50, 8, 0),
        (b"C" * 50, 9, 0), (b"", 9, 1),
        (b"second", 10, 1), (b"D" * 50, 10, 0),
        (b"E" * 50, 11, 0), (b"third", 11, 2),
        (b"F \xff", 0, 0),
        (b"G \x1b[31mred\x1b[0m\nline", 0, 0),
    ]  # fmt: skip
    said = b"".join(neighbours.text(*part) for part in parts)
    world.beside = lambda: said
    world.run(0.5)
    world.beside = None
    world.run(4.0)
    assert statustexts(world) == [
        "A" * 50 + "tail",
        "C" * 50,
        "D" * 50 + "second",
        r"F \xff",
        r"G \x1b[31mred\x1b[0m\nline",
        "B" * 50 + " [part missing]",
        "E" * 50 + " [part missing] third",
    ]
    assert all(line.isprintable() for _, line in world.log)


def wreck(vehicle):
    """It says that it crashed, and stays armed in the agent's mode."""
    said = vehicle.frame(mavlink.MAVLink_statustext_message(0, b"Crash: Disarming", 0, 0))
    whole = vehicle.everything
    vehicle.everything = lambda: whole() + said
    return vehicle


def test_a_wreck_is_not_sent_home_when_its_agent_falls_silent(world, autopilot):
    world.vehicles = [autopilot(2)]
    world.run(5.0)
    wreck(world.vehicles[0])
    del world.agents[2]
    world.run(20.0)
    assert world.commands(mavlink.MAV_CMD_DO_SET_MODE) == []
    assert any("crashed: the autopilot says" in text for _, text in world.log)
    assert not world.told(topics.TRAFFIC)[-1].vehicles[0].airborne, "no obstacle to the others"


@pytest.mark.parametrize(("crashed", "reason"), [(True, "has crashed"), (False, "on the ground, disarmed")])
def test_what_brings_a_drone_down_is_obeyed_for_one_that_is_down_and_silent(
    world, autopilot, crashed, reason
):
    vehicle = autopilot(2)
    world.vehicles = [vehicle]
    world.run(6.0)
    if crashed:
        wreck(vehicle)
    else:
        vehicle.armed, vehicle.landed_state = False, mavlink.MAV_LANDED_STATE_ON_GROUND
    del world.agents[2]
    world.run(6.0)
    world.run(6.0, Command("down-1", "op", 2, CommandName.ABORT))
    (outcome,) = (o for o in world.told(topics.OUTCOME) if o.command == "down-1")
    assert outcome.result is Result.ACCEPTED
    assert reason in outcome.reason
    assert world.commands(mavlink.MAV_CMD_DO_SET_MODE) == []


def test_what_a_drone_tells_of_itself_is_no_second_event_of_the_station(world):
    world.run(5.0)
    world.agents[2] = {"phase": Phase.CRASHED, "airborne": False, "crash": "fell, at 28.27, -16.64"}
    world.run(5.0)
    assert (2, "crash") in alarm_codes(world)
    assert [event for event in world.told(topics.EVENT) if event.code == "crash"] == []


def test_a_vehicle_that_signs_is_told_of_once_where_there_is_no_key(world, autopilot):
    world.vehicles = [autopilot(2), autopilot(9)]
    world.run(5.0)
    assert not any("signs" in line for _, line in world.log)
    for vehicle in world.vehicles:
        vehicle.mav.signing.secret_key = bytes(range(32))
        vehicle.mav.signing.sign_outgoing = True
    world.run(10.0)
    told = [line for _, line in world.log if "signs" in line]
    assert told == ["drone 2 signs, and may obey nobody without its key: set mavlink.signing_key"]


def test_everything_that_it_says_is_numbered(world, autopilot):
    world.vehicles = [autopilot(2)]
    world.run(10.0)
    del world.agents[2]
    world.run(10.0)
    for topic in (topics.GROUND, topics.TRAFFIC, topics.EVENT):
        told = world.told(topic)
        assert told
        assert [message.sequence for message in told] == list(range(1, len(told) + 1))
        assert {message.incarnation for message in told} == {world.station._incarnation}
