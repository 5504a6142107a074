"""What the contract suites share: ports that are free, and waiting for what another thread brings."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest


def _free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _eventually(condition: Callable[[], object], limit_s: float = 20.0) -> None:
    """Ask `condition` again and again until it holds; fail after `limit_s`."""
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, f"did not come true within {limit_s} s"
        time.sleep(0.01)


@pytest.fixture
def free_port() -> Callable[..., int]:
    """A port that the operating system has just called free."""
    return _free_port


@pytest.fixture
def eventually() -> Callable[..., None]:
    return _eventually
