"""Drawn scenarios are flown by whole agents, and a search goes on from what it has."""

from __future__ import annotations

import json
import pathlib

from typer.testing import CliRunner, Result

from simvehicle.cli.main import app
from simvehicle.scenario.search import fly_seed, sources_identity


def searched(directory: pathlib.Path, seeds: str, *options: str) -> Result:
    return CliRunner().invoke(
        app,
        ["scenario", "search", "--seeds", seeds, "--jobs", "1", "--out", str(directory), "--json", *options],
    )


def test_a_search_says_what_was_violated_and_goes_on_from_its_results(tmp_path: pathlib.Path) -> None:
    flown = fly_seed("agent", sources_identity(), 0)
    first = searched(tmp_path, "0:1", "--no-shrink")
    summary = json.loads(first.stdout.splitlines()[-1])
    assert summary["seeds"] == 1
    assert summary["failing_seeds"] == ([0] if flown.violations else [])
    assert first.exit_code == (1 if flown.violations else 0)
    assert "1 of 1: seed 0" in first.stderr
    again = searched(tmp_path, "0:1", "--no-shrink")
    assert again.stderr == ""
    assert json.loads(again.stdout)["core_s"] == summary["core_s"]


def test_what_is_no_range_of_seeds_is_wrong_use(tmp_path: pathlib.Path) -> None:
    for wrong in ("5", "5:5", "6:5", "a:b", "-1:4"):
        result = searched(tmp_path, wrong)
        assert result.exit_code != 0
        assert f"--seeds {wrong}: write FIRST:END" in str(result.exception)
