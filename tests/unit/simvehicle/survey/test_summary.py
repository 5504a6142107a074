"""The figures of a survey, from tracks whose figures are known."""

from __future__ import annotations

import dataclasses
import json
import math
import pathlib

import numpy as np
import pytest

from flightstack.swarm.wire import Severity
from flightstack.transport.radio_model import RadioModel
from mission.geometry.formation import make_layout
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Geofence
from mission.strategies.contract import Order, Stage
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.truth import TruthRow, TruthTail, VehicleTrack, make_tracks, parse_row, read_tracks
from simvehicle.survey import summary
from simvehicle.survey.agent_faults import Freeze
from simvehicle.survey.conduct import words
from simvehicle.survey.healing import Healing, Rejoin
from simvehicle.survey.watch import EventMark, Log, OrderMark, SlotMark, StandingMark, WatchStanding
from simvehicle.world.world_config import RectangularObstacle

ORIGIN = Geodetic(38.4, 14.96, 300.0)
TIMES_S = np.arange(0.0, 60.0, 0.1)


def track(
    drone: int,
    north_m: np.ndarray | float,
    east_m: np.ndarray | float = 0.0,
    up_m: np.ndarray | float = 10.0,
    airborne: np.ndarray | bool = True,
    modes: tuple[str, ...] | None = None,
) -> VehicleTrack:
    n = len(TIMES_S)
    position = np.column_stack([np.broadcast_to(v, n) for v in (north_m, east_m, -np.asarray(up_m))])
    flying = np.broadcast_to(airborne, n)
    return VehicleTrack(
        drone,
        TIMES_S,
        position,
        flying,
        flying,
        modes or ("GUIDED",) * n,
        np.full(n, 430.0),
        np.linspace(1, 0.8, n),
    )


def summarise(
    tracks: dict[int, VehicleTrack],
    log: Log | None = None,
    *,
    faults: tuple[FaultSpec, ...] = (),
    **ending: object,
) -> summary.Summary:
    values: dict[str, object] = {
        "outcome": "source_found",
        "reason": "found",
        "alive": frozenset(tracks),
        "kills": {},
        "lost_processes": (),
        "wall_s": 12.0,
        "speedup_reached": 4.0,
        "log_dir": "out/x",
    }
    fleet = FleetConfig(
        origin=ORIGIN,
        vehicles=tuple(
            VehicleSpec(id=d, links=("udpout:127.0.0.1:1",), home_north_m=20.0 * d) for d in (1, 2)
        ),
        faults=faults,
    )
    return summary.summarise(
        "test",
        fleet,
        (30.0, 40.0, -10.0),
        None,
        4.0,
        make_layout("hexagonal", 10.0),
        tracks,
        log or Log(),
        summary.Ending(**(values | ending)),  # type: ignore[arg-type]
    )


def test_the_closest_approach_lies_between_samples_and_in_three_dimensions() -> None:
    # They pass head on at 10 m/s each, 3 m apart in height and 4 m to the side: 5 m at the nearest, at 30.05 s.
    one = track(1, 10.0 * (TIMES_S - 30.05))
    other = track(2, -10.0 * (TIMES_S - 30.05), east_m=4.0, up_m=13.0)
    near = summary.closest_approach({1: one, 2: other})
    assert near is not None
    assert near.distance_m == pytest.approx(5.0, abs=1e-6)
    assert near.time_s == pytest.approx(30.0, abs=0.11)


def test_the_closest_approach_between_rows_that_are_not_evenly_spaced() -> None:
    """As the vehicles' process writes them: a row belongs to the step that it was made in."""
    times_s = TIMES_S + np.resize([0.0, 0.04, 0.06, 0.0], len(TIMES_S))  # 0, 0.14, 0.26, 0.3, 0.4, …
    one = dataclasses.replace(track(1, 10.0 * (times_s - 28.2)), time_s=times_s)
    other = dataclasses.replace(track(2, -10.0 * (times_s - 28.2), up_m=15.0), time_s=times_s)
    near = summary.closest_approach({1: one, 2: other})
    assert near is not None
    assert near.distance_m == pytest.approx(5.0, abs=0.01)


