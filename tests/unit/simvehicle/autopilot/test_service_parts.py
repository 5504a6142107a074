"""The services of a simulated autopilot one by one, each with nothing but what it is given."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import ACCEPTED, DENIED, CommandAnswer, CommandServer, ReceivedCommand
from simvehicle.autopilot.link_signing import LinkSigning
from simvehicle.autopilot.message_router import MessageRouter
from simvehicle.autopilot.message_streams import MessageStreams, StreamStyle
from simvehicle.autopilot.parameters import Parameters, ParameterServer, ParameterStyle
from simvehicle.autopilot.pilot import PilotInputs

SYSTEM = 7
PEER = ChannelPeer(0, 255, 190)


class Ends:
    """Two links of an autopilot, and what came out of each."""

    def __init__(self) -> None:
        self.channels = [Channel(link, SYSTEM, LinkSigning(None, ())) for link in (0, 1)]
        self._parsers = [mavlink.MAVLink(None) for _ in self.channels]
        self._codec = mavlink.MAVLink(None, srcSystem=PEER.system, srcComponent=PEER.component)

    def said(self, link: int = 0) -> list[Any]:
        data = b"".join(self.channels[link].drain())
        return list(self._parsers[link].parse_buffer(data) or ())

    def kinds(self, link: int = 0) -> list[str]:
        return [message.get_type() for message in self.said(link)]

    def packed(self, message: Any, sender: tuple[int, int] | None = None) -> bytes:
        codec = self._codec if sender is None else mavlink.MAVLink(None, *sender)
        return bytes(message.pack(codec))


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 4, 3)


# -- announcements ----------------------------------------------------------------------------------------------


def test_the_news_of_a_mode_goes_before_the_texts_and_once() -> None:
    ends = Ends()
    announcer = Announcer(ends.channels, lambda _: heartbeat())
    announcer.say(4, "second")
    announcer.mode_changed()
    assert announcer.pending
    assert ends.kinds() == []
    announcer.flush()
    assert ends.kinds(0) == ends.kinds(1) == ["HEARTBEAT", "STATUSTEXT"]
    assert not announcer.pending
    announcer.flush()
    assert ends.kinds() == []


def test_a_long_text_goes_out_in_numbered_pieces() -> None:
    ends = Ends()
    announcer = Announcer(ends.channels, lambda _: None)
    text = "".join(chr(97 + n % 26) for n in range(120))
    announcer.say(6, text)
    announcer.say(6, text)
    announcer.flush()
    pieces = ends.said()
    assert [(m.id, m.chunk_seq) for m in pieces] == [(1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2)]
    assert "".join(m.text for m in pieces[:3]) == text


def test_nothing_is_told_where_there_is_nothing_to_tell() -> None:
    ends = Ends()
    announcer = Announcer(ends.channels, lambda _: None)
    announcer.tell(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert ends.kinds() == []


# -- parameters -------------------------------------------------------------------------------------------------


class Asked:
    """A `ParameterServer` and what it told its flavour."""

    def __init__(self, named_index: int | None = 65535) -> None:
        self.ends = Ends()
        self.parameters = Parameters("ardupilot", {})
        self.unknown: list[str] = []
        self.changed: list[str] = []
        self.lists = 0
        style = ParameterStyle(named_index, lambda _c, _p, name: self.unknown.append(name), self._listed)
        self.server = ParameterServer(self.parameters, style, self.ends.channels, self.changed.append)
        self._handlers = self.server.handlers()

    def _listed(self) -> None:
        self.lists += 1

    def ask(self, message: Any) -> None:
        (parsed,) = mavlink.MAVLink(None).parse_buffer(self.ends.packed(message))
        self._handlers[parsed.get_type()](self.ends.channels[0], PEER, parsed)


def test_a_parameter_list_goes_out_in_portions_to_who_asked() -> None:
    asked = Asked()
    asked.ask(mavlink.MAVLink_param_request_list_message(SYSTEM, 1))
    assert asked.lists == 1
    portions = []
    while not portions or portions[-1]:
        asked.server.step()
        portions.append([m.param_index for m in asked.ends.said()])
    assert all(len(portion) <= ParameterServer.PER_STEP for portion in portions)
    sent = [index for portion in portions for index in portion]
    assert sent == list(range(len(asked.parameters.names)))
    assert asked.ends.kinds(1) == []


@pytest.mark.parametrize(("named_index", "expected"), [(65535, 65535), (None, 2)])
def test_an_answer_by_name_carries_the_flavours_index(named_index: int | None, expected: int) -> None:
    asked = Asked(named_index)
    name = asked.parameters.names[2]
    asked.ask(mavlink.MAVLink_param_request_read_message(SYSTEM, 1, name.encode(), -1))
    asked.ask(mavlink.MAVLink_param_request_read_message(SYSTEM, 1, b"", 2))
    assert [(m.param_id, m.param_index) for m in asked.ends.said()] == [(name, expected), (name, 2)]


def test_a_set_parameter_is_told_to_all_and_an_unknown_one_to_the_flavour() -> None:
    asked = Asked()
    asked.ask(mavlink.MAVLink_param_set_message(SYSTEM, 1, b"WPNAV_SPEED", 640.0, 9))
    assert asked.changed == ["WPNAV_SPEED"]
    assert asked.parameters["WPNAV_SPEED"] == 640.0
    assert (
        [m.param_value for m in asked.ends.said(0)] == [m.param_value for m in asked.ends.said(1)] == [640.0]
    )
    asked.ask(mavlink.MAVLink_param_set_message(SYSTEM, 1, b"NO_SUCH", 1.0, 9))
    asked.ask(mavlink.MAVLink_param_request_read_message(SYSTEM, 1, b"NOR_THIS", -1))
    asked.ask(mavlink.MAVLink_param_request_read_message(SYSTEM, 1, b"", 30000))
    assert asked.unknown == ["NO_SUCH", "NOR_THIS", "#30000"]


def test_a_default_that_is_set_again_is_told_as_the_type_of_its_group() -> None:
    asked = Asked()

    def answer(name: bytes, value: float, kind: int) -> tuple[float, int]:
        asked.ask(mavlink.MAVLink_param_set_message(SYSTEM, 1, name, value, kind))
        (told,) = asked.ends.said(0)
        return told.param_value, told.param_type

    int8, int16, int32, real32 = (
        mavlink.MAV_PARAM_TYPE_INT8,
        mavlink.MAV_PARAM_TYPE_INT16,
        mavlink.MAV_PARAM_TYPE_INT32,
        mavlink.MAV_PARAM_TYPE_REAL32,
    )
    assert answer(b"FENCE_TYPE", 7.0, int8) == (7.0, real32)
    assert answer(b"RTL_ALT", 1500.0, int32) == (1500.0, int32), "no member of a group"
    assert answer(b"FENCE_TYPE", 4.0, int8) == (4.0, int8)
    assert answer(b"FENCE_TYPE", 7.0, int8) == (7.0, int8), "it is in the storage now"
    assert answer(b"WPNAV_SPEED", 1000.05, real32) == (1000.0, real32), "alike: told and kept apart"
    assert asked.parameters["WPNAV_SPEED"] == pytest.approx(1000.05, rel=1e-6)
    assert answer(b"FENCE_OPTIONS", 40000.0, int16) == (32767.0, int16)
    assert answer(b"RTL_ALT", 99_999_999.0, int32) == (100_000_000.0, int32), "24 bits came over the link"
    assert answer(b"RTL_ALT", 2500.995, int32) == (2501.0, int32)
    assert answer(b"RTL_ALT", 2500.7, int32) == (2500.0, int32)
    assert asked.ends.kinds() == []


# -- commands ---------------------------------------------------------------------------------------------------


def test_the_acknowledgement_goes_before_what_the_command_causes() -> None:
    ends = Ends()
    got: list[ReceivedCommand] = []

    def execute(command: ReceivedCommand) -> CommandAnswer:
        got.append(command)
        return CommandAnswer(DENIED, heartbeat())

    def flush() -> None:
        ends.channels[0].send(mavlink.MAVLink_statustext_message(6, b"caused"))

    server = CommandServer({400: execute}, ends.channels, flush, lambda mode: (mode, 0))
    long = mavlink.MAVLink_command_long_message(SYSTEM, 1, 400, 0, 1, float("nan"), 3, 4, 5, 6, 7)
    server.handlers()["COMMAND_LONG"](ends.channels[0], PEER, long)
    ack, *rest = ends.said()
    assert (ack.command, ack.result, ack.target_system) == (400, DENIED, 255)
    assert [message.get_type() for message in rest] == ["HEARTBEAT", "STATUSTEXT"]
    (command,) = got
    assert (command.params[0], command.x, command.y, command.z, command.frame) == (1, 5, 6, 7, None)
    assert (command.whole(0), command.whole(1)) == (1, -1), "NaN is no integer"


def test_commands_that_nobody_knows_are_unsupported_and_some_do_nothing() -> None:
    ends = Ends()
    server = CommandServer({}, ends.channels, lambda: None, lambda mode: (mode, 0))
    handler = server.handlers()["COMMAND_LONG"]
    for number in (31000, mavlink.MAV_CMD_DO_SET_SERVO):
        message = mavlink.MAVLink_command_long_message(SYSTEM, 1, number, 0, *[0.0] * 7)
        handler(ends.channels[0], PEER, message)
    unsupported = mavlink.MAV_RESULT_UNSUPPORTED
    assert [m.result for m in ends.said()] == [unsupported, mavlink.MAV_RESULT_ACCEPTED]


def test_set_mode_is_the_mode_command_acknowledged_as_itself() -> None:
    ends = Ends()
    got: list[ReceivedCommand] = []

    def execute(command: ReceivedCommand) -> int:
        got.append(command)
        return ACCEPTED

    server = CommandServer(
        {176: execute}, ends.channels, lambda: None, lambda mode: (mode >> 16 & 0xFF, mode >> 24)
    )
    message = mavlink.MAVLink_set_mode_message(SYSTEM, 1, 4 << 16 | 6 << 24)
    server.handlers()["SET_MODE"](ends.channels[0], PEER, message)
    assert got[0].params == (1.0, 4.0, 6.0, 0.0)
    assert [m.command for m in ends.said()] == [mavlink.MAVLINK_MSG_ID_SET_MODE]


# -- routing ----------------------------------------------------------------------------------------------------


def test_messages_reach_their_handlers_others_and_the_other_links() -> None:
    ends = Ends()
    got: list[str] = []
    router = MessageRouter(
        SYSTEM,
        ends.channels,
        {"PING": lambda _c, _p, m: got.append(m.get_type())},
        lambda _c, _p, m: got.append(f"other {m.get_type()}"),
    )
    first, second = ends.channels
    router.receive(second, ends.packed(heartbeat(), (7, 191)))  # a companion is on the second link
    got.clear()
    ends.said(0)
    router.receive(first, ends.packed(mavlink.MAVLink_ping_message(0, 1, SYSTEM, 1)))
    router.receive(first, ends.packed(mavlink.MAVLink_mission_request_list_message(SYSTEM, 1, 0)))
    assert got == ["PING", "other MISSION_REQUEST_LIST"]
    assert ends.kinds(1) == [], "what is for the autopilot is not handed on"
    router.receive(first, ends.packed(mavlink.MAVLink_ping_message(0, 2, SYSTEM, 191)))
    assert got == ["PING", "other MISSION_REQUEST_LIST"]
    assert ends.kinds(1) == ["PING"], "what is for the companion is"
    router.receive(first, ends.packed(heartbeat(), (SYSTEM, 1)))
    assert ends.kinds(1) == [], "our own words, looped back"


# -- streams ----------------------------------------------------------------------------------------------------


class Streamed:
    def __init__(self, first_s: dict[int, float] | None = None) -> None:
        self.ends = Ends()
        self.now_s = 0.0
        style = StreamStyle(
            first_s=first_s or {},
            groups={mavlink.MAV_DATA_STREAM_EXTRA1: (0,)},
            unknown_interval=DENIED,
            unknown_request=4,
            nothing_yet=1,
        )
        messages = {0: heartbeat, 242: lambda: None}
        self.streams = MessageStreams(messages, style, self.ends.channels, lambda: self.now_s)
        self.streams.start(0.0)

    def command(self, number: int, *params: float) -> int | CommandAnswer:
        p1, p2, *_ = (*params, 0.0)
        command = ReceivedCommand(PEER, number, (p1, p2, 0.0, 0.0), 0.0, 0.0, 0.0, None)
        return self.streams.table()[number](command)

    def run(self, seconds: float) -> int:
        """Heartbeats on the first link."""
        for _ in range(round(seconds / 0.02)):
            self.now_s += 0.02
            self.streams.send_due(self.now_s)
        assert self.ends.kinds(1) == []
        return len(self.ends.said())


def test_intervals_hold_on_the_link_that_asked_until_they_are_ended() -> None:
    streamed = Streamed()
    assert streamed.run(1.0) == 0
    assert streamed.command(511, 0, 100_000) == ACCEPTED
    assert streamed.run(2.0) == pytest.approx(20, abs=1)
    answer = streamed.command(510, 0)
    assert isinstance(answer, CommandAnswer)
    assert answer.message.interval_us == 100_000
    assert streamed.command(511, 0, -1) == ACCEPTED
    assert streamed.run(1.0) == 0


def test_requests_are_answered_in_the_flavours_way() -> None:
    streamed = Streamed()
    assert streamed.command(511, 9999, 1e5) == DENIED
    assert streamed.command(512, 9999) == 4
    assert streamed.command(512, 242) == 1, "nothing to tell yet"
    answer = streamed.command(512, 0)
    assert isinstance(answer, CommandAnswer)
    assert answer.message.get_type() == "HEARTBEAT"


def test_data_streams_switch_their_groups() -> None:
    streamed = Streamed()
    handler = streamed.streams.handlers()["REQUEST_DATA_STREAM"]
    channel = streamed.ends.channels[0]
    for group, expected in ((mavlink.MAV_DATA_STREAM_POSITION, 0), (mavlink.MAV_DATA_STREAM_EXTRA1, 5)):
        handler(channel, PEER, mavlink.MAVLink_request_data_stream_message(SYSTEM, 1, group, 5, 1))
        assert streamed.run(1.0) == pytest.approx(expected, abs=1)
    handler(channel, PEER, mavlink.MAVLink_request_data_stream_message(SYSTEM, 1, 0, 5, 0))
    assert streamed.run(1.0) == 0


# -- the pilot --------------------------------------------------------------------------------------------------


def test_sticks_are_taken_from_those_who_may_fly() -> None:
    moved: list[list[int]] = []
    inputs = PilotInputs(lambda system: system == 255, moved.append).handlers()
    channel = Channel(0, SYSTEM, LinkSigning(None, ()))
    manual = mavlink.MAVLink_manual_control_message(SYSTEM, 1000, -1000, 500, 500, 0)
    override = mavlink.MAVLink_rc_channels_override_message(SYSTEM, 1, *range(1101, 1109))
    for sender in (ChannelPeer(0, 9, 1), PEER):
        inputs["MANUAL_CONTROL"](channel, sender, manual)
        inputs["RC_CHANNELS_OVERRIDE"](channel, sender, override)
    assert moved == [[1000, 1000, 1500, 1750, 0, 0, 0, 0], list(range(1101, 1109))]
