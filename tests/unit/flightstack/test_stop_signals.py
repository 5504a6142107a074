"""Which signals are remembered, and as what."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from flightstack.stop_signals import StopSignals

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture
def handlers() -> Iterator[None]:
    """The process's own come back after the test."""
    before = {number: signal.getsignal(number) for number in NUMBERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
def test_interrupts_are_counted_and_a_hang_up_is_something_else() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    stop = StopSignals()
    stop.install()
    assert not stop.asked
    os.kill(os.getpid(), signal.SIGHUP)
    assert (stop.count, stop.hung_up, stop.asked) == (0, True, True)
    os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGTERM)
    assert (stop.count, stop.asked) == (2, True)


@pytest.mark.usefixtures("handlers")
def test_under_nohup_a_hang_up_stays_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    stop = StopSignals()
    stop.install()
    os.kill(os.getpid(), signal.SIGHUP)
    assert not stop.asked
