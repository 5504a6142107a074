"""Agent and ground station see the same vehicle in the same bytes: recorded flights of real autopilots."""

from __future__ import annotations

import pathlib
import struct
from collections.abc import Iterator

import pytest

from flightstack.autopilot.telemetry import EVENTS, STATES, Telemetry
from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.framing import SIGNED, V2_MAGIC
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.vehicle_state import VehicleState
from gcs.fleet.vehicles import Component, Vehicles
from mission.geometry.frames import Geodetic, LocalFrame

DATA = pathlib.Path(__file__).parents[1] / "data"
RECORDINGS = {
    "ardupilot": ("arducopter-4.6.3-flight.tlog", Geodetic(-5.06, 151.3, 500.0), 5.0),
    "px4": ("px4-1.16-dev-flight.tlog", Geodetic(47.3977, 8.5456, 489.0), 56.0),
}
"""File, origin, and from when on both must see the same: the station listens to everybody from the first byte on,
the agent to its autopilot once that has a heartbeat. So the station alone has the very first position, until the
estimator vouches for another one."""
TICK_S = 0.1
FIELDS = (
    "flavour",
    "armed",
    "mode",
    "mode_since_s",
    "landed_state",
    "estimator_flags",
    "geodetic",
    "position_ned_m",
    "position_s",
    "velocity_ned_mps",
    "above_home_m",
    "home_ned_m",
    "battery_fraction",
    "battery_voltage_v",
    "heartbeat_s",
    "boots",
)


def records(name: str) -> Iterator[tuple[float, bytes]]:
    data = (DATA / name).read_bytes()
    at, first_s = 0, None
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        first_s = time_us * 1e-6 if first_s is None else first_s
        start = at + 8
        assert data[start] == V2_MAGIC
        assert not data[start + 2] & SIGNED
        at = start + data[start + 1] + 12
        yield time_us * 1e-6 - first_s, data[start:at]


class Both:
    """The agent's and the ground station's way from bytes to a vehicle, on one clock."""

    def __init__(self, origin: Geodetic) -> None:
        frame = LocalFrame(origin)
        self.agent = Telemetry(1, frame, Flavour.UNKNOWN)
        self.vehicles = Vehicles(frame)
        self._agents_codec = MavlinkCodec(1, 191, STATES, EVENTS, only_system=1)
        self._stations_codec = MavlinkCodec(255, 190, vehicle_state.STATES, vehicle_state.EVENTS)
        self.texts: dict[str, list[str]] = {"agent": [], "ground": []}

    def receive(self, now_s: float, data: bytes) -> None:
        for message in self._agents_codec.receive(now_s, data):
            self.agent.hear(now_s, message)
        for message in self._stations_codec.receive(now_s, data):
            self.vehicles.receive(now_s, 0, message)
        self.agent.flush(now_s)
        self.texts["agent"] += [text.text for text in self.agent.new_texts]
        self.agent.clear_news()
        if (ground := self.ground) is not None:
            ground.flush(now_s)
            self.texts["ground"] += [text.text for text in ground.take_texts()]

    @property
    def ground(self) -> Component | None:
        return self.vehicles.autopilot(1)


def seen(vehicle: VehicleState, now_s: float) -> dict[str, object]:
    return {field: getattr(vehicle, field) for field in FIELDS} | {"flies": vehicle.flies(now_s)}


def flown(name: str, noise: bytes = b"") -> tuple[Both, list[tuple[float, dict[str, object]]]]:
    """What both saw at every tick; it is asserted to be the same."""
    file, origin, settled_s = RECORDINGS[name]
    both, history = Both(origin), []
    pending = list(records(file))
    ticks, at = 0, 0
    while at < len(pending):
        now_s = ticks * TICK_S
        data = noise
        while at < len(pending) and pending[at][0] <= now_s:
            data += pending[at][1]
            at += 1
        both.receive(now_s, data)
        if both.ground is not None:
            agents, stations = seen(both.agent, now_s), seen(both.ground, now_s)
            assert agents == stations or now_s < settled_s, now_s
            history.append((now_s, agents))
        ticks += 1
    assert history[-1][0] > settled_s + 100.0
    return both, history


@pytest.mark.parametrize("name", RECORDINGS)
def test_both_see_the_same_at_every_tick_of_a_real_flight(name: str) -> None:
    both, history = flown(name)
    assert history[0][0] < 3.0
    assert both.texts["agent"]
    assert both.texts["ground"][-len(both.texts["agent"]) :] == both.texts["agent"]
    assert {state["flies"] for _, state in history} == {False, True}
    modes = {state["mode"] for _, state in history}
    assert modes >= (
        {"GUIDED", "RTL", "LAND"} if name == "ardupilot" else {"OFFBOARD", "RTL", "HOLD", "TAKEOFF"}
    )
    assert not any(str(mode).startswith("MODE_") for mode in modes)
    assert both.agent.boots == 0


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_bad_line_between_frames_changes_nothing_for_either(name: str) -> None:
    clean, noisy = flown(name)[1], flown(name, noise=b"\x00\xfd\x03garbage")[1]
    assert [state["mode"] for _, state in clean] == [state["mode"] for _, state in noisy]
    # A false start of a frame may hold the last bytes of a tick back until the next one.
    assert [s["armed"] for _, s in clean][:-5] == [s["armed"] for _, s in noisy][:-5]


def test_a_real_px4_flew_when_its_transcript_says_so() -> None:
    zero_s = 9.9  # of the recording, on the transcript's clock
    history = [(now_s + zero_s, state) for now_s, state in flown("px4")[1]]
    armed = [now_s for now_s, state in history if state["armed"]]
    flying = [now_s for now_s, state in history if state["flies"]]
    assert armed[0] == pytest.approx(61.7, abs=0.3)
    assert flying[0] == pytest.approx(78.3, abs=0.3)
    assert flying[-1] == pytest.approx(243.1, abs=0.3)
    for time_s, mode in ((95.0, "OFFBOARD"), (103.0, "RTL"), (130.0, "POSITION"), (190.0, "MISSION")):
        state = next(state for now_s, state in history if now_s >= time_s)
        assert (state["mode"], state["flies"]) == (mode, True)
        assert state["battery_fraction"] is not None
        assert state["position_ned_m"] is not None
