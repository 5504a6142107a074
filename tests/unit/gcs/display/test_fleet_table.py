"""The displays: legible at 80 columns, in black and white, with twenty drones."""

from __future__ import annotations

import io

import msgspec
import pytest
from rich.console import Console

from flightstack.swarm.wire import Event, GroundAlarm, GroundReport, Phase, Severity
from gcs.connection import Connection
from gcs.display.fleet_table import report, screen
from gcs.fleet.monitor import Alarm, Monitor
from gcs.fleet.observe import Observer, Snapshot, to_json
from gcs.fleet.view import FleetView
from gcs.station_config import AlarmLimits
from mission.estimation.estimates import Scalar, Wind


def draw(renderable, width=80) -> list[str]:
    console = Console(file=io.StringIO(), width=width, color_system=None, force_terminal=False)
    console.print(renderable)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


@pytest.fixture
def twenty(frame, state, on_air):
    view, monitor = FleetView(range(1, 21), frame, 0.0), Monitor(AlarmLimits())
    for tick in range(60):
        now_s = tick * 0.5
        for drone in range(1, 21):
            if drone == 7 and now_s > 5.0:
                continue
            told = state(
                drone,
                sequence=tick,
                phase=Phase.SEARCHING,
                excess_co2_ppm=Scalar(1000.0 + drone, 4.0, 0.1),
                wind=Wind((-2.0, 0.0, 0.0), 0.1, 0.1),
                slot=drone - 1,
                parent=drone // 2 or None,
                battery_fraction=0.05 if drone == 9 else 0.9,
            )
            view.receive_peer(now_s, on_air(told))
        monitor.step(now_s, view)
    view.events.append((20.0, Event(3, 1, Severity.INFO, "heal", "epoch 3: drone 7 lost")))
    return view, monitor


def drawn(twenty, height, width=80):
    view, monitor = twenty
    picture = screen(
        "etna", view.rows(30.0), monitor.alarms, view.events, station="ground", now_s=30.0, height=height
    )
    return draw(picture, width)


def test_twenty_drones_fit_an_80_by_24_terminal(twenty):
    lines = drawn(twenty, 24)
    assert len(lines) <= 24
    assert max(len(line) for line in lines) <= 80
    for drone in range(1, 21):
        assert any(line.strip().startswith(f"{drone} ") for line in lines)


def test_words_say_what_colours_say(twenty):
    lines = drawn(twenty, 24)
    assert "19 of 20 live" in lines[0]
    assert "2 CRIT" in lines[0]
    (lost,) = [line for line in lines if line.strip().startswith("7 ")]
    assert "SILENT" in lost
    assert "CRIT lost" in lost
    (low,) = [line for line in lines if line.strip().startswith("9 ")]
    assert "CRIT battery" in low
    (good,) = [line for line in lines if line.strip().startswith("12 ")]
    for word in ("LIVE", "searching", "GUIDED", "12.0", "1012", "2.0/000", "90%", "11<6"):
        assert word in good.split(), word


def test_a_taller_terminal_shows_alarms_and_events(twenty):
    lines = drawn(twenty, 40)
    assert len(lines) <= 40
    assert any(line.startswith("CRIT drone 7: agent silent") for line in lines)
    assert any("epoch 3: drone 7 lost" in line for line in lines)


def test_a_long_alarm_is_whole_where_there_is_room(frame):
    text = (
        'crashed: the autopilot says "Crash: Disarming: AngErr=51>30, Accel=2.9<3.0", at 38.404012, 14.963012'
    )
    alarms = [Alarm(Severity.CRITICAL, drone, "crash", text, 0.0) for drone in range(1, 6)]
    for height, whole in ((24, True), (9, False)):
        lines = draw(screen("etna", [], alarms, [], station=None, now_s=30.0, height=height))
        assert len(lines) <= height
        assert max(map(len, lines)) <= 80
        assert ("at 38.404012, 14.963012 (30 s)" in " ".join(lines)) == whole


def test_alarms_that_do_not_fit_are_counted(twenty):
    view, monitor = twenty
    alarms = monitor.alarms * 10
    picture = screen("etna", view.rows(30.0), alarms, [], station=None, now_s=30.0, height=30)
    lines = draw(picture)
    assert len(lines) <= 30
    assert any(line.startswith("and ") and line.endswith(" more") for line in lines)


