"""What the contract suites share: ports that are free, and waiting for what another thread brings."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from simvehicle.survey import ports


def _eventually(condition: Callable[[], object], limit_s: float = 20.0) -> None:
    """Ask `condition` again and again until it holds; fail after `limit_s`."""
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, f"did not come true within {limit_s} s"
        time.sleep(0.01)


@pytest.fixture
def free_port() -> Callable[..., int]:
    return ports.free_port


@pytest.fixture
def eventually() -> Callable[..., None]:
    return _eventually
