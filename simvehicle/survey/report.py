"""`report.html`: one file that tells what a survey did, for a screen, a phone or paper. Nothing in it is fetched."""

from __future__ import annotations

import base64
import functools
import pathlib
from collections.abc import Iterator, Mapping, Sequence

import jinja2
import msgspec

from flightstack.swarm.wire import Severity
from mission.geometry.formation import make_layout
from mission.geometry.geofence import LocalFence
from simvehicle.fleet.truth import VehicleTrack
from simvehicle.survey import figures
from simvehicle.survey.summary import Summary
from simvehicle.survey.survey_file import Survey
from simvehicle.survey.watch import EventMark, Log
from simvehicle.world.configured import make_world

_MOST_EVENTS = 250
_MOST_TREES = 8

_OUTCOMES = {
    "source_found": "Source found",
    "gave_up": "No source in the search area",
    "time_limit": "Not found in time",
    "aborted": "Aborted",
    "failed": "Failed",
}


class Number(msgspec.Struct, frozen=True):
    """A figure of the survey in a box of its own."""

    value: str
    name: str
    off: bool = False
    """It is not as it should be."""


class Drawing(msgspec.Struct, frozen=True):
    title: str
    caption: str
    svg_base64: str


class Column(msgspec.Struct, frozen=True):
    head: str
    number: bool = False
    """Its cells stand right."""


class Row(msgspec.Struct, frozen=True):
    cells: tuple[str, ...]
    kind: str = ""
    """"warning" or "critical" where it stands out."""


class ReportTable(msgspec.Struct, frozen=True):
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]


def write(
    survey: Survey, summary: Summary, tracks: Mapping[int, VehicleTrack], log: Log, directory: pathlib.Path
) -> None:
    """Write `report.html` into `directory`."""
    (directory / "report.html").write_text(page(survey, summary, tracks, log), encoding="utf-8")


def page(survey: Survey, summary: Summary, tracks: Mapping[int, VehicleTrack], log: Log) -> str:
    """The whole report; parts that there is no data for are left out."""
    events, left_out = _events(log.events)
    return (
        _templates()
        .get_template("report.html")
        .render(
            headline=f"{_OUTCOMES.get(summary.outcome, summary.outcome)}: {survey.config.name}",
            good=summary.outcome == "source_found",
            sentence=_sentence(summary),
            numbers=_numbers(summary),
            drawings=list(_drawings(survey, summary, tracks, log)),
            drones=_drones(summary),
            heals=_heals(summary),
            rejoined=[rejoin.words for rejoin in summary.rejoined],
            orphans=_orphans(summary),
            lost_processes=summary.lost_processes,
            warnings=summary.warnings,
            events=events,
            events_left_out=left_out,
            seed=summary.seed,
            log_dir=summary.log_dir,
        )
    )


@functools.cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("simvehicle.survey"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )


def _sentence(summary: Summary) -> str:
    if summary.outcome != "source_found":
        return f"{summary.reason[:1].upper()}{summary.reason[1:]}."
    text = f"{summary.alive} of {summary.drones} drones are alive"
    away = [d for d in summary.per_drone if d.away]
    text += "".join(f", drone {d.drone} came down {d.home_distance_m:.0f} m from its home" for d in away)
    if summary.time_to_source_s is not None:
        text += f"; the source was found {duration(summary.time_to_source_s)} after the first take-off"
    if summary.source_error_m is not None:
        text += f", {summary.source_error_m:.1f} m from where it truly is"
    if summary.source_sd_m is not None:
        text += f" (the swarm knew it to {summary.source_sd_m:.1f} m, one standard deviation)"
    return text + "."


