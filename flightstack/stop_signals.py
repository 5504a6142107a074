"""Signals that end a program, remembered until its tick is done."""

from __future__ import annotations

import signal
from types import FrameType


class StopSignals:
    """SIGINT and SIGTERM, counted, and whether the terminal hung up. What follows is the program's to say."""

    def __init__(self) -> None:
        self.count = 0
        self.hung_up = False

    @property
    def asked(self) -> bool:
        return self.count > 0 or self.hung_up

    def install(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup wants it
            signal.signal(signal.SIGHUP, self._on_hang_up)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1

    def _on_hang_up(self, _number: int, _frame: FrameType | None) -> None:
        self.hung_up = True
