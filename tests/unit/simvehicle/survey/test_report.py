"""The report holds what it promises, needs nothing from elsewhere, and is made of whatever there is."""

from __future__ import annotations

import math
import pathlib
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from flightstack.swarm.wire import Phase, Severity
from mission.geometry.formation import make_layout
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order, Stage
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.truth import VehicleTrack
from simvehicle.survey import figures, report, summary
from simvehicle.survey.agent_faults import Freeze
from simvehicle.survey.survey_file import Survey, load
from simvehicle.survey.watch import (
    EventMark,
    Log,
    OrderMark,
    PhaseMark,
    SlotMark,
    StandingMark,
    TreeMark,
    WatchStanding,
)
from simvehicle.world.configured import make_world

EXAMPLES = pathlib.Path(__file__).parents[4] / "examples"
SOURCE: Vector3 = (30.0, -85.0, -10.0)
KILL_S = 150.0


class Page(HTMLParser):
    """Which tags there are, and that they are closed in order."""

    VOID = ("meta", "img", "br")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def survey() -> Survey:
    return load(EXAMPLES / "survey.yaml")


def flight(survey: Survey, end_s: float = 420.0) -> tuple[dict[int, VehicleTrack], Log]:
    """A made-up flight: a turn of spiral, then towards the source, then home; drone 3's agent is killed."""
    times_s = np.arange(-5.0, end_s, 0.1)
    angle = np.clip(times_s - 30.0, 0.0, 160.0) / 160.0 * 2.2 * math.pi
    north_m, east_m = 4.0 * angle * np.cos(angle), 4.0 * angle * np.sin(angle)
    share = np.clip((times_s - 190.0) / 120.0, 0.0, 1.0)
    north_m, east_m = north_m + share * (SOURCE[0] - north_m), east_m + share * (SOURCE[1] - east_m)
    home = np.clip((times_s - 350.0) / 30.0, 0.0, 1.0)
    gas = make_world(survey.config).gas
    tracks = {}
    for index, drone in enumerate(survey.drones):
        turn = index * 2.0 * math.pi / 4.0
        slot_n, slot_e = (10.0 * math.cos(turn), 10.0 * math.sin(turn)) if index else (0.0, 0.0)
        n = (north_m + slot_n) * (1.0 - home) + drone.home_north_m * home
        e = (east_m + slot_e) * (1.0 - home) + drone.home_east_m * home
        up_m = np.clip(np.minimum(1.5 * times_s, (400.0 - times_s) * 0.8), 0.0, 10.0)
        flying = up_m > 0.0
        places_ned_m = np.column_stack([n, e, np.full_like(n, -10.0)])
        co2 = gas.excesses_co2_ppm(places_ned_m, 0.0) * flying + 420.0
        tracks[drone.id] = VehicleTrack(
            drone.id, times_s, np.column_stack([n, e, -up_m]), flying, flying,
            tuple("RTL" if drone.id == 3 and t > KILL_S + 6.0 else "GUIDED" for t in times_s),
            co2, np.linspace(1.0, 0.6, len(times_s)),
        )  # fmt: skip
    steps = [
        (Phase.ARMING, -4.0), (Phase.TAKEOFF, 0.0), (Phase.FORMING, 12.0), (Phase.SEARCHING, 30.0),
        (Phase.TRACKING, 190.0), (Phase.RETURNING, 350.0), (Phase.LANDING, 385.0), (Phase.LANDED, 400.0),
    ]  # fmt: skip
    phases = tuple(
        PhaseMark(s, d.id, p)
        for p, s in steps
        for d in survey.drones
        if s < end_s and (d.id != 3 or s < KILL_S)
    )
    orders = [
        OrderMark(float(times_s[i]), Order(
            k, Stage.SEARCH if times_s[i] < 190.0 else Stage.TRACK, (float(north_m[i]), float(east_m[i]), -10.0), 0.0
        ))
        for k, i in enumerate(range(350, min(3500, len(times_s)), 60))
    ]  # fmt: skip
    if end_s > 350.0:
        orders.append(OrderMark(350.0, Order(99, Stage.FOUND, SOURCE, 0.0, (31.0, -83.5, -10.0))))
    trees = (
        TreeMark(-3.0, {d.id: i for i, d in enumerate(survey.drones)}),
        TreeMark(KILL_S + 5.0, {1: 0, 2: 1, 4: 3, 5: 2}),
    )
    events = (
        EventMark(KILL_S, 3, Severity.WARNING, "kill", "agent killed on purpose (kill -9)"),
        EventMark(KILL_S + 4.0, 1, Severity.WARNING, "lost", "drone 3 lost to the swarm"),
        EventMark(KILL_S + 5.0, 1, Severity.INFO, "heal", "epoch 1: 1 in 0, 2 in 1 <&>"),
    )
    slots = [SlotMark(-3.0, d.id, i, False) for i, d in enumerate(survey.drones)]
    standings = (
        StandingMark(KILL_S + 0.9, 3, WatchStanding.DOUBTED),
        StandingMark(KILL_S + 1.5, 3, WatchStanding.GONE),
    )
    return tracks, Log(phases, events, trees, tuple(orders), 1, 20_000, 11, tuple(slots), standings)


