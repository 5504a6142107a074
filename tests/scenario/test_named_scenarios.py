"""The scenarios of tests/data/scenarios: what happens in each is reviewed as its transcript, and stays so.

`make transcripts` writes the transcripts anew, for review, after a change that is meant to change them.
"""

from __future__ import annotations

import pathlib

import pytest

from simvehicle.scenario.agent_level import fly_scenario
from simvehicle.scenario.scenario_file import load_scenario

DIRECTORY = pathlib.Path(__file__).parents[1] / "data" / "scenarios"


@pytest.mark.parametrize("file", sorted(DIRECTORY.glob("*.yaml")), ids=lambda file: file.stem)
def test_what_happens_is_what_was_reviewed(file: pathlib.Path) -> None:
    result = fly_scenario(load_scenario(file))
    told = "".join(f"{line}\n" for line in result.transcript)
    assert told == file.with_suffix(".txt").read_text(encoding="utf-8")
    assert result.violations == ()


def test_every_transcript_has_its_scenario() -> None:
    assert {file.stem for file in DIRECTORY.glob("*.txt")} == {file.stem for file in DIRECTORY.glob("*.yaml")}