def test_a_fault_that_came_too_late_is_told() -> None:
    fault = FaultSpec(drone=2, at_s=99.0, kind="gps_loss")
    told = summarise({1: track(1, 0.0), 2: track(2, 9.0)}, faults=(fault,)).warnings
    assert told == ("the gps loss of drone 2 at 99 s did not happen: the survey had ended",)
    assert summarise({1: track(1, 0.0)}, faults=(FaultSpec(drone=1, at_s=9.0, kind="motor"),)).warnings == ()


def test_vehicles_on_the_ground_have_no_separation() -> None:
    near = summary.closest_approach({1: track(1, 0.0), 2: track(2, 0.5, airborne=False)})
    assert near is None
    landed = track(2, 0.5, airborne=TIMES_S < 1.0)
    apart = track(1, np.where(TIMES_S < 2.0, 30.0, 0.0))
    near = summary.closest_approach({1: apart, 2: landed})
    assert near is not None
    assert near.distance_m == pytest.approx(29.5)


def test_how_near_vehicles_came_to_obstacles_and_how_often_they_touched() -> None:
    rock = RectangularObstacle(
        centre_north_m=0.0, centre_east_m=0.0, length_north_m=10.0, length_east_m=10.0, top_above_home_m=30.0
    )
    beside = summary.obstacle_clearance({1: track(1, TIMES_S - 30.0, east_m=8.0)}, (rock,))
    assert beside == summary.Clearance(pytest.approx(3.0), 0)  # type: ignore[arg-type]
    over = summary.obstacle_clearance({1: track(1, TIMES_S - 30.0, up_m=31.0)}, (rock,))
    assert over == summary.Clearance(pytest.approx(1.0), 0)  # type: ignore[arg-type]
    swaying = summary.obstacle_clearance({1: track(1, 8.0 * np.cos(TIMES_S / 60.0 * 4.0 * np.pi))}, (rock,))
    assert swaying.touches == 4, "in and out again, from both sides, twice"
    assert swaying.nearest_m == pytest.approx(-5.0, abs=0.2)
    standing = summary.obstacle_clearance({1: track(1, 0.0, airborne=False)}, (rock,))
    assert standing == summary.Clearance(math.inf, 0)
    assert summarise({1: track(1, 0.0)}).min_clearance_m is None


def square(half_m: float) -> Geofence:
    frame = LocalFrame(ORIGIN)
    corners = [(half_m, half_m), (half_m, -half_m), (-half_m, -half_m), (-half_m, half_m)]
    points = [frame.to_geodetic((n, e, 0.0)) for n, e in corners]
    return Geofence(inclusion=(tuple((p.latitude_deg, p.longitude_deg) for p in points),))


def test_a_breach_is_counted_once_until_the_drone_is_well_inside_again() -> None:
    fence, frame = square(50.0), LocalFrame(ORIGIN)
    trembling = 50.0 + 0.5 * np.sin(TIMES_S * 5.0)
    assert summary.fence_breaches({1: track(1, trembling)}, frame, fence) == 1
    out_twice = 50.0 + 5.0 * np.sin(TIMES_S * 2.0 * math.pi / 30.0)
    assert summary.fence_breaches({1: track(1, out_twice)}, frame, fence) == 2
    assert summary.fence_breaches({1: track(1, out_twice, airborne=False)}, frame, fence) == 0
    assert summary.fence_breaches({1: track(1, 45.0)}, frame, fence) == 0
    assert summary.fence_breaches({1: track(1, out_twice)}, frame, None) == 0


def test_times_and_error_come_from_the_orders() -> None:
    orders = (
        OrderMark(3.0, Order(1, Stage.SEARCH, (0.0, 0.0, -10.0), 0.0)),
        OrderMark(21.04, Order(2, Stage.TRACK, (5.0, 0.0, -10.0), 0.0)),
        OrderMark(44.0, Order(3, Stage.FOUND, (5.0, 0.0, -10.0), 0.0, (33.0, 44.0, -10.0))),
    )
    got = summarise(
        {1: track(1, 0.0), 2: track(2, 20.0)}, Log(orders=orders, heals=2, ticks=1000, late_ticks=3)
    )
    assert (got.time_to_contact_s, got.time_to_source_s, got.source_error_m) == (21.0, 44.0, 5.0)
    assert (got.heals, got.missed_deadline_fraction, got.min_separation_m) == (2, 0.003, 20.0)
    assert (got.drones, got.alive) == (2, 2)
    assert got.source_sd_m is None


