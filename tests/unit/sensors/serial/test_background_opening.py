"""What opens and closes in the background: nobody waits, nothing is opened twice, nothing stays open."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from sensors.serial.background_opening import BackgroundOpening

PATIENCE_S = 10.0


class Device:
    """Opens and closes when the test lets it."""

    def __init__(self) -> None:
        self.may_open = threading.Event()
        self.may_close = threading.Event()
        self.may_close.set()
        self.failure: Exception | None = None
        self.attempts = 0
        self.opened: list[int] = []
        self.closed: list[int] = []
        self.changed = threading.Condition()

    def open_it(self) -> int:
        self.attempts += 1
        assert self.may_open.wait(PATIENCE_S)
        if self.failure is not None:
            raise self.failure
        self.opened.append(self.attempts)
        return self.attempts

    def close_it(self, opened: int) -> None:
        assert self.may_close.wait(PATIENCE_S)
        with self.changed:
            self.closed.append(opened)
            self.changed.notify_all()

    def wait_closed(self, opened: int) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: opened in self.closed, PATIENCE_S)


@pytest.fixture
def device() -> Device:
    return Device()


@pytest.fixture
def opening(device: Device) -> Iterator[BackgroundOpening[int]]:
    made: BackgroundOpening[int] = BackgroundOpening("device", device.open_it, device.close_it, (OSError,))
    yield made
    device.may_open.set()
    device.may_close.set()
    made.end()
    assert not [thread for thread in threading.enumerate() if thread.name.endswith(" device")]
    assert sorted(device.closed) == sorted(device.opened), "everything that was opened is closed, once"


def outcome(opening: BackgroundOpening[int]) -> int | Exception:
    end_s = time.monotonic() + PATIENCE_S
    while (result := opening.result()) is None:
        assert time.monotonic() < end_s
    return result


def test_an_attempt_that_blocks_holds_nobody_and_is_the_only_one(
    device: Device, opening: BackgroundOpening[int]
) -> None:
    for _ in range(50):
        opening.begin()
        assert opening.result() is None
    device.may_open.set()
    assert outcome(opening) == 1
    assert device.attempts == 1
    assert opening.result() is None, "told once"
    opening.give_back(1)


def test_a_failure_is_told_once_and_another_attempt_may_follow(
    device: Device, opening: BackgroundOpening[int]
) -> None:
    device.may_open.set()
    device.failure = OSError("unplugged")
    opening.begin()
    assert outcome(opening) is device.failure
    assert opening.result() is None
    device.failure = None
    opening.begin()
    assert outcome(opening) == 2
    opening.give_back(2)


def test_a_fault_of_ours_is_raised_where_the_result_is_asked_for(
    device: Device, opening: BackgroundOpening[int]
) -> None:
    device.may_open.set()
    device.failure = KeyError("a bug")
    opening.begin()
    with pytest.raises(KeyError, match="a bug"):
        outcome(opening)


def test_closing_holds_nobody_and_the_next_attempt_waits_for_it(
    device: Device, opening: BackgroundOpening[int]
) -> None:
    device.may_open.set()
    opening.begin()
    assert outcome(opening) == 1
    device.may_close.clear()
    opening.give_back(1)
    opening.begin()
    assert opening.result() is None
    assert device.attempts == 1, "the port is not open twice"
    device.may_close.set()
    assert outcome(opening) == 2
    opening.give_back(2)


def test_what_is_opened_and_not_taken_is_closed_at_the_end(
    device: Device, opening: BackgroundOpening[int]
) -> None:
    opening.begin()
    device.may_open.set()
    opening.end()
    device.wait_closed(1)
    opening.begin()
    assert opening.result() is None, "no attempt after the end"


def test_an_attempt_that_outlasts_the_end_closes_what_it_opens(
    device: Device, opening: BackgroundOpening[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sensors.serial.background_opening.ENDING_S", 0.0)
    opening.begin()
    opening.end()
    assert device.opened == []
    device.may_open.set()
    device.wait_closed(1)
    monkeypatch.undo()
    for thread in threading.enumerate():
        if thread.name == "open device":
            thread.join(PATIENCE_S)
