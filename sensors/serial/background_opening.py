"""Opening and closing what may take seconds, in threads of their own: a tick only starts it and picks up the result.

A device that is being plugged in holds `open` for a second, and one that does not take its last bytes holds `close`
for half a minute; ten ticks a second may not wait for either.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final, Generic, TypeVar

T = TypeVar("T")

ENDING_S: Final = 2.0
"""How long `end` waits for each thread. An attempt that takes longer closes by itself what it opens later."""


class BackgroundOpening(Generic[T]):
    """At most one attempt to open runs at a time, and it begins when what was given back is closed."""

    def __init__(
        self,
        name: str,
        open_it: Callable[[], T],
        close_it: Callable[[T], None],
        errors: tuple[type[Exception], ...],
    ) -> None:
        """`open_it` and `close_it` may block. `errors`: what `open_it` raises where it cannot be opened now; anything
        else is our fault and is raised by `result`. `close_it` raises nothing.
        """
        self._name = name
        self._open_it = open_it
        self._close_it = close_it
        self._errors = errors
        self._lock = threading.Lock()
        self._attempt: threading.Thread | None = None
        self._closing: threading.Thread | None = None
        self._outcome: T | Exception | None = None
        self._ended = False

    def begin(self) -> None:
        """Start an attempt, unless there is one, or the end has come."""
        if self._attempt is None and not self._ended:
            self._attempt = self._start(f"open {self._name}", self._try)

    def result(self) -> T | Exception | None:
        """What the attempt has opened, or why it could not, once; None while it goes on or there is none."""
        with self._lock:
            outcome, self._outcome = self._outcome, None
        if outcome is None:
            return None
        self._attempt = None
        if isinstance(outcome, Exception) and not isinstance(outcome, self._errors):
            raise outcome
        return outcome

    def give_back(self, opened: T) -> None:
        """Close it, without waiting for that."""
        self._closing = self._start(f"close {self._name}", lambda: self._close_it(opened))

    def end(self) -> None:
        """No more attempts; what is open or being opened gets closed. Waits for that, but not for a blocked one."""
        with self._lock:
            self._ended = True
            outcome, self._outcome = self._outcome, None
        if outcome is not None and not isinstance(outcome, Exception):
            self.give_back(outcome)
        for thread in (self._attempt, self._closing):
            if thread is not None:
                thread.join(ENDING_S)
        self._attempt = self._closing = None

    def _start(self, name: str, call: Callable[[], None]) -> threading.Thread:
        thread = threading.Thread(target=call, name=name, daemon=True)
        thread.start()
        return thread

    def _try(self) -> None:
        closing = self._closing
        if closing is not None:
            closing.join()
        try:
            outcome: T | Exception = self._open_it()
        except Exception as error:  # noqa: BLE001 (handed to whoever asks for the result)
            outcome = error
        with self._lock:
            if not self._ended:
                self._outcome = outcome
                return
        if not isinstance(outcome, Exception):
            self._close_it(outcome)
