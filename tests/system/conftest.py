"""What several system tests share: the surveys that the documents fly, and a terminal."""

from __future__ import annotations

import contextlib
import os
import pathlib
import pty
import re
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Iterator
from fcntl import ioctl

import pytest

FLOWN = (
    "simvehicle fly examples/survey.yaml --json",
    "simvehicle fly examples/survey_px4.yaml",
    "simvehicle fly examples/survey_hybrid.yaml",
    "simvehicle fly examples/survey.yaml --kill 3@60",
    "simvehicle fly examples/survey.yaml --fault co2-unplug:2@90",
    "simvehicle fly examples/survey.yaml --drones 9 "
    "--kill 1@60 --kill 4@61 --freeze 6@90 --unfreeze 6@130 --kill 2@150",
)
"""The documents' surveys as they stand there: test_fly_survey.py flies each, test_documents.py finds each here."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test with the argument `flown_command` runs for every one of them."""
    if "flown_command" in metafunc.fixturenames:
        metafunc.parametrize("flown_command", FLOWN)


@pytest.fixture(scope="session")
def flown_commands() -> tuple[str, ...]:
    return FLOWN


class Terminal:
    """A program on a terminal of 80 by 24, and what it shows."""

    def __init__(self, *command: str, cwd: pathlib.Path | None = None) -> None:
        self._master, slave = pty.openpty()
        ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        kept = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES", "NO_COLOR", "CI")}
        self.process = subprocess.Popen(
            command,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=cwd,
            env=kept | {"TERM": "xterm-256color"},
            start_new_session=True,
        )
        os.close(slave)
        self.output = b""
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # the other end is closed when the program has ended
            while data := os.read(self._master, 65536):
                self.output += data

    def frames(self) -> list[list[str]]:
        """All whole pictures so far, as lines without colours: each begins by homing the cursor."""
        text = self.output.decode(errors="replace")
        pictures = text.split("\x1b[H")[1:-1]
        return [
            [line.rstrip() for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", picture).splitlines()]
            for picture in pictures
        ]

    def wait_for(self, words: str, seconds: float = 30.0) -> list[str]:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for frame in self.frames():
                if any(words in line for line in frame):
                    return frame
            time.sleep(0.1)
        raise AssertionError(f"{words!r} never appeared in {self.frames()[-1:]}")

    def finish(self, seconds: float = 20.0) -> int:
        """Wait for the program's end; its exit code. All that it showed is in `output` then."""
        code = self.process.wait(seconds)
        self._reader.join(seconds)
        return code

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.finish()
        os.close(self._master)


@pytest.fixture
def open_terminal() -> Iterator[Callable[..., Terminal]]:
    """Starts a program on a terminal; ends it with the test."""
    with contextlib.ExitStack() as opened:

        def start(*command: str, cwd: pathlib.Path | None = None) -> Terminal:
            terminal = Terminal(*command, cwd=cwd)
            opened.callback(terminal.close)
            return terminal

        yield start
