"""One damaged input after the other through a reader: what may come of it, in which time and memory."""

from __future__ import annotations

import collections
import contextlib
import logging
import os
import resource
import signal
import traceback
from collections.abc import Callable, Iterator
from typing import Any

SECONDS_AT_MOST = 5.0
"""Of the processor's time, for one case."""
GROWTH_AT_MOST_KIB = 200_000
"""Of the process, over all cases of a kind."""


class TooSlowError(AssertionError):
    """One case took longer than any reader needs."""


def _too_slow(_signal: int, _frame: Any) -> None:
    raise TooSlowError(f"not done after {SECONDS_AT_MOST} s of the processor's time")


@contextlib.contextmanager
def _logged_nowhere() -> Iterator[None]:
    """Log lines are written as ever, and not kept: pytest keeps all of a test, which is no growth of a reader."""
    root = logging.getLogger()
    kept = root.handlers[:]
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        root.handlers = [logging.StreamHandler(nowhere)]
        try:
            yield
        finally:
            root.handlers = kept


def run_cases(
    count: int, case: Callable[[int], bytes], read: Callable[[bytes], str]
) -> collections.Counter[str]:
    """Give `read` every case. It answers what came of it in a word or two, and raises where that may not be.

    Returns how often each answer was given. AssertionError tells of the cases that failed, one of each kind whole.
    """
    outcomes: collections.Counter[str] = collections.Counter()
    failures: dict[str, tuple[int, bytes, str]] = {}
    failed = 0
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    previous = signal.signal(signal.SIGVTALRM, _too_slow)
    try:
        with _logged_nowhere():
            for index in range(count):
                data = case(index)
                signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS_AT_MOST)
                try:
                    outcomes[read(data)] += 1
                except Exception as error:  # noqa: BLE001 (whatever is raised here is the finding)
                    failed += 1
                    place = traceback.extract_tb(error.__traceback__)[-1]
                    failures.setdefault(
                        f"{type(error).__name__} at {place.filename}:{place.lineno}",
                        (index, data, str(error)[:300]),
                    )
                finally:
                    signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    finally:
        signal.signal(signal.SIGVTALRM, previous)
    told = "".join(
        f"\n{what}\n  case {index}: {problem}\n  {data[:1500]!r}"
        for what, (index, data, problem) in failures.items()
    )
    assert not failures, f"{failed} of {count} cases failed, in {len(failures)} ways:{told}"
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
    assert grown_kib < GROWTH_AT_MOST_KIB, f"the process grew by {grown_kib} KiB"
    return outcomes
