"""The number of a program's start, which rises from start to start, whatever the clock says.

By it others tell what a node says now from what was recorded before (`flightstack.swarm.freshness`). It is the time
in seconds, and where a computer has no clock at least one more than the last, which is kept in `NAME.start`.
"""

from __future__ import annotations

import fcntl
import logging
import os
import pathlib
import time
from collections.abc import Callable
from typing import Final

log = logging.getLogger(__name__)

_EPOCH_UNIX_S: Final = 1_577_836_800
"""2020-01-01."""
NUMBER_AT_MOST: Final = (1 << 31) - 1
_CLOCK_AT_MOST: Final = 1 << 30
"""2054-01-10: a clock that says more is wrong, and must not use up the numbers."""


def next_start(directory: pathlib.Path, name: str, *, unix_s: Callable[[], float] = time.time) -> int:
    """A number from 1 to `NUMBER_AT_MOST`, larger than all before of this `name` in `directory` (made if absent).

    Where it cannot be kept the clock alone says it, and it is logged: a full disk keeps no agent from its drone.
    """
    by_clock = min(max(int(unix_s()) - _EPOCH_UNIX_S, 1), _CLOCK_AT_MOST)
    file = directory / f"{name}.start"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return by_clock  # who records there says so, and as a rule does not start
    try:
        with file.open("a+", encoding="ascii", errors="replace") as kept:
            fcntl.flock(kept, fcntl.LOCK_EX)
            kept.seek(0)
            text = kept.read()
            last = _number(text)
            number = min(max(by_clock, last + 1), NUMBER_AT_MOST)
            # Behind the last, on a line of its own whatever a power cut left there.
            torn = bool(text) and not text.endswith("\n")
            kept.write("\n" * torn + f"{number}\n")
            kept.flush()
            os.fsync(kept.fileno())
    except OSError as error:
        log.warning(
            "%s cannot be written (%s): if this computer's clock goes back, the others will not hear it after its "
            "next start",
            file,
            error.strerror,
        )
        return by_clock
    return number


def _number(text: str) -> int:
    """The largest in the lines of a file; damaged ones are none."""
    lines = (int(line) for line in text.split() if line.isdecimal() and len(line) <= 10)
    return max((number for number in lines if number <= NUMBER_AT_MOST), default=0)
