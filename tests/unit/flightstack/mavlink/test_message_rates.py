"""Which messages are asked for, when again, and when no more: an autopilot that answers by sending, or does not."""

from __future__ import annotations

import itertools

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.fields import layout
from flightstack.mavlink.message_rates import StreamRequests
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.vehicle_state import VehicleState

POSITION, STATUS, HOME = (
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION,
)
RATES_HZ = {Flavour.ARDUPILOT: {POSITION: 10.0, STATUS: 1.0}}
INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
TICK_S = 0.1


class Link:
    """Requests, and an autopilot that sends what is in `streams`, at those rates."""

    def __init__(self, requests: StreamRequests) -> None:
        self.requests = requests
        self.vehicle = VehicleState(3, 1, None)
        self.streams: dict[int, float] = {}
        self.answers = True
        self.asked: list[tuple[float, int]] = []
        self.ticks = 0

    def run(self, seconds: float) -> list[tuple[float, int]]:
        """What was asked for meanwhile: times and message ids."""
        known = len(self.asked)
        for _ in range(round(seconds / TICK_S)):
            self.ticks += 1
            now_s = self.ticks * TICK_S
            if self.ticks % 10 == 0:
                self._come(now_s, mavlink.MAVLINK_MSG_ID_HEARTBEAT, b"\x04\0\0\0\x02\x03\x80")
            for kind, rate_hz in self.streams.items():
                if self.ticks % round(1.0 / (rate_hz * TICK_S)) == 0:
                    self._come(now_s, kind, b"\0")
            for message in self.requests.step(now_s, self.vehicle):
                self.asked.append((round(now_s, 3), int(message.param1)))
                if self.answers:
                    self.requests.acknowledge(now_s, message.command, mavlink.MAV_RESULT_ACCEPTED)
        return self.asked[known:]

    def _come(self, now_s: float, kind: int, payload: bytes) -> None:
        self.vehicle.accept(now_s, MavlinkMessage(kind, 3, 1, layout(kind).unpack(payload)))


@pytest.fixture
def link() -> Link:
    return Link(StreamRequests(RATES_HZ))


def test_nothing_is_asked_of_an_autopilot_that_is_not_heard(link: Link) -> None:
    assert link.run(0.9) == []
    assert {kind for _, kind in link.run(1.0)} == {POSITION, STATUS}


def test_each_is_asked_for_once_also_what_comes_already(link: Link) -> None:
    link.streams = {POSITION: 5.0, STATUS: 1.0}
    assert [kind for _, kind in link.run(30.0)] == [POSITION, STATUS]
    assert link.requests.missing == frozenset()


def test_a_polite_client_leaves_what_comes_as_it_is() -> None:
    link = Link(StreamRequests(RATES_HZ, asks_first=False))
    link.streams = {POSITION: 5.0, STATUS: 1.0}
    assert link.run(30.0) == []
    del link.streams[STATUS]
    assert [kind for _, kind in link.run(8.0)][:1] == [STATUS]


def test_one_request_is_open_at_a_time(link: Link) -> None:
    link.answers = False
    times_s = [at for at, _ in link.run(20.0)]
    assert min(b - a for a, b in itertools.pairwise(times_s)) >= 0.5 - 1e-9


def test_a_stream_that_stops_is_asked_for_again_soon(link: Link) -> None:
    link.streams = {POSITION: 10.0, STATUS: 1.0}
    link.run(20.0)
    link.streams = {STATUS: 1.0}
    (at_s, kind), *_ = link.run(4.0)
    assert kind == POSITION
    assert 2.0 <= at_s - 20.0 <= 3.0


def test_a_stream_that_comes_far_too_seldom_is_asked_for_again(link: Link) -> None:
    link.streams = {POSITION: 10.0, STATUS: 1.0}
    link.run(20.0)
    link.streams[POSITION] = 2.0
    assert POSITION in {kind for _, kind in link.run(11.0)}
    link.streams[POSITION] = 5.0
    link.run(10.0)
    assert link.run(30.0) == []


def test_what_never_comes_is_told_and_asked_for_ever_more_seldom(link: Link) -> None:
    link.streams = {POSITION: 10.0}
    link.run(10.0)
    assert link.requests.missing == {STATUS}
    link.run(50.0)
    assert len(link.run(60.0)) == 6
    link.streams[STATUS] = 1.0
    link.run(2.0)
    assert link.requests.missing == frozenset()


def test_what_the_autopilot_does_not_have_rests_for_a_minute(link: Link) -> None:
    link.streams = {POSITION: 10.0}
    link.answers = False
    while tuple(kind for _, kind in link.asked) != (POSITION, STATUS):
        link.run(TICK_S)
    link.requests.acknowledge(link.ticks * TICK_S, INTERVAL, mavlink.MAV_RESULT_UNSUPPORTED)
    assert link.run(55.0) == []
    assert link.requests.missing == {STATUS}
    assert [kind for _, kind in link.run(6.0)] == [STATUS]


def test_of_a_flavour_that_is_not_in_the_table_nothing_is_asked() -> None:
    link = Link(StreamRequests({Flavour.PX4: {POSITION: 10.0}}, once=(HOME,)))
    assert link.run(5.0) == []


def test_a_single_message_is_asked_for_until_it_has_come() -> None:
    link = Link(StreamRequests({Flavour.ARDUPILOT: {POSITION: 10.0}}, once=(HOME,)))
    link.streams = {POSITION: 10.0}
    assert [kind for _, kind in link.run(2.0)] == [POSITION, HOME, HOME]
    link.streams[HOME] = 1.0
    link.run(1.5)
    del link.streams[HOME]
    assert link.run(60.0) == []


def test_a_restarted_autopilot_is_asked_for_everything_anew(link: Link) -> None:
    link.streams = {POSITION: 10.0, STATUS: 1.0}
    link.run(10.0)
    link.vehicle.boots += 1
    assert [kind for _, kind in link.run(2.0)] == [POSITION, STATUS]


def test_an_acknowledgement_of_something_else_changes_nothing(link: Link) -> None:
    link.answers = False
    link.run(1.0)
    link.requests.acknowledge(1.0, mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_RESULT_UNSUPPORTED)
    link.streams = {POSITION: 10.0}
    assert STATUS in {kind for _, kind in link.run(10.0)}