def test_how_well_the_source_is_known_is_told_where_the_swarm_says_so() -> None:
    found = Order(3, Stage.FOUND, (5.0, 0.0, -10.0), 0.0, (33.0, 44.0, -10.0), source_sd_m=3.456)
    got = summarise({1: track(1, 0.0)}, Log(orders=(OrderMark(44.0, found),)))
    assert got.source_sd_m == 3.46
    assert "source after 44 s, 5.0 m off, standard deviation told 3.5 m" in words(got)


def test_a_survey_of_which_nothing_is_known() -> None:
    got = summarise({}, outcome="failed", alive=frozenset())
    assert (got.alive, got.min_separation_m, got.source_error_m, got.simulated_s) == (0, None, None, 0.0)
    assert all(d.home_distance_m is None for d in got.per_drone)


def test_an_orphan_tells_how_it_came_home() -> None:
    flying = TIMES_S < 50.0
    modes = tuple("GUIDED" if t < 26.0 else "RTL" for t in TIMES_S)
    orphan = track(2, np.where(TIMES_S < 40.0, 0.0, 40.5), airborne=flying, modes=modes)
    got = summarise({1: track(1, 20.0), 2: orphan}, alive=frozenset({1}), kills={2: 20.0})
    (told,) = got.orphans
    assert (told.drone, told.killed_at_s, told.modes, told.brought_home_by) == (
        2,
        20.0,
        "GUIDED > RTL",
        "autopilot",
    )
    assert told.mode_changed_after_s == pytest.approx(6.0, abs=0.11)
    assert told.home_distance_m == 0.5
    assert "then RTL (its autopilot by itself); landed 30 s after" in told.story
    assert got.alive == 1
    sent = EventMark(25.0, 2, Severity.WARNING, "bring_home", "agent silent: RTL commanded")
    got = summarise(
        {1: track(1, 20.0), 2: orphan}, Log(events=(sent,)), alive=frozenset({1}), kills={2: 20.0}
    )
    assert got.orphans[0].brought_home_by == "ground station"


def test_a_px4_that_came_home_did_not_go_on_in_offboard_on_the_ground() -> None:
    flying = TIMES_S < 50.0
    modes = tuple("RTL" if 21.0 <= t < 52.0 else "OFFBOARD" for t in TIMES_S)
    orphan = track(2, np.where(TIMES_S < 40.0, 0.0, 40.5), airborne=flying, modes=modes)
    got = summarise({1: track(1, 20.0), 2: orphan}, alive=frozenset({1}), kills={2: 20.0})
    assert got.orphans[0].modes == "OFFBOARD > RTL"


def test_an_agent_frozen_to_the_end_leaves_an_orphan_and_one_that_was_woken_does_not() -> None:
    flying = TIMES_S < 50.0
    tracks = {1: track(1, 20.0, airborne=flying), 2: track(2, 40.0, airborne=flying)}
    got = summarise(tracks, alive=frozenset({1}), freezes=(Freeze(1, 5.0, 15.04), Freeze(2, 20.0)))
    assert [(o.drone, o.killed_at_s, o.mode_changed_after_s) for o in got.orphans] == [(2, None, None)]
    assert got.freezes == (Freeze(1, 5.0, 15.0), Freeze(2, 20.0, None))
    told = words(got).splitlines()
    assert "drone 1: agent frozen at 5 s, woken at 15 s" in told
    assert "drone 2: agent frozen at 20 s and not woken again" in told


def test_an_agent_that_died_by_itself_leaves_an_orphan_too() -> None:
    died = EventMark(10.0, 0, Severity.CRITICAL, "process", "drone-2 ended (signal 11)")
    got = summarise({2: track(2, 0.0)}, Log(events=(died,)), alive=frozenset())
    assert got.orphans[0].killed_at_s is None
    assert "still flying" in got.orphans[0].story


def test_a_vehicle_that_fell_is_not_alive() -> None:
    up_m = np.maximum(0.0, 10.0 - np.maximum(0.0, TIMES_S - 20.0) ** 2 * 4.9)
    fallen = track(2, 40.0, up_m=up_m, airborne=up_m > 0.0)
    gently = track(1, 20.0, up_m=np.maximum(0.0, 10.0 - 0.5 * TIMES_S), airborne=TIMES_S < 20.0)
    got = summarise({1: gently, 2: fallen})
    assert [d.crashed for d in got.per_drone] == [False, True]
    assert got.alive == 1


