"""Drawn scenarios of the swarm's protocol violate nothing."""

from __future__ import annotations

import json
import pathlib

import pytest
from typer.testing import CliRunner

from simvehicle.cli.main import app

COMMAND = ["scenario", "search", "--level", "protocol", "--json"]


@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param(200, id="some"),
        pytest.param(10_000, id="10,000", marks=pytest.mark.long),
    ],
)
def test_whatever_goes_wrong_the_swarm_agrees_and_goes_on(seeds: int, tmp_path: pathlib.Path) -> None:
    jobs = ["--jobs", "1"] if seeds < 1000 else []
    result = CliRunner().invoke(app, [*COMMAND, *jobs, "--seeds", f"0:{seeds}", "--out", str(tmp_path)])
    summary = json.loads(result.stdout.splitlines()[-1])
    assert summary["seeds"] == seeds
    assert summary["violations"] == {}, summary["failing_seeds"]
    assert result.exit_code == 0


def test_a_scenario_of_the_protocol_is_replayed_from_its_file(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "root.yaml"
    file.write_text(
        "name: root\nlaunch_line: {count: 6}\nswarm_faults:\n- {kind: kill, drone: 1, at_s: 3}\n",
        encoding="utf-8",
    )
    result = CliRunner().invoke(app, ["scenario", "run", str(file), "--level", "protocol"])
    assert result.exit_code == 0
    assert "   3 s  1           fault kill" in result.stdout.splitlines()
