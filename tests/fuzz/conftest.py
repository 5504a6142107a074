"""How many damaged files and messages of each kind are tried: a slice with the fast tests, all in `make long`."""

from __future__ import annotations

import os

import pytest

SLICE = 300
ALL = int(os.environ.get("FUZZ_CASES", "100000"))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "cases" in metafunc.fixturenames:
        counts = [pytest.param(SLICE, id="slice"), pytest.param(ALL, id="all", marks=pytest.mark.long)]
        metafunc.parametrize("cases", counts)
