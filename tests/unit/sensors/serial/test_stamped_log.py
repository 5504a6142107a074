"""Captures in which a terminal program put the computer's time before every line."""

from __future__ import annotations

import pytest

from sensors.instruments.registry import INSTRUMENTS, make_instrument
from sensors.instruments.samples import InstrumentState
from sensors.serial.captures import decode, usual_period_s
from sensors.serial.stamped_log import stamped_lines

LINE = "M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00"
OF_DAY_S = 12 * 3600.0 + 34 * 60.0 + 56.789
UNIX_S = 1_767_357_296.789  # 2026-01-02 12:34:56.789 UTC


@pytest.mark.parametrize(
    ("stamp", "time_s"),
    [
        ("[12:34:56.789] ", OF_DAY_S),
        ("12:34:56.789 -> ", OF_DAY_S),
        ("12:34:56.789> RX: ", OF_DAY_S),
        ("12:34:56,789;", OF_DAY_S),
        ("12:34:56.789 PM\t", OF_DAY_S),
        ("02.01.2026 12:34:56.789 ", OF_DAY_S),
        ("[Fri Jan 02 12:34:56.789 2026] ", OF_DAY_S),
        ("Jan  2 12:34:56.789 ", OF_DAY_S),
        ("2026-01-02 12:34:56,789 ", UNIX_S),
        ("2026-01-02,12:34:56.789,", UNIX_S),
        ("2026/01/02 12:34:56.789: ", UNIX_S),
        ("[2026-01-02T12:34:56.789Z] ", UNIX_S),
        ("2026-01-02T14:34:56.789+02:00 ", UNIX_S),
        ("1767357296.789 ", UNIX_S),
        ("1767357296789, ", UNIX_S),
        ("[   45296.789] ", OF_DAY_S),
        ("[45296.789 0.000123] ", OF_DAY_S),
    ],
)
def test_every_form_of_stamp(stamp: str, time_s: float) -> None:
    data = f"{stamp}{LINE}\r\n{stamp}{LINE}\r\n".encode()
    assert stamped_lines(data) == [(pytest.approx(time_s, abs=1e-6), f"{LINE}\r\n".encode())] * 2


def decoded(kind: str, text: str) -> list[tuple[float, InstrumentState]]:
    found = decode(make_instrument(kind), text.encode("latin-1"), usual_period_s(INSTRUMENTS[kind]))
    return [(sample.time_s, sample.state) for sample in found]


def test_times_are_the_stamps_over_midnight_and_where_a_line_has_none() -> None:
    text = f"[23:59:59.5] {LINE}\n{LINE}\n[00:00:00.5] {LINE}\n[00:00:01.5] {LINE}\n"
    measuring = InstrumentState.MEASURING
    assert decoded("sba5", text) == [(86_399.5, measuring)] * 2 + [
        (86_400.5, measuring),
        (86_401.5, measuring),
    ]


def test_a_record_over_several_stamped_lines() -> None:
    record = ("<li850><data>", "<celltemp>51.2</celltemp>", "<co2>421.3</co2>", "</data></li850>")
    text = "".join(f"[12:00:0{second}.000] {part}\r\n" for second, part in enumerate(record))
    assert decoded("li850", text) == [(43_203.0, InstrumentState.MEASURING)]


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("cozir", " Z 00450 z 00448"),
        ("windsonic", "\x02Q,229,002.74,M,00,\x0316"),
        ("ft205", "$WI,WVP=020.0,045,0*73"),
        ("trisonica", "S 05.02 S2 05.00 D 217 U 03.01 V 03.99 W 00.50"),
    ],
)
def test_stamped_lines_of_every_instrument_that_sends_lines(kind: str, line: str) -> None:
    text = f"2026-01-02 12:34:56.789 {line}\r\n" * 3
    assert decoded(kind, text) == [(pytest.approx(UNIX_S, abs=1e-6), InstrumentState.MEASURING)] * 3


def test_a_stamp_that_is_none_is_a_damaged_line_and_no_line_is_dropped() -> None:
    text = f"[12:34:56.789] {LINE}\n[12:64:56.789] {LINE}\n[12:34:57.789] {LINE}\n[12:34:58] {LINE[:20]}\n"
    states = [state for _, state in decoded("sba5", text)]
    measuring, error = InstrumentState.MEASURING, InstrumentState.ERROR
    assert states == [measuring, error, measuring, error]


def test_a_plain_capture_has_no_stamps() -> None:
    assert stamped_lines(f"{LINE}\r\n{LINE}\r\n".encode()) is None
    assert stamped_lines(b"") is None
    assert decoded("sba5", f"{LINE}\r\n{LINE}\r\n")[1][0] == pytest.approx(0.1)


def test_marks_of_editors_and_shells_are_no_message() -> None:
    text = f"[12:34:56.789] {LINE}\r\n[12:34:57.789] {LINE}\r\n"
    for data in (b"\xef\xbb\xbf" + text.encode(), text.encode("utf-16")):
        found = list(decode(make_instrument("sba5"), data, 0.1))
        assert [s.state for s in found] == [InstrumentState.MEASURING] * 2