def duration(seconds: float) -> str:
    """ "2 min 05 s"."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _numbers(summary: Summary) -> list[Number]:
    def number(value: float | None, unit: str, digits: int = 1) -> str:
        return "–" if value is None else f"{value:.{digits}f} {unit}"

    def time(value: float | None) -> str:
        return "–" if value is None else duration(value)

    near_m = summary.min_separation_m
    return [
        Number(time(summary.time_to_contact_s), "to first contact"),
        Number(time(summary.time_to_source_s), "to the source"),
        Number(number(summary.source_error_m, "m"), "error of the estimate"),
        Number(f"{summary.alive} of {summary.drones}", "drones alive", summary.alive < summary.drones),
        Number(
            number(near_m, "m"),
            f"smallest separation; {summary.configured_separation_m:g} m is the least allowed",
            near_m is not None and near_m < summary.configured_separation_m,
        ),
        Number(str(summary.fence_breaches), "fence breaches", summary.fence_breaches > 0),
        *(
            [
                Number(
                    number(summary.min_clearance_m, "m"),
                    "from an obstacle at the nearest",
                    summary.obstacles_touched > 0,
                )
            ]
            if summary.min_clearance_m is not None
            else []
        ),
        Number(str(summary.heals), "heals of the tree"),
        Number(
            f"{summary.missed_deadline_fraction:.2%}",
            "agent deadlines missed",
            summary.missed_deadline_fraction > 0.01,
        ),
        Number(duration(summary.simulated_s), f"simulated, in {duration(summary.wall_s)} on the clock"),
    ]


def _drawings(
    survey: Survey, summary: Summary, tracks: Mapping[int, VehicleTrack], log: Log
) -> Iterator[Drawing]:
    config = survey.config
    world = make_world(config)
    fence = LocalFence(world.frame, survey.geofence).area if survey.geofence else None
    homes = {d.id: (d.home_north_m, d.home_east_m) for d in survey.drones}
    height_m = config.formation.above_home_m

    def drawn_map(*, whole_fence: bool) -> str:
        return figures.drawing(
            lambda: figures.survey_map(
                tracks, homes, world, height_m, fence, log, config.obstacles, whole_fence=whole_fence
            )
        )

    yield _drawing(
        drawn_map(whole_fence=False),
        "Map of the survey",
        f"The plume {height_m:g} m above home (CO2 over the background, its mean over the flight), the drones' true "
        f"tracks, their homes (squares), {'obstacles, ' if config.obstacles else ''}and what the swarm made of it.",
    )
    if fence is not None:
        yield _drawing(drawn_map(whole_fence=True), "The survey in its geofence", "The same, further away.")
    if tracks:
        drawn = figures.drawing(
            lambda: figures.over_time(
                tracks,
                log,
                config.background_co2_ppm,
                summary.kills,
                [fault for fault in config.faults if fault.at_s < summary.simulated_s],
                summary.freezes,
            )
        )
        yield _drawing(
            drawn, "CO2, altitude and phases over time", "What each drone flew through, and when it did what."
        )
    trees = [mark for mark in log.trees if mark.slots]
    if trees:
        layout = make_layout(config.formation.layout, config.formation.spacing_m)
        shown = (
            trees if len(trees) <= _MOST_TREES else [*trees[: _MOST_TREES // 2], *trees[-_MOST_TREES // 2 :]]
        )
        drawn = figures.drawing(lambda: figures.swarm_trees(shown, layout, list(homes)))
        yield _drawing(
            drawn, "The swarm's tree", "Each drone's slot in the formation; arrows lead to its parent."
        )


def _drawing(svg: str, title: str, caption: str) -> Drawing:
    return Drawing(title, caption, base64.b64encode(svg.encode()).decode())


def _drones(summary: Summary) -> ReportTable:
    return ReportTable(
        (
            Column("drone", number=True),
            Column("agent"),
            Column("vehicle"),
            Column("from home, m", number=True),
            Column("in the air", number=True),
            Column("battery", number=True),
            Column("highest CO2, ppm", number=True),
            Column("last mode"),
        ),
        tuple(
            Row(
                (
                    str(d.drone),
                    "alive" if d.agent_alive else "dead",
                    "crashed" if d.crashed else "landed" if d.landed else "flying",
                    "–" if d.home_distance_m is None else f"{d.home_distance_m:.1f}",
                    duration(d.flight_s),
                    "–" if d.battery_fraction is None else f"{d.battery_fraction:.0%}",
                    "–" if d.highest_co2_ppm is None else f"{d.highest_co2_ppm:.0f}",
                    d.last_mode,
                )
            )
            for d in summary.per_drone
        ),
    )


def _heals(summary: Summary) -> ReportTable:
    def took(seconds: float | None) -> str:
        return "–" if seconds is None else f"{seconds:.1f} s"

    return ReportTable(
        (
            Column("drone", number=True),
            Column("lost because it"),
            *(Column(head, number=True) for head in ("at", "noticed after", "agreed after", "flown after")),
        ),
        tuple(
            Row(
                (
                    str(h.drone),
                    f"was {h.cause}" if h.cause in ("killed", "frozen") else h.cause,
                    duration(h.at_s),
                    took(h.noticed_after_s),
                    took(h.agreed_after_s),
                    took(h.flown_after_s),
                )
            )
            for h in summary.healings
        ),
    )


def _orphans(summary: Summary) -> ReportTable:
    return ReportTable(
        (Column("drone", number=True), Column("agent died at", number=True), Column("what became of it")),
        tuple(
            Row((str(o.drone), "–" if o.killed_at_s is None else duration(o.killed_at_s), o.story))
            for o in summary.orphans
        ),
    )


def _events(events: Sequence[EventMark]) -> tuple[ReportTable, int]:
    """What is shown of the events, and how many are not."""
    important = [
        e for e in events if e.severity is not Severity.INFO or e.code not in ("phase", "statustext")
    ]
    shown = (events if len(events) <= _MOST_EVENTS else important)[:_MOST_EVENTS]
    return (
        ReportTable(
            (Column("at", number=True), Column("drone", number=True), Column("what"), Column("")),
            tuple(
                Row(
                    (f"{e.time_s:.1f} s", str(e.drone) if e.drone else "–", e.code, e.text),
                    "" if e.severity is Severity.INFO else str(e.severity),
                )
                for e in shown
            ),
        ),
        len(events) - len(shown),
    )
