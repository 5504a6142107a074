"""What one reading of an SBA-5 says, whichever of its fields are switched on (see `sensors.instruments.sba5`)."""

from __future__ import annotations

import dataclasses
import itertools
import re
from typing import Final

from sensors.instruments.framing import number

STATUS: Final = {
    1: "low detector counts: source or detector failing, or the cell is dirty",
    2: "too cold",
    3: "too hot",
    4: "low alarm",
    5: "humidity too high",
    6: "supply voltage low",
}
"""Status codes other than 0; a reading with one of them is not valid."""

_GOOD_TEXTS: Final = ("ok", "no error", "no errors")
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9.,:;'()/_-]*", re.ASCII)
_ZERO_COUNTS_AT_LEAST: Final = 25_000
_THERMOSTAT_C: Final = 55.0
_HUMIDITY_AT_MOST_MB: Final = 90.0


@dataclasses.dataclass(frozen=True)
class Measurement:
    ppm: float
    temperature_c: float | None
    pressure_mb: float | None
    status: str
    """The code as sent, or the text that continuous display has in its place; empty without either."""
    fault: str
    """Why the reading does not count; empty where it does."""
    form: tuple[bool, ...]
    """Which of the numbers have decimals, and whether there is a status: a lost field makes another form."""
    usual: bool
    """All the fields that it sends as delivered, or all but the last two temperatures of older firmware."""
    plausible: bool
    """Every number can be what its place says."""


def measurement(fields: list[str]) -> Measurement | None:
    """The fields behind the M of a line; None for what no setting of an SBA-5 makes."""
    values: list[float] = []
    for field in fields:
        value = number(field)
        if value is None:
            break
        values.append(value)
    numbers, words = fields[: len(values)], fields[len(values) :]
    if not numbers or not all(_WORD.fullmatch(word) for word in words):
        return None
    status = " ".join(words)
    if not words and numbers[-1].isdecimal() and len(numbers[-1]) <= 2:
        status = numbers.pop()
    form = (*["." in token for token in numbers], bool(status))
    analog = bool(status) and len(numbers) in (8, 10) and numbers[-1].isdecimal()
    found = _usual(numbers[:-1] if analog else numbers, values, status, form)
    if found is not None and found.plausible:
        return found
    other = _unusual(numbers, status, form)
    return other if found is None or (other is not None and other.plausible) else found


def _usual(tokens: list[str], values: list[float], status: str, form: tuple[bool, ...]) -> Measurement | None:
    """`values`: of the tokens, and perhaps of more behind them."""
    if len(tokens) not in (7, 9):
        return None
    zero_counts, _, ppm, temperature_c, humidity_mb, _, pressure_mb = values[:7]
    plausible = _are_counts(tokens[:2]) and _is_pressure(pressure_mb) and _is_temperature(temperature_c)
    fault = _fault(status) if status else _own_fault(zero_counts, temperature_c, humidity_mb)
    return Measurement(ppm, temperature_c, pressure_mb, status, fault, form, True, plausible)


def _unusual(tokens: list[str], status: str, form: tuple[bool, ...]) -> Measurement | None:
    """With some of its fields switched off. Only the place of CO2 is certain: behind the counts, or first."""
    counts = len(tokens) > 2 and _are_counts(tokens[:2]) and min(len(token) for token in tokens[:2]) >= 4
    rest = tokens[2:] if counts else tokens
    if not rest:
        return None
    ppm, others = rest[0], rest[1:]
    fits = any(_fits(others, layout) for layout in _layouts(analog=bool(status)))
    # Without counts before it, a whole number there may as well be a count itself.
    plausible = fits and (counts or "." in ppm)
    fault = _fault(status) if status else "no status in its format: F252 switches it on"
    return Measurement(float(ppm), None, None, status, fault, form, False, plausible)


def _layouts(analog: bool) -> list[str]:
    """What may stand behind CO2: temperature, humidity with a temperature, pressure, two temperatures, millivolts."""
    groups = ("t", "ht", "p", "tt", "a") if analog else ("t", "ht", "p", "tt")
    return [
        "".join(itertools.compress(groups, on)) for on in itertools.product((False, True), repeat=len(groups))
    ]


def _fits(tokens: list[str], layout: str) -> bool:
    if len(tokens) != len(layout):
        return False
    for token, kind in zip(tokens, layout, strict=True):
        value = float(token)
        good = {
            "t": _is_temperature(value),
            "h": 0.0 <= value <= 2.0 * _HUMIDITY_AT_MOST_MB,
            "p": _is_pressure(value),
            "a": token.isdecimal() and value <= 5000.0,
        }[kind]
        if not good:
            return False
    return True


def _are_counts(tokens: list[str]) -> bool:
    return all(token.isdecimal() for token in tokens)


def _is_pressure(value_mb: float) -> bool:
    return 300.0 <= value_mb <= 1200.0


def _is_temperature(value_c: float) -> bool:
    return -40.0 <= value_c <= 120.0


def _fault(status: str) -> str:
    if status.isdecimal():
        return "" if int(status) == 0 else STATUS.get(int(status), f"unknown status {status}")
    return "" if status.casefold() in _GOOD_TEXTS else f"it says: {status[:60]}"


def _own_fault(zero_counts: float, temperature_c: float, humidity_mb: float) -> str:
    """What the status would say, by the manual's own limits, in a line that continuous display makes without one."""
    if zero_counts < _ZERO_COUNTS_AT_LEAST:
        return STATUS[1]
    if abs(temperature_c - _THERMOSTAT_C) > 5.0:
        return STATUS[2] if temperature_c < _THERMOSTAT_C else STATUS[3]
    return STATUS[5] if humidity_mb > _HUMIDITY_AT_MOST_MB else ""
