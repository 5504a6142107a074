"""`report.html`: one file that tells what a survey did, for a screen, a phone or paper. Nothing in it is fetched."""

from __future__ import annotations

import base64
import html
import pathlib
from collections.abc import Iterable, Mapping, Sequence

from flightstack.swarm.wire import Severity
from mission.geometry.formation import make_layout
from mission.geometry.geofence import LocalFence
from simvehicle.fleet.truth import Track
from simvehicle.survey import figures
from simvehicle.survey.summary import Summary
from simvehicle.survey.survey_file import Survey
from simvehicle.survey.watch import EventMark, Log
from simvehicle.world.configured import make_world

_MOST_EVENTS = 250

_OUTCOMES = {
    "source_found": "Source found",
    "gave_up": "No source in the search area",
    "time_limit": "Not found in time",
    "aborted": "Aborted",
    "failed": "Failed",
}

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.45 system-ui, sans-serif; color: #1a1a1a; background: #fff; margin: 0 auto; padding: 1rem;
  max-width: 76rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; }
h2 { font-size: 1.15rem; margin: 1.6rem 0 .4rem; }
p { margin: .3rem 0; }
.good { border-left: .5rem solid #1b7f3b; padding-left: .8rem; }
.bad { border-left: .5rem solid #b00020; padding-left: .8rem; }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); gap: 1rem 2rem;
  align-items: start; }
figure { margin: 0; break-inside: avoid; }
figure img { width: 100%; height: auto; }
figcaption { font-size: .9rem; color: #444; }
.numbers { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .5rem; margin: 1rem 0; }
.numbers div { border: 1px solid #ccc; border-radius: .3rem; padding: .4rem .6rem; break-inside: avoid; }
.numbers b { display: block; font-size: 1.2rem; }
.numbers div.off { border: 2px solid #b00020; background: #fff1f1; }
.numbers span { font-size: .85rem; color: #444; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .2rem .7rem .2rem 0; border-bottom: 1px solid #ddd; }
td.n, th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
tr.warning td { background: #fff6e0; }
tr.critical td { background: #ffe8e8; }
@media print { body { font-size: 11px; } .figures { grid-template-columns: 1fr 1fr; } .wide { overflow: visible; } }
"""


def write(
    survey: Survey, summary: Summary, tracks: Mapping[int, Track], log: Log, directory: pathlib.Path
) -> None:
    """Write `report.html` into `directory`."""
    (directory / "report.html").write_text(page(survey, summary, tracks, log), encoding="utf-8")


def page(survey: Survey, summary: Summary, tracks: Mapping[int, Track], log: Log) -> str:
    """The whole report; parts that there is no data for are left out."""
    headline = f"{_OUTCOMES.get(summary.outcome, summary.outcome)}: {survey.config.name}"
    good = summary.outcome == "source_found"
    body = [
        f'<header class="{"good" if good else "bad"}"><h1>{html.escape(headline)}</h1>',
        f"<p>{html.escape(_sentence(summary))}</p></header>",
        _numbers(summary),
        '<div class="figures">',
        *_figures(survey, summary, tracks, log),
        "</div>",
        *_tables(summary, log),
    ]
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(headline)}</title><style>{_STYLE}</style></head><body>"
        + "\n".join(body)
        + "</body></html>\n"
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
    return text + "."


def duration(seconds: float) -> str:
    """ "2 min 05 s"."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _numbers(summary: Summary) -> str:
    def number(value: float | None, unit: str, digits: int = 1) -> str:
        return "–" if value is None else f"{value:.{digits}f} {unit}"

    def time(value: float | None) -> str:
        return "–" if value is None else duration(value)

    near_m = summary.min_separation_m
    cells = [
        (time(summary.time_to_contact_s), "to first contact", False),
        (time(summary.time_to_source_s), "to the source", False),
        (number(summary.source_error_m, "m"), "error of the estimate", False),
        (f"{summary.alive} of {summary.drones}", "drones alive", summary.alive < summary.drones),
        (
            number(near_m, "m"),
            f"smallest separation; {summary.configured_separation_m:g} m is the least allowed",
            near_m is not None and near_m < summary.configured_separation_m,
        ),
        (str(summary.fence_breaches), "fence breaches", summary.fence_breaches > 0),
        (str(summary.heals), "heals of the tree", False),
        (
            f"{summary.missed_deadline_fraction:.2%}",
            "agent deadlines missed",
            summary.missed_deadline_fraction > 0.01,
        ),
        (
            duration(summary.simulated_s),
            f"simulated, in {duration(summary.wall_s)} on the clock",
            False,
        ),
    ]
    boxes = "".join(
        f"<div{' class=off' if off else ''}><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>"
        for value, name, off in cells
    )
    return f'<div class="numbers">{boxes}</div>'


def _figures(survey: Survey, summary: Summary, tracks: Mapping[int, Track], log: Log) -> Iterable[str]:
    config = survey.config
    world = make_world(config)
    fence = LocalFence(world.frame, survey.geofence).area if survey.geofence else None
    homes = {d.id: (d.home_north_m, d.home_east_m) for d in survey.drones}
    height_m = config.formation.above_home_m

    def drawn_map(*, whole_fence: bool) -> str:
        return figures.drawing(
            lambda: figures.survey_map(tracks, homes, world, height_m, fence, log, whole_fence=whole_fence)
        )

    yield _figure(
        drawn_map(whole_fence=False),
        "Map of the survey",
        f"The plume {height_m:g} m above home (CO2 over the background), the drones' true tracks, "
        "their homes (squares), and what the swarm made of it.",
    )
    if fence is not None:
        yield _figure(drawn_map(whole_fence=True), "The survey in its geofence", "The same, further away.")
    if tracks:
        drawn = figures.drawing(
            lambda: figures.over_time(
                tracks,
                log,
                config.background_co2_ppm,
                summary.kills,
                [fault for fault in config.faults if fault.at_s < summary.simulated_s],
            )
        )
        yield _figure(
            drawn, "CO2, altitude and phases over time", "What each drone flew through, and when it did what."
        )
    trees = [mark for mark in log.trees if mark.slots]
    if trees:
        layout = make_layout(config.formation.layout, config.formation.spacing_m)
        shown = trees if len(trees) <= 6 else [*trees[:3], *trees[-3:]]
        drawn = figures.drawing(lambda: figures.swarm_trees(shown, layout, list(homes)))
        yield _figure(
            drawn, "The swarm's tree", "Each drone's slot in the formation; arrows lead to its parent."
        )


def _figure(svg: str, title: str, caption: str) -> str:
    data = base64.b64encode(svg.encode()).decode()
    name = html.escape(title)
    return (
        f'<figure><h2>{name}</h2><img alt="{name}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def _tables(summary: Summary, log: Log) -> Iterable[str]:
    yield "<h2>Drones</h2>"
    yield _table(
        (
            "n:drone",
            "agent",
            "vehicle",
            "n:from home, m",
            "n:in the air",
            "n:battery",
            "n:highest CO2, ppm",
            "last mode",
        ),
        (
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
            for d in summary.per_drone
        ),
    )
    if summary.orphans:
        yield "<h2>Vehicles that lost their agent</h2>"
        yield _table(
            ("n:drone", "n:agent died at", "what became of it"),
            (
                (str(o.drone), "–" if o.killed_at_s is None else duration(o.killed_at_s), o.story)
                for o in summary.orphans
            ),
        )
    for title, lines in (
        ("Processes that ended by themselves", summary.lost_processes),
        ("Warnings", summary.warnings),
    ):
        if lines:
            yield f"<h2>{title}</h2><ul>{''.join(f'<li>{html.escape(line)}</li>' for line in lines)}</ul>"
    yield "<h2>Events</h2>"
    yield from _events(log.events)
    yield f"<p>Seed {summary.seed}; recordings and logs: <code>{html.escape(summary.log_dir)}</code></p>"


def _events(events: Sequence[EventMark]) -> Iterable[str]:
    important = [
        e for e in events if e.severity is not Severity.INFO or e.code not in ("phase", "statustext")
    ]
    shown = events if len(events) <= _MOST_EVENTS else important
    if not events:
        yield "<p>None was heard.</p>"
        return
    left_out = len(events) - len(shown[:_MOST_EVENTS])
    yield _table(
        ("n:at", "n:drone", "what", ""),
        (
            (f"{e.time_s:.1f} s", str(e.drone) if e.drone else "–", e.code, e.text)
            for e in shown[:_MOST_EVENTS]
        ),
        [str(e.severity) for e in shown[:_MOST_EVENTS]],
    )
    if left_out:
        yield f"<p>{left_out} more are in the recording.</p>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], kinds: Sequence[str] = ()) -> str:
    """A table; a head that begins with "n:" is that of a column of numbers."""
    number = [head.startswith("n:") for head in heads]
    marks = [' class="n"' if n else "" for n in number]
    head = "".join(
        f"<th{m}>{html.escape(h.removeprefix('n:'))}</th>" for h, m in zip(heads, marks, strict=True)
    )
    lines = []
    for index, row in enumerate(rows):
        kind = f' class="{kinds[index]}"' if kinds and kinds[index] != "info" else ""
        cells = "".join(f"<td{m}>{html.escape(c)}</td>" for c, m in zip(row, marks, strict=True))
        lines.append(f"<tr{kind}>{cells}</tr>")
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'
