"""A search finds what is wrong in drawn scenarios, shrinks it to a file that replays it, and goes on where it was."""

from __future__ import annotations

import json
import pathlib
from typing import Any, Final

import pytest
from typer.testing import CliRunner, Result

from simvehicle.cli.main import app
from simvehicle.scenario.drawn_scenario import draw
from simvehicle.scenario.level import LEVELS
from simvehicle.scenario.scenario_file import load_scenario
from simvehicle.scenario.scenario_result import ScenarioResult, Violation


def searched(directory: pathlib.Path, seeds: str, *options: str) -> Result:
    return CliRunner().invoke(
        app,
        ["scenario", "search", "--seeds", seeds, "--jobs", "1", "--out", str(directory), "--json", *options],
    )


class Planted:
    """A level with a defect: whoever has a frozen drone and a killed one comes too near. Nothing flies."""

    flown = 0

    def draw(self, seed: int) -> dict[str, Any]:
        return draw(seed)

    def run(self, document: dict[str, Any]) -> ScenarioResult:
        Planted.flown += 1
        fails = {"freeze", "kill"} <= {fault["kind"] for fault in document["swarm_faults"]}
        near = (Violation("separation", 1.0, "drones 1 and 2: 3.0 m apart"),) if fails else ()
        return ScenarioResult(near, (), {})


def test_a_search_finds_shrinks_and_stores_what_is_wrong_and_goes_on_from_its_results(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LEVELS, "agent", Planted)
    failing = [seed for seed in range(100) if Planted().run(draw(seed)).violations]
    Planted.flown = 0
    first = searched(tmp_path, f"0:{failing[0] + 1}")
    assert first.exit_code == 1
    summary = json.loads(first.stdout.splitlines()[-1])
    assert summary["failing_seeds"] == failing[:1]
    assert summary["violations"] == {"separation": 1}
    file = tmp_path / f"agent-separation-{failing[0]}.yaml"
    assert f"replay it: simvehicle scenario run {file}" in first.stderr
    small = load_scenario(file).config
    assert sorted(fault.kind for fault in small.swarm_faults) == ["freeze", "kill"]
    assert small.faults == ()
    Planted.flown = 0
    further = searched(tmp_path, "0:100", "--no-shrink")
    assert Planted.flown == 100 - failing[0] - 1, "only those that were not flown yet"
    assert json.loads(further.stdout.splitlines()[-1])["failing_seeds"] == failing
    assert load_scenario(file).config.name == f"drawn-{failing[0]}"


def test_a_scenario_is_flown_by_whole_agents_and_its_result_kept(tmp_path: pathlib.Path) -> None:
    first = searched(tmp_path, "8:9", "--no-shrink")
    summary = json.loads(first.stdout.splitlines()[-1])
    assert summary["seeds"] == 1
    assert summary["core_s"] > 0.0
    assert (first.exit_code, summary["failing_seeds"]) == (0, [])
    assert "1 of 1: seed 8" in first.stderr
    again = searched(tmp_path, "8:9", "--no-shrink")
    assert "seed 8," not in again.stderr
    assert json.loads(again.stdout)["core_s"] == summary["core_s"]


SHORT: Final = (12, 14, 16, 18, 19, 26, 39, 60, 69, 76, 80, 81, 82, 84, 85, 86, 98, 100, 111)
"""With seed 8 the twenty of the first 130 that take the least time: 3 to 7 core-s each, where all take 13."""


@pytest.mark.parametrize("seed", SHORT)
def test_whatever_goes_wrong_nobody_comes_too_near_and_everybody_comes_down(seed: int) -> None:
    simulation = LEVELS["agent"]()
    assert simulation.run(simulation.draw(seed)).violations == ()


@pytest.mark.long
def test_whatever_goes_wrong_in_a_thousand_scenarios_nothing_is_violated() -> None:
    """Results are kept in out/scenarios: ended and started again, it goes on from there."""
    command = ["scenario", "search", "--seeds", "0:1000", "--json"]
    summary = json.loads(CliRunner().invoke(app, command).stdout.splitlines()[-1])
    assert summary["seeds"] == 1000
    assert summary["violations"] == {}, summary["failing_seeds"]


def test_what_is_no_range_of_seeds_is_wrong_use(tmp_path: pathlib.Path) -> None:
    for wrong in ("5", "5:5", "6:5", "a:b", "-1:4"):
        result = searched(tmp_path, wrong)
        assert result.exit_code != 0
        assert f"--seeds {wrong}: write FIRST:END" in str(result.exception)