def summarised(
    survey: Survey, tracks: dict[int, VehicleTrack], log: Log, **ending: object
) -> summary.Summary:
    values: dict[str, object] = {
        "outcome": "source_found",
        "reason": "the swarm found the source",
        "alive": frozenset({1, 2, 4, 5}),
        "kills": {3: KILL_S},
        "lost_processes": (),
        "wall_s": 95.0,
        "speedup_reached": 3.9,
        "log_dir": "out/crater-rim-20260504-030201",
    }
    fleet = FleetConfig(
        origin=survey.config.origin,
        vehicles=tuple(
            VehicleSpec(id=d.id, links=("-",), home_north_m=d.home_north_m, home_east_m=d.home_east_m)
            for d in survey.drones
        ),
        speedup=survey.config.speedup,
    )
    ended = summary.Ending(**(values | ending))  # type: ignore[arg-type]
    layout = make_layout("hexagonal", 10.0)
    return summary.summarise("crater-rim", fleet, SOURCE, survey.geofence, 4.0, layout, tracks, log, ended)


def test_a_whole_flight(survey: Survey, tmp_path: pathlib.Path) -> None:
    tracks, log = flight(survey)
    report.write(survey, summarised(survey, tracks, log), tracks, log, tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.tags.count("img") == 4
    for words in (
        "Source found", "1.8 m from where it truly is", "4 of 5", "5 min 50 s", "Vehicles that lost their agent",
        "then RTL", "Losses and heals", "was killed", "0.9 s", "0.6 s", "epoch 1: 1 in 0, 2 in 1 <&>",
        "out/crater-rim-20260504-030201",
    ):  # fmt: skip
        assert words in page.text
    assert len(text) < 3_000_000


def test_nothing_is_fetched_from_elsewhere(survey: Survey) -> None:
    tracks, log = flight(survey)
    text = report.page(survey, summarised(survey, tracks, log), tracks, log)
    assert re.findall(r'(?:src|href)="(?!data:)', text) == []
    assert "<script" not in text
    assert "@import" not in text
    assert "url(" not in text


def test_an_aborted_flight(survey: Survey) -> None:
    tracks, log = flight(survey, end_s=80.0)
    got = summarised(
        survey, tracks, log, outcome="aborted", reason="interrupted", kills={}, alive=frozenset({1, 2})
    )
    page = Page(report.page(survey, got, tracks, log))
    assert "Aborted" in page.text
    assert page.tags.count("img") == 4


def test_a_survey_that_never_flew(survey: Survey) -> None:
    lost = ("vehicles ended (exit code 2): a port is in use",)
    got = summarised(
        survey, {}, Log(), outcome="failed", reason=lost[0], alive=frozenset(), kills={}, lost_processes=lost
    )
    page = Page(report.page(survey, got, {}, Log()))
    assert "a port is in use" in page.text
    assert page.tags.count("img") == 2, "the maps without tracks"


def test_without_plume_or_fence(survey: Survey) -> None:
    import msgspec

    bare = msgspec.structs.replace(
        survey, geofence=None, config=msgspec.structs.replace(survey.config, plume=None)
    )
    tracks, log = flight(bare, end_s=100.0)
    Page(report.page(bare, summarised(bare, tracks, log), tracks, log))


def test_durations() -> None:
    assert [report.duration(s) for s in (0.4, 59.6, 61.0, 600.0)] == [
        "0 s",
        "1 min 00 s",
        "1 min 01 s",
        "10 min 00 s",
    ]


def test_kills_and_faults_stand_in_the_figure_over_time(survey: Survey) -> None:
    tracks, log = flight(survey)
    fault = FaultSpec(drone=4, at_s=100.0, kind="gps_loss")
    figure = figures.over_time(tracks, log, 420.0, {3: KILL_S}, [fault])
    told = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert {"kill 3", "gps loss 4"} <= told


def test_who_stood_still_has_no_phase_and_marks_close_together_share_a_line(survey: Survey) -> None:
    tracks, log = flight(survey)
    freezes = (Freeze(5, KILL_S + 1.0, 200.0), Freeze(4, 300.0))
    figure = figures.over_time(tracks, log, 420.0, {3: KILL_S}, [], freezes)
    told = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert {"kill 3, freeze 5", "freeze 4"} <= told
    bars = [bar for bar in figure.axes[2].patches if bar.get_hatch()]
    spans = [(bar.get_y() + 0.4, bar.get_x() * 60.0, (bar.get_x() + bar.get_width()) * 60.0) for bar in bars]
    assert spans == [pytest.approx((4, KILL_S + 1.0, 200.0)), pytest.approx((3, 300.0, 419.9), abs=0.2)]


def test_who_came_back_into_the_tree_is_told(survey: Survey) -> None:
    trees = [TreeMark(0.0, {1: 0, 2: 1}), TreeMark(60.0, {1: 0}), TreeMark(90.0, {1: 0, 2: 2})]
    figure = figures.swarm_trees(trees, make_layout("hexagonal", 10.0), [1, 2])
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["at the start", "after 1.0 min: lost 2", "after 1.5 min: back 2"]


def test_what_is_said_cannot_become_markup(survey: Survey) -> None:
    said = EventMark(3.0, 2, Severity.CRITICAL, "<b>", "</td><script>alert('x')</script>")
    lost = ("vehicles ended (exit code 2): <img src=x>",)
    got = summarised(
        survey,
        {},
        Log(events=(said,)),
        outcome="failed",
        reason="<i>",
        alive=frozenset(),
        lost_processes=lost,
    )
    text = report.page(survey, got, {}, Log(events=(said,)))
    page = Page(text)
    assert not {"script", "i"} & set(page.tags)
    assert page.tags.count("b") == 9, "the boxes' figures"
    assert page.tags.count("img") == 2, "the maps"
    for words in (said.code, said.text, *lost):
        assert words in page.text


def test_of_many_events_the_important_ones_are_shown_and_the_rest_counted(survey: Survey) -> None:
    events = tuple(
        EventMark(float(i), 1, Severity.WARNING if i % 10 == 0 else Severity.INFO, "phase", f"event {i}")
        for i in range(1000)
    )
    page = Page(report.page(survey, summarised(survey, {}, Log()), {}, Log(events=events)))
    assert "event 990" in page.text
    assert "event 991" not in page.text
    assert "900 more are in the recording." in page.text
