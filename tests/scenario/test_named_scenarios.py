"""The scenarios of tests/data/scenarios: what happens is reviewed as a transcript, where there is one, and stays so.

`make transcripts` writes the transcripts anew, for review, after a change that is meant to change them.
"""

from __future__ import annotations

import pathlib

import pytest

from simvehicle.scenario.agent_level import fly_scenario
from simvehicle.scenario.scenario_file import load_scenario

DIRECTORY = pathlib.Path(__file__).parents[1] / "data" / "scenarios"


REVIEWED = pytest.mark.parametrize("transcript", sorted(DIRECTORY.glob("*.txt")), ids=lambda file: file.stem)


@REVIEWED
def test_nothing_is_violated(transcript: pathlib.Path) -> None:
    assert fly_scenario(load_scenario(transcript.with_suffix(".yaml"))).violations == ()


@pytest.mark.long  # another processor rounds otherwise, and a flight of minutes may take another course there
@REVIEWED
def test_what_happens_is_what_was_reviewed(transcript: pathlib.Path) -> None:
    result = fly_scenario(load_scenario(transcript.with_suffix(".yaml")))
    assert "".join(f"{line}\n" for line in result.transcript) == transcript.read_text(encoding="utf-8")


@pytest.mark.parametrize("file", sorted(DIRECTORY.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_scenario_can_be_flown(file: pathlib.Path) -> None:
    scenario = load_scenario(file)
    assert scenario.config.swarm_faults
    assert scenario.config.name == file.stem.replace("_", "-")
