"""The session on the autopilot's side of a recorded flight of a real ArduCopter 4.6.3: what it would have reported.

The recording is cut to the messages of interest; the ground station that flew it is left out, so that every change of
mode looks to the session like somebody else's.
"""

from __future__ import annotations

import pathlib
import struct
from collections.abc import Iterator

import pytest

from flightstack.autopilot import AutopilotSession, TakenBy, VehicleReport
from flightstack.config import AutopilotConfig
from mission.geometry.frames import Geodetic, LocalFrame

RECORDING = pathlib.Path(__file__).parents[3] / "data" / "arducopter-4.6.3-flight.tlog"
FIRST_RECORD_S = 0.1
"""The cut begins that long after the transcript's zero."""
TICK_S = 0.1


def records() -> Iterator[tuple[float, bytes]]:
    data = RECORDING.read_bytes()
    at, first_s = 0, None
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        time_s = time_us * 1e-6
        first_s = time_s if first_s is None else first_s
        start = at + 8
        at = start + data[start + 1] + 12
        yield time_s - first_s + FIRST_RECORD_S, data[start:at]


def replay(piece: int | None = None, before: bytes = b"") -> tuple[list[tuple[float, VehicleReport]], bytes]:
    """The report of every tick, and all that the session sent; `piece`: bytes per call."""
    session = AutopilotSession(1, LocalFrame(Geodetic(-5.06, 151.3, 500.0)), AutopilotConfig(link="unused"))
    pending = list(records())
    reports, sent, ticks = [], b"", 0
    while pending:
        now_s = ticks * TICK_S
        data = before
        while pending and pending[0][0] <= now_s:
            data += pending.pop(0)[1]
        for start in range(0, len(data), piece or len(data) or 1):
            session.receive(now_s, data[start : start + (piece or len(data))])
        session.receive(now_s, b"")
        reports.append((now_s, session.report))
        sent += session.step(now_s)
        ticks += 1
    return reports, sent


@pytest.fixture(scope="module")
def flight() -> list[tuple[float, VehicleReport]]:
    return replay()[0]


def first(flight: list[tuple[float, VehicleReport]], after_s: float, field: str, value: object) -> float:
    return next(t for t, report in flight if t >= after_s and getattr(report, field) == value)


def at(flight: list[tuple[float, VehicleReport]], time_s: float) -> VehicleReport:
    return flight[round(time_s / TICK_S)][1]


def test_it_connects_with_the_first_heartbeat(flight):
    assert first(flight, 0.0, "connected", True) == pytest.approx(0.9, abs=0.2)
    assert at(flight, 0.0).ready_reason.startswith("no heartbeat of the autopilot")


def test_it_is_ready_when_the_real_one_could_be_armed(flight):
    assert first(flight, 0.0, "ready", True) == pytest.approx(42.0, abs=0.6)
    assert "estimator" in at(flight, 20.0).ready_reason
    assert at(flight, 43.0).ready_reason == ""


def test_no_position_is_given_before_the_estimator_vouches_for_it(flight):
    assert at(flight, 40.0).position_ned_m is None
    assert at(flight, 43.0).position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=0.5)


def test_armed_and_airborne(flight):
    assert first(flight, 0.0, "armed", True) == pytest.approx(41.9, abs=0.5)
    assert first(flight, 0.0, "airborne", True) == pytest.approx(45.9, abs=0.3)
    assert first(flight, 100.0, "airborne", False) == pytest.approx(257.9, abs=0.3)
    assert first(flight, 100.0, "armed", False) == pytest.approx(259.0, abs=0.3)


def test_its_position_after_the_targets(flight):
    north_m, east_m, down_m = at(flight, 63.0).position_ned_m
    assert (north_m, east_m) == pytest.approx((30.0, 0.0), abs=1.0)
    assert down_m == pytest.approx(-15.0, abs=1.0)
    assert at(flight, 66.0).velocity_ned_mps == pytest.approx((0.0, 2.0, 0.0), abs=0.4)


def test_guided_is_ours_until_somebody_takes_it(flight):
    assert at(flight, 60.0).mode == "GUIDED"
    assert at(flight, 60.0).mode_ours
    lost_s = first(flight, 60.0, "mode_ours", False)
    assert lost_s == pytest.approx(83.5, abs=0.2)
    assert at(flight, lost_s).mode == "AUTO"
    assert at(flight, lost_s).taken_by is TakenBy.PILOT


def test_a_mode_given_back_is_not_taken_without_a_command(flight):
    report = at(flight, 140.0)
    assert report.mode == "GUIDED"
    assert not report.mode_ours


def test_the_fence_takes_the_vehicle(flight):
    report = at(flight, 152.0)
    assert report.mode == "RTL"
    assert report.taken_by is TakenBy.AUTOPILOT
    assert report.failsafe
    assert "Polygon fence breached" in report.taken_reason


def test_the_person_who_ends_the_fence_failsafe_is_a_pilot(flight):
    report = at(flight, 178.0)
    assert (report.mode, report.taken_by) == ("BRAKE", TakenBy.PILOT)
    assert not report.failsafe


def test_the_estimator_failsafe_lands_and_the_position_grows_old(flight):
    report = at(flight, 189.0)
    assert report.mode == "LAND"
    assert report.taken_by is TakenBy.AUTOPILOT
    assert report.failsafe_reason == "EKF Failsafe: changed to LAND Mode"
    assert not report.ready
    assert report.position_age_s == pytest.approx(1.2, abs=0.4)
    assert at(flight, 192.0).position_age_s < 0.5


def test_the_battery_failsafe(flight):
    report = at(flight, 217.0)
    assert (report.mode, report.taken_by) == ("RTL", TakenBy.AUTOPILOT)
    assert "Battery Failsafe" in report.taken_reason
    assert report.battery_fraction == pytest.approx(0.58, abs=0.02)
    assert "PreArm: Battery failsafe" in at(flight, 260.0).ready_reason


def test_home_and_heading_and_no_wind(flight):
    report = at(flight, 100.0)
    assert report.home_ned_m == pytest.approx((0.0, 0.0, -0.1), abs=0.2)
    assert 0.0 <= report.heading_rad < 6.2832
    # This ArduCopter says that the wind is nothing in 8 m/s of it: that is no estimate.
    assert all(report.wind_ned_mps is None for _, report in flight)


def test_every_text_is_told_once(flight):
    texts = [text.text for _, report in flight for text in report.new_texts]
    assert len(texts) == 54  # of 55: the first came before a heartbeat had told whose it is
    assert texts.count("Polygon fence breached") == 1


@pytest.mark.parametrize("piece", [1, 7, 64])
def test_the_chunking_of_the_bytes_changes_nothing(flight, piece):
    reports, _ = replay(piece)
    assert [r.position_ned_m for _, r in reports] == [r.position_ned_m for _, r in flight]
    assert [(r.mode, r.armed, r.ready) for _, r in reports] == [(r.mode, r.armed, r.ready) for _, r in flight]


def test_the_same_bytes_give_the_same_bytes():
    assert replay()[1] == replay()[1]


def test_another_vehicles_flight_is_not_ours():
    session = AutopilotSession(2, LocalFrame(Geodetic(-5.06, 151.3, 500.0)), AutopilotConfig(link="unused"))
    for time_s, frame in records():
        session.receive(time_s, frame)
    assert not session.report.connected
    assert "system id 1, this drone is 2" in session.report.ready_reason
