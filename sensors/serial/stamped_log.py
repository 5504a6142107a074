"""Logs of terminal programs that put the computer's time before every line of an instrument.

Read are the stamps that serial terminals and loggers write: a time of day, `[12:34:56.789] M …` or
`12:34:56.789 -> M …`; a date and a time, `2026-01-02 12:34:56,789 M …` or `[2026-01-02T12:34:56.789Z] M …`; seconds
or milliseconds since 1970, `1767357296.789 M …`; and seconds since the log began, `[   12.345678] M …`.
"""

from __future__ import annotations

import codecs
import datetime
import re
from typing import Final

_DAY_S: Final = 86_400.0
_TIME = (
    r"(?P<hour>[01]?\d|2[0-3]):(?P<minute>[0-5]\d):(?P<second>[0-5]\d|60)(?:[.,](?P<fraction>\d{1,9}))?"
    r"(?: ?(?P<half>[AaPp])[Mm]\b)?"
)
_ISO_DATE = r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})[T _,]"
_OTHER_DATE = (
    r"(?:\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}[T _,]|(?:[A-Z][a-z]{2} )?[A-Z][a-z]{2} +\d{1,2} (?:\d{4} )?)"
)
"""The day is not read where its order is not certain: such stamps are times of the day."""
_ZONE = r"(?: ?(?P<zone>Z|UTC|[+-]\d{2}:?\d{2}))?"
_CLOCK = rf"(?:{_ISO_DATE}|{_OTHER_DATE})?{_TIME}{_ZONE}(?: \d{{4}})?"
_SINCE_1970 = r"(?P<seconds>1\d{9})(?:[.,](?P<part>\d{1,9}))?|(?P<milliseconds>1\d{12})"
_BEHIND = r"[ \t]*(?:->|=>|- |[>:;,|])?[ \t]*(?:R[Xx][:>]?[ \t]+)?"
_STAMP: Final = re.compile(
    rf"[ \t]*(?:\[ *(?:{_CLOCK}|{_SINCE_1970}|(?P<since_start>\d+\.\d+)(?: +\d+\.\d+)?) *\]|BARE){_BEHIND}".replace(
        "BARE", re.sub(r"\?P<(\w+)>", r"?P<bare_\1>", rf"(?:{_CLOCK}|{_SINCE_1970})(?=[ \t>:;,|=-])")
    ),
    re.ASCII,
)


def stamped_lines(data: bytes) -> list[tuple[float, bytes]] | None:
    """Every line with its time (s) and without its stamp; None if most of the lines have no stamp.

    Times are seconds since 1970 where the stamps have a date (UTC, if they tell no zone), since the first midnight
    where they have none, or as they count themselves. A line without a stamp has the time of the one before it.
    """
    lines = [line for line in without_marks(data).splitlines(keepends=True) if line.strip()]
    found = [_STAMP.match(line.decode("latin-1")) for line in lines]
    if 2 * sum(match is not None for match in found) <= len(lines):
        return None
    times = _times([match.groupdict() if match else None for match in found])
    return [
        (time_s, line[match.end() :] if match else line)
        for time_s, line, match in zip(times, lines, found, strict=True)
    ]


def without_marks(data: bytes) -> bytes:
    """`data` without the byte order marks that editors and shells put before text."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace").encode("ascii", "replace")
    return data.removeprefix(codecs.BOM_UTF8)


def _times(stamps: list[dict[str, str | None] | None]) -> list[float]:
    times: list[float] = []
    last_s: float | None = None
    days = 0.0
    for stamp in stamps:
        seconds = None if stamp is None else _seconds(stamp)
        if seconds is None:
            times.append(last_s if last_s is not None else 0.0)
            continue
        time_s, is_of_day = seconds
        if is_of_day:
            time_s += days
            if last_s is not None and time_s < last_s - 0.5 * _DAY_S:  # midnight
                days += _DAY_S
                time_s += _DAY_S
        if last_s is None:
            times = [time_s] * len(times)
        times.append(time_s)
        last_s = time_s
    return times


def _seconds(stamp: dict[str, str | None]) -> tuple[float, bool] | None:
    """The time that a stamp tells, and whether it is one of the day; None for a day that there is not."""
    said = {name.removeprefix("bare_"): value for name, value in stamp.items() if value is not None}
    if "since_start" in said:
        return float(said["since_start"]), False
    if "seconds" in said:
        return float(f"{said['seconds']}.{said.get('part', '0')}"), False
    if "milliseconds" in said:
        return float(said["milliseconds"]) / 1000.0, False
    hour = int(said["hour"])
    if "half" in said:
        hour = hour % 12 + (12 if said["half"] in "Pp" else 0)
    of_day_s = (
        3600.0 * hour + 60.0 * int(said["minute"]) + float(f"{said['second']}.{said.get('fraction', '0')}")
    )
    if "year" not in said:
        return of_day_s, True
    try:
        midnight = datetime.datetime(
            int(said["year"]), int(said["month"]), int(said["day"]), tzinfo=datetime.UTC
        )
    except ValueError:
        return None
    return midnight.timestamp() + of_day_s - _zone_s(said.get("zone", "Z")), False


def _zone_s(zone: str) -> float:
    if zone in ("Z", "UTC"):
        return 0.0
    digits = zone[1:].replace(":", "")
    return (-1.0 if zone[0] == "-" else 1.0) * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:]))
