"""Damaged YAML files of drones, ground stations and surveys: fit to be run, or one line says why not."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable
from typing import Any

import msgspec
import mutations
import pytest
import yaml
from reader import assert_tried, reading
from trial import run_cases

from flightstack.agent import Agent, Inputs
from flightstack.config_file import load as load_drone
from gcs.plans.checks import load_fence
from gcs.station import Station
from gcs.station_config import load as load_ground
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import load as load_survey

ROOT = pathlib.Path(__file__).parents[2]


def all_finite(value: Any) -> bool:
    """No number in a configuration is none."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(all_finite(v) for v in value.values())
    if isinstance(value, list | tuple):
        return all(all_finite(v) for v in value)
    return True


def take_drone(path: pathlib.Path) -> None:
    config = load_drone(path)
    assert all_finite(msgspec.to_builtins(config, builtin_types=(bytes,)))
    agent = Agent(config, incarnation=1)
    for tick in range(2):
        agent.step(100.0 + 0.1 * tick, Inputs())


def take_ground(path: pathlib.Path) -> None:
    config = load_ground(path)
    assert all_finite(msgspec.to_builtins(config, builtin_types=(bytes,)))
    station = Station(config, load_fence(config, path), 10.0)
    for tick in range(2):
        station.step(10.0 + tick, (), [b""] * len(config.mavlink.links))


def take_survey(path: pathlib.Path) -> None:
    survey = load_survey(path)
    assert all_finite(msgspec.to_builtins(survey, builtin_types=(bytes,)))
    parts = draft(survey, in_process(survey))
    assert len(parts.drones) == len(parts.fleet.vehicles)


def as_yaml(rng: Any, document: Any) -> bytes:
    """As people write it, or as JSON, which YAML takes too."""
    if rng.random() < 0.5:
        return mutations.json_text(rng, document)
    try:
        return yaml.safe_dump(document, sort_keys=False, allow_unicode=True).encode("utf-8", "surrogatepass")
    except (yaml.YAMLError, RecursionError):
        return mutations.json_text(rng, document)


@pytest.mark.parametrize(
    ("kind", "patterns", "take"),
    [
        (
            "drone",
            ("examples/drone.yaml", "tests/data/cases/one_drone*.yaml", "tests/data/cases/y*.yaml"),
            take_drone,
        ),
        ("ground", ("examples/ground.yaml", "tests/data/cases/ground.yaml"), take_ground),
        ("survey", ("examples/survey*.yaml",), take_survey),
    ],
)
def test_a_damaged_configuration(
    kind: str,
    patterns: tuple[str, ...],
    take: Callable[[pathlib.Path], None],
    cases: int,
    tmp_path: pathlib.Path,
) -> None:
    seeds = [path.read_bytes() for pattern in patterns for path in sorted(ROOT.glob(pattern))]
    documents = [yaml.safe_load(seed) for seed in seeds]
    mutator = mutations.Mutator(kind, seeds, documents=documents, text=as_yaml)
    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / f"{kind}.yaml", take)))
