"""Numbers of starts that rise whatever the clock and the disk do."""

from __future__ import annotations

import pathlib

from flightstack.recording.start_number import NUMBER_AT_MOST, next_start

UNIX_S = 1_790_000_000.0


def numbers(directory: pathlib.Path, *clock_s: float) -> list[int]:
    return [next_start(directory, "drone-3", unix_s=lambda at_s=at_s: at_s) for at_s in clock_s]


def test_it_is_the_time_and_rises_with_it(tmp_path):
    first, second = numbers(tmp_path / "flights", UNIX_S, UNIX_S + 100.0)
    assert second - first == 100


def test_it_rises_where_the_clock_stands_or_goes_back(tmp_path):
    found = numbers(tmp_path, UNIX_S, UNIX_S, 0.0, 5.0, UNIX_S - 1e6)
    assert found == [found[0] + index for index in range(5)]


def test_names_count_by_themselves(tmp_path):
    (first,) = numbers(tmp_path, UNIX_S)
    assert next_start(tmp_path, "ground", unix_s=lambda: UNIX_S) == first


def test_a_clock_that_is_far_ahead_uses_up_nothing(tmp_path):
    found = numbers(tmp_path, 1e12, UNIX_S, UNIX_S)
    assert found == [found[0], found[0] + 1, found[0] + 2]
    assert found[-1] < NUMBER_AT_MOST // 2 + 10


def test_damaged_lines_are_none(tmp_path):
    (first,) = numbers(tmp_path, UNIX_S)
    file = tmp_path / "drone-3.start"
    file.write_bytes(file.read_bytes() + b"\xff\x00 99999999999999\n9")
    assert numbers(tmp_path, 0.0, 0.0) == [first + 1, first + 2]


def test_a_disk_that_takes_nothing_keeps_no_agent_from_its_drone(tmp_path, caplog):
    (tmp_path / "drone-3.start").mkdir()
    by_clock = numbers(tmp_path, UNIX_S, UNIX_S)
    assert by_clock[0] == by_clock[1] > 0
    assert "drone-3.start cannot be written (Is a directory)" in caplog.records[0].getMessage()