def test_who_comes_down_away_from_home_is_told() -> None:
    flying = TIMES_S < 50.0
    got = summarise({1: track(1, 20.0, airborne=flying), 2: track(2, 107.0, airborne=flying)})
    assert [d.away for d in got.per_drone] == [False, True]
    assert "drone 2: came down 67.0 m from its home, in GUIDED" in words(got).splitlines()


def test_how_long_healing_took_and_who_came_back_is_told() -> None:
    slots = (SlotMark(0.0, 1, 0, False), SlotMark(0.0, 2, 1, False))
    standings = (
        StandingMark(20.94, 2, WatchStanding.DOUBTED),
        StandingMark(21.5, 2, WatchStanding.GONE),
        StandingMark(31.0, 2, WatchStanding.THERE),
    )
    got = summarise(
        {1: track(1, 0.0), 2: track(2, 9.0)},
        Log(slots=slots, standings=standings, heals=1),
        freezes=(Freeze(2, 20.0, 30.0),),
    )
    assert got.healings == (Healing(2, "frozen", 20.0, 0.9, 0.6, 0.0),)
    assert got.rejoined == (Rejoin(2, 1, 30.0, 31.0, 31.0),)
    told = words(got).splitlines()
    assert "drone 2 frozen at 20 s, noticed after 0.9 s, agreed after 0.6 s, flown after 0.0 s" in told
    assert "drone 2 back in the swarm 1.0 s after it was woken, in slot 1, there 0.0 s later" in told


def test_how_the_swarm_talked_is_told_where_it_was_not_plain() -> None:
    tracks = {1: track(1, 0.0)}
    assert "messages were heard" not in words(summarise(tracks))
    lossy = words(summarise(tracks, radio=RadioModel(loss=0.2), encrypted=True))
    assert (
        "messages were heard through the survey's radio (20% lost everywhere), encrypted"
        in lossy.splitlines()
    )
    assert "messages were heard, encrypted" in words(summarise(tracks, encrypted=True)).splitlines()


def test_the_summary_file_is_json_with_the_promised_names(tmp_path: pathlib.Path) -> None:
    summary.write(summarise({1: track(1, 20.0)}), tmp_path)
    data = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert data.keys() >= {
        "outcome", "drones", "alive", "time_to_contact_s", "time_to_source_s", "source_error_m",
        "min_separation_m", "configured_separation_m", "fence_breaches", "heals", "log_dir", "kills",
        "orphans", "missed_deadline_fraction", "wall_s", "simulated_s", "healings", "rejoined",
    }  # fmt: skip


def test_the_world_record_is_read_as_it_grows(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "truth.csv"
    tail = TruthTail(path)
    assert tail.read() == []
    with path.open("w", encoding="utf-8") as file:
        file.write("time_s,drone,north_m,east_m,down_m,airborne,armed,mode,co2_ppm,battery_fraction\n")
        file.write("5.0,1,1.0,2.0,-3.0,0,1,GUIDED,420.5,0.9\n5.1,1,1.0,2.0,-3")
        file.flush()
        assert tail.read() == [TruthRow(5.0, 1, (1.0, 2.0, -3.0), False, True, "GUIDED", 420.5, 0.9)]
        assert tail.read() == []
        file.write(".5,1,1,GUIDED,421.0,0.9\n")
        file.flush()
        assert [row.airborne for row in tail.read()] == [True]
    tail.close()
    assert read_tracks(path)[1].time_s == pytest.approx([-0.1, 0.0])
    assert read_tracks(tmp_path / "none.csv") == {}


@pytest.mark.parametrize("line", ["", "a,b", "x,1,1,1,1,1,1,m,1,1"])
def test_broken_rows_are_passed_over(line: str) -> None:
    assert parse_row(line) is None


def test_tracks_count_from_the_first_take_off_of_any() -> None:
    rows = [
        TruthRow(t, d, (0.0, 0.0, 0.0), t >= 10.0 + d, True, "X", 420.0, 1.0)
        for t in range(20)
        for d in (1, 2)
    ]
    assert make_tracks(reversed(rows))[2].time_s[0] == -11.0
