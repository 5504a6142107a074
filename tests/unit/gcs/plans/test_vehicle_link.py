"""Which vehicle a command finds on a link, and whose answers count."""

from __future__ import annotations

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.plans import vehicle_link
from gcs.plans.vehicle_link import VehicleError, find_vehicle


class ScriptedLink:
    describe = "a test's link"
    problem = ""

    def __init__(self, *said: bytes) -> None:
        self._said = list(said)

    def read(self) -> bytes:
        return self._said.pop(0) if self._said else b""

    def write(self, data: bytes) -> None:
        assert data

    def close(self) -> None:
        self._said = []


class Listener:
    def __init__(self) -> None:
        self.frames: list[tuple[int, int, int]] = []

    def frame(self, frame) -> None:
        self.frames.append((frame.system, frame.component, frame.kind))

    def waiting(self) -> bytes:
        return b""


NEIGHBOURS = ("ping0", "gimbal3", "copter154", "camera", "qgc", "sys0", "other2")


def test_the_autopilot_is_found_whatever_else_is_heard_before_it(autopilot, neighbours):
    others = b"".join(map(neighbours.heartbeat, NEIGHBOURS))
    vehicle = autopilot(1, px4=True)
    link = ScriptedLink(others, others + vehicle.heartbeat())
    found = asyncio.run(find_vehicle([link], 1, 255))
    assert (found.drone, found.state.component, found.flavour.value) == (1, 1, "px4")


def test_only_what_the_autopilot_says_counts_and_reaches_who_transfers_lists(autopilot, neighbours):
    vehicle = autopilot(1)
    link = ScriptedLink(
        vehicle.heartbeat(),
        b"".join(map(neighbours.talkative, ("ping0", "gimbal3", "other2"))) + vehicle.extended(),
    )
    heard = []

    async def listen() -> Listener:
        found = await find_vehicle([link], 1, 255)
        found.listener = listener = Listener()
        found.hears = lambda _, message: heard.append((message.system, message.component))
        await found.during(asyncio.sleep(0.05))
        return listener

    listener = asyncio.run(listen())
    assert listener.frames == [(1, 1, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)]
    assert heard == [(1, 1)]


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        (("rover1",), "drone 1: vehicle type 10 (MAV_TYPE) is nothing that flies"),
        (("other2", "sys0", "gimbal3"), "its autopilot is not heard on a test's link; heard there: 2"),
        (("gimbal3", "copter154"), "its autopilot is not heard on a test's link; nobody else either"),
    ],
)
def test_why_no_vehicle_is_found(neighbours, monkeypatch, kinds, words):
    monkeypatch.setattr(vehicle_link, "DISCOVERY_S", 0.05)
    link = ScriptedLink(b"".join(map(neighbours.heartbeat, kinds)))
    with pytest.raises(VehicleError) as caught:
        asyncio.run(find_vehicle([link], 1, 255))
    assert words in str(caught.value)


def test_a_vehicle_that_signs_is_told_of_where_there_is_no_key(autopilot, caplog):
    vehicle = autopilot(1)
    vehicle.mav.signing.secret_key = bytes(range(32))
    vehicle.mav.signing.sign_outgoing = True
    found = asyncio.run(find_vehicle([ScriptedLink(vehicle.heartbeat())], 1, 255))
    assert found.drone == 1
    (record,) = caplog.records
    assert "drone 1 signs, and may obey nobody without its key" in record.getMessage()