def test_a_status_report_without_anybody(frame):
    lines = draw(report("etna", [], [], None, 0.0))
    assert "0 of 0 live" in lines[0]
    assert "no station" in lines[0]


def observer_of(frame, **changes) -> Observer:
    connection = Connection("etna", (1, 2), ("tcp/127.0.0.1:1",), frame=frame, **changes)
    return Observer(connection, 0.0, patience=0.0)


def test_a_snapshot_is_json_that_can_be_read_back(frame, state, on_air):
    observer = observer_of(frame)
    observer.step(1.0, [on_air(state(1, battery_fraction=0.1))])
    text = to_json(observer.snapshot(1.5))
    assert "\n" not in text
    read = msgspec.json.decode(text, type=Snapshot)
    assert [row.agent for row in read.drones] == ["live", "never"]
    assert [(a.drone, a.code) for a in read.alarms] == [(1, "battery"), (2, "absent")]
    assert read.station is None


def test_the_running_stations_alarms_are_shown_rather_than_our_own(frame, state, on_air):
    observer = observer_of(frame)
    alarm = GroundAlarm(2, Severity.CRITICAL, "orphan", "agent silent", 12.0)
    observer.step(
        1.0, [on_air(state(1, battery_fraction=0.1)), on_air(GroundReport("ground", 1, (alarm,), ()))]
    )
    snapshot = observer.snapshot(1.0)
    assert snapshot.station == "ground"
    assert [(a.drone, a.code, a.age_s) for a in snapshot.alarms] == [(2, "orphan", 12.0)], (
        "drone 2 counts as told of"
    )
    later = observer.snapshot(20.0)
    assert later.station is None, "a station that fell silent is not one"


def test_an_instrument_that_does_not_measure_is_seen_in_its_row_and_no_number_stands_for_it(
    frame, state, on_air
):
    observer = observer_of(frame)
    told = state(1, notes=("co2: silent, unplugged",), tracking_best_ppm=float("nan"), co2_ppm=float("nan"))
    observer.step(1.0, [on_air(told)])
    picture = screen(
        "etna", observer.view.rows(1.0), observer.alarms(1.0), [], station=None, now_s=1.0, height=24
    )
    lines = draw(picture)
    (row,) = [line for line in lines if line.strip().startswith("1 ")]
    assert "WARN co2: silent" in row
    assert any("drone 1: co2: silent, unplugged" in line for line in lines)
    assert "nan" not in "".join(lines)
    read = msgspec.json.decode(to_json(observer.snapshot(1.0)))
    assert read["drones"][0]["notes"] == ["co2: silent, unplugged"]
    assert read["drones"][0]["co2_ppm"] is None


def test_a_little_below_the_background_is_nothing(frame, state, on_air):
    observer = observer_of(frame)
    observer.step(1.0, [on_air(state(1, excess_co2_ppm=Scalar(-0.2, 4.0, 0.1)))])
    text = "\n".join(draw(report("etna", observer.view.rows(1.0), [], None, 1.0)))
    assert "-0" not in text


def test_a_drone_that_only_we_do_not_hear_is_told_with_the_reason(frame, state, table, on_air):
    """The station and drone 1 hear drone 2; this node was given too few endpoints."""
    observer = observer_of(frame)
    messages = [state(1), table(1, (1, 2)), GroundReport("ground", frame.identity, (), ())]
    observer.step(1.0, [on_air(message) for message in messages])
    (alarm,) = observer.snapshot(1.0).alarms
    assert (alarm.drone, alarm.code) == (2, "absent")
    assert alarm.text == "no agent heard here, but drone 1 hears it: is its endpoint in our swarm.connect?"
    observer.step(1.1, [on_air(state(2))])
    assert observer.snapshot(1.1).alarms == ()


def test_a_drone_that_nobody_hears_may_be_off_or_not_connected(frame, state, on_air):
    observer = observer_of(frame)
    observer.step(1.0, [on_air(state(1))])
    (alarm,) = observer.snapshot(1.0).alarms
    assert (
        alarm.text == "no agent heard, but others are: does it run, and is its endpoint in our swarm.connect?"
    )
