"""The child processes of a simulated survey: started together, watched, ended together."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pathlib
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence

_END_WITH_PARENT = pathlib.Path(__file__).with_name("end_with_parent.py")
_POLL_S = 0.05


@dataclasses.dataclass(frozen=True)
class Ended:
    """A process that is no more although nobody ended it."""

    name: str
    code: int
    """Exit code, or minus the signal's number."""
    last_line: str
    """The last line of its log."""

    def __str__(self) -> str:
        how = f"signal {-self.code}" if self.code < 0 else f"exit code {self.code}"
        # Who is killed has no last words: its last line is about something else.
        words = "" if -self.code in (signal.SIGKILL, signal.SIGTERM) else self.last_line
        return f"{self.name} ended ({how}){': ' + words if words else ''}"


class Processes:
    """Children, each in its own process group with its output in a log file; none is ever started again.

    They outlive neither `stop` (a context manager's exit calls it) nor, on Linux, this process.
    """

    def __init__(self, log_dir: pathlib.Path) -> None:
        self._log_dir = log_dir
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # Whatever is not an ordinary exception (a second Ctrl-C) is in a hurry.
        self.stop(grace_s=5.0 if kind is None or issubclass(kind, Exception) else 0.0)

    def start(self, name: str, command: Sequence[str]) -> None:
        """Start `command`; `name` names its log file.

        Call it from the main thread: on Linux a child dies with the thread that started it.
        """
        with self.log_path(name).open("ab") as log:
            self._running[name] = subprocess.Popen(
                [sys.executable, "-I", "-S", str(_END_WITH_PARENT), str(os.getpid()), *command],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0,
            )

    def log_path(self, name: str) -> pathlib.Path:
        return self._log_dir / f"{name}.log"

    @property
    def running(self) -> tuple[str, ...]:
        return tuple(self._running)

    def pid(self, name: str) -> int:
        return self._running[name].pid

    def ended(self) -> list[Ended]:
        """Those that ended by themselves since the last call."""
        gone = [
            Ended(name, process.returncode, self._last_line(name))
            for name, process in self._running.items()
            if process.poll() is not None
        ]
        for one in gone:
            del self._running[one.name]
        return gone

    def kill(self, name: str) -> bool:
        """SIGKILL to one process and its group, as a crash would have it; False if it is gone already."""
        process = self._running.pop(name, None)
        if process is None:
            return False
        self._signal(process, signal.SIGKILL)
        process.wait()
        return True

    def freeze(self, name: str) -> bool:
        """SIGSTOP to one process and its group, which stands still on return; False if it is gone already."""
        process = self._running.get(name)
        if process is None or process.poll() is not None:
            return False
        self._signal(process, signal.SIGSTOP)
        _, status = os.waitpid(process.pid, os.WUNTRACED)
        if os.WIFSTOPPED(status):
            return True
        process.returncode = os.waitstatus_to_exitcode(status)  # it ended first: `ended` shall tell how
        return False

    def wake(self, name: str) -> None:
        """SIGCONT to one that was frozen, and its group."""
        process = self._running.get(name)
        if process is not None:
            self._signal(process, signal.SIGCONT)

    def stop(self, grace_s: float = 5.0) -> list[str]:
        """End all: SIGTERM, and SIGKILL after `grace_s` wall seconds; returns who needed the latter.

        Half-way there is a second SIGTERM: the first tells an agent in flight to go home, this one to end.
        """
        stubborn: list[str] = []
        try:
            for _ in range(2):
                for process in self._running.values():
                    self._signal(process, signal.SIGTERM)
                    self._signal(process, signal.SIGCONT)  # who is frozen hears nothing else
                deadline_s = time.monotonic() + grace_s / 2.0
                while time.monotonic() < deadline_s and any(p.poll() is None for p in self._running.values()):
                    time.sleep(_POLL_S)
        finally:
            for name, process in self._running.items():
                if process.poll() is None:
                    stubborn.append(name)
                    self._signal(process, signal.SIGKILL)
            for process in self._running.values():
                process.wait()
            self._running.clear()
        return stubborn

    @staticmethod
    def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
        if process.returncode is None:  # not waited for yet: the number is still its own
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, number)

    def _last_line(self, name: str) -> str:
        return last_line(self.log_path(name))


def last_line(log: pathlib.Path) -> str:
    """The last line with text in it of a log file, "" if there is none."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - 4096))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


class Interrupts:
    """Ctrl-C and SIGTERM: the first sets a flag that asks for an orderly end, the second interrupts."""

    def __init__(self) -> None:
        self.asked = False

    def _note(self, number: int, frame: object) -> None:  # noqa: ARG002
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    @contextlib.contextmanager
    def watched(self) -> Iterator[Interrupts]:
        """Within the block the signals are ours; must be entered in the main thread."""
        before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
