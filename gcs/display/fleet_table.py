"""The fleet as text: one table for `gcs status` and `gcs watch`, legible at 80 columns.

Colour only underlines what a word says: everything can be read in black and white.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from flightstack.swarm.wire import Event, Severity
from gcs.fleet.monitor import Alarm
from gcs.fleet.view import DroneRow

STYLES = {Severity.CRITICAL: "bold white on red", Severity.WARNING: "bold yellow", Severity.INFO: "cyan"}
WORDS = {Severity.CRITICAL: "CRIT", Severity.WARNING: "WARN", Severity.INFO: "info"}
_PHASE_STYLES = {
    "searching": "green",
    "tracking": "bold green",
    "pilot": "bold magenta",
    "holding": "yellow",
    "returning": "blue",
    "landing": "blue",
    "rtl": "blue",
    "crashed": "bold red",
}
_DASH = "–"
_RULER: Final = Console(width=80)
"""Only measures: rich wraps text for a console."""


def fleet_table(rows: Sequence[DroneRow], alarms: Sequence[Alarm]) -> Table:
    """One line a drone; the last column holds its worst alarm, or else its first note."""
    table = Table(box=None, padding=(0, 1, 0, 0), expand=True, show_edge=False, header_style="bold")
    for title, width, right in (
        ("#", 3, True),
        ("agent", 6, False),
        ("phase", 9, False),
        ("mode", 8, False),
        ("alt m", 5, True),
        ("CO2+", 5, True),
        ("wind", 7, True),
        ("bat", 4, True),
        ("tree", 5, False),
    ):
        table.add_column(
            title, width=width, justify="right" if right else "left", no_wrap=True, overflow="ellipsis"
        )
    table.add_column("alarm or note", ratio=1, no_wrap=True, overflow="ellipsis")
    worst = {alarm.drone: alarm for alarm in reversed(alarms)}
    for row in rows:
        table.add_row(*_cells(row, worst.get(row.drone)))
    return table


def _cells(row: DroneRow, alarm: Alarm | None) -> list[Text]:
    agent_style = {"live": "green", "silent": "bold red", "never": "dim"}[row.agent]
    battery_style = "" if row.battery_fraction is None or row.battery_fraction > 0.3 else "bold red"
    return [
        Text(str(row.drone), style="bold" if row.member else "dim"),
        Text(row.agent.upper(), style=agent_style),
        Text(row.phase or _DASH, style=_PHASE_STYLES.get(row.phase or "", "")),
        Text((row.mode or _DASH) if row.armed is not False else f"({row.mode or _DASH})"),
        Text(_number(row.above_home_m, ".1f")),
        Text(_number(row.excess_co2_ppm, ".0f"), style="bold" if (row.excess_co2_ppm or 0.0) > 10.0 else ""),
        Text(_wind(row)),
        Text(_DASH if row.battery_fraction is None else f"{row.battery_fraction:.0%}", style=battery_style),
        Text(_tree(row)),
        _remark(row, alarm),
    ]


def _remark(row: DroneRow, alarm: Alarm | None) -> Text:
    if alarm is not None:
        code = alarm.code.partition(":")[0]
        # An instrument's trouble begins with its name; there is room for little more.
        named = code == "sensor" or alarm.text.startswith(code)
        text = alarm.text if named else f"{code}: {alarm.text}"
        return Text(f"{WORDS[alarm.severity]} {text}", style=STYLES[alarm.severity])
    if row.restarts:
        return Text(f"agent restarted {row.restarts} times" if row.restarts > 1 else "agent restarted once")
    return Text(row.notes[0] if row.notes else "", style="dim")


def _number(value: float | None, form: str) -> str:
    if value is None or not math.isfinite(value):
        return _DASH
    text = format(value, form)
    return text if float(text) else format(0.0, form)  # "-0" is nothing that a person reads


def _wind(row: DroneRow) -> str:
    if row.wind_mps is None or row.wind_from_deg is None:
        return _DASH
    return f"{row.wind_mps:.1f}/{row.wind_from_deg:03.0f}"


def _tree(row: DroneRow) -> str:
    """Slot and parent: "4<2" is slot 4 under drone 2; the root has no parent."""
    if row.slot is None:
        return "heal" if row.healing else _DASH
    place = f"{row.slot}" if row.parent is None else f"{row.slot}<{row.parent}"
    return f"{place}!" if row.healing else place


def headline(swarm: str, rows: Sequence[DroneRow], alarms: Sequence[Alarm], station: str | None) -> Text:
    """One line: how many drones live and fly, how many alarms, whether a ground station runs."""
    live = sum(row.agent == "live" for row in rows)
    flying = sum(bool(row.airborne) for row in rows)
    best = max((row.excess_co2_ppm for row in rows if row.excess_co2_ppm is not None), default=None)
    epoch = max((row.epoch for row in rows if row.epoch is not None and row.agent == "live"), default=None)
    text = Text(f"{swarm}: {live} of {len(rows)} live, {flying} flying", style="bold")
    text.append("" if best is None else f", CO2 {_number(best, '+.0f')} ppm", style="not bold")
    text.append("" if epoch is None else f", epoch {epoch}", style="not bold")
    text.append(f", {station}" if station else ", no station", style="not bold")
    for severity in (Severity.CRITICAL, Severity.WARNING):
        count = sum(alarm.severity is severity for alarm in alarms)
        if count:
            text.append(" ")
            text.append(f" {count} {WORDS[severity]} ", style=STYLES[severity])
    return _one_line(text)


def alarm_line(alarm: Alarm, now_s: float) -> Text:
    who = f"drone {alarm.drone}" if alarm.drone else "swarm"
    text = Text(f"{WORDS[alarm.severity]:4}", style=STYLES[alarm.severity])
    text.append(f" {who}: {alarm.text}", style="default not bold on default")
    age_s = max(now_s - alarm.since_s, 0.0)
    return text.append(f" ({age_s:.0f} s)", style="dim not bold on default")


def event_line(event: Event, age_s: float) -> Text:
    who = f"drone {event.sender}" if event.sender else "swarm"
    style = "dim" if event.severity is Severity.INFO else STYLES[event.severity]
    return Text(f"{age_s:4.0f} s ago  ", style="dim").append(f"{who}: {event.text}", style=style)


def report(
    swarm: str, rows: Sequence[DroneRow], alarms: Sequence[Alarm], station: str | None, now_s: float
) -> RenderableType:
    """What `gcs status` prints: everything, however long."""
    return Group(
        headline(swarm, rows, alarms, station),
        *((fleet_table(rows, alarms),) if rows else ()),
        *(alarm_line(alarm, now_s) for alarm in alarms),
    )


def screen(
    swarm: str,
    rows: Sequence[DroneRow],
    alarms: Sequence[Alarm],
    events: Sequence[tuple[float, Event]],
    *,
    station: str | None,
    now_s: float,
    height: int,
    width: int = 80,
) -> RenderableType:
    """What `gcs watch` draws on a terminal of `height` lines and `width` columns: table, then alarms, then newest
    events. Alarms are whole where there is room: the place of a crash stands at the end of one."""
    lines: list[RenderableType] = [headline(swarm, rows, alarms, station), fleet_table(rows, alarms)]
    room = height - len(rows) - 3  # headline, table header, last line
    shown = list(alarms[: max(room - 2, 0)])
    if shown:
        texts = [alarm_line(alarm, now_s) for alarm in shown]
        taken = sum(len(text.wrap(_RULER, width)) for text in texts)
        if taken > room - 2:
            texts, taken = [_one_line(text) for text in texts], len(shown)
        lines += [Text(""), *texts]
        room -= taken + 1
        if len(shown) < len(alarms):
            lines.append(Text(f"and {len(alarms) - len(shown)} more"))
            room -= 1
    if room > 1 and events:
        newest = list(events)[-(room - 1) :]
        lines += [Text(""), *(_one_line(event_line(event, now_s - at_s)) for at_s, event in newest)]
    lines.append(Text("Ctrl-C ends the display; the swarm flies on", style="dim"))
    return Group(*lines)


def _one_line(text: Text) -> Text:
    text.no_wrap = True
    text.overflow = "ellipsis"
    return text
