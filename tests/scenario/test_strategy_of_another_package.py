"""A strategy in a package of its own: found by name, flown by agents, run in trials; and what goes wrong."""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys
import zipfile
from collections.abc import Iterator

import pytest

from flightstack.swarm.wire import CommandName, Phase
from mission.geometry.formation import Hexagonal
from mission.strategies import registry
from mission.strategies.reactive import ReactiveStrategy
from simvehicle.scenario.swarm import Scenario
from simvehicle.survey.draft import draft, in_process
from simvehicle.survey.survey_file import load
from simvehicle.trials.cell import Cell
from simvehicle.trials.outcome import run_cell

MODULE = '''
"""A rule that circles, wider and wider, and says how often it has smelt something."""

import math

import msgspec

from mission.strategies.reactive import reactive_strategy
from mission.strategies.tick_rule import TickRule


class CircleParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    speed_mps: float = 2.0


def bearing_rad(elapsed_s):
    return 2.0 * math.sqrt(elapsed_s)


def circle(own, neighbours, count, ranges_m, state, word, parameters):
    if own.gas > 0.0:
        word[0] += 1.0
    angle = bearing_rad(own.elapsed_s)
    return parameters[0] * math.cos(angle), parameters[0] * math.sin(angle)


STRATEGY = reactive_strategy(
    "circler", TickRule(rule=circle, parameters=CircleParameters, range_m=15.0, word_size=1)
)
'''
SURVEY = """
name: plugin
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 2, spacing_m: 8.0, towards_deg: 50.0}
formation: {spacing_m: 12.0, radio_range_m: 80.0}
limits: {ceiling_above_home_m: 60.0}
strategy: {name: circler, parameters: {speed_mps: 1.5}}
ready_after_s: 8
seed: 3
"""


def install(target: pathlib.Path, name: str, points: dict[str, str], module: str = MODULE) -> None:
    """Build a wheel of one module and its entry points, and let pip install it into `target`."""
    stem = f"{name.replace('-', '_')}-1.0"
    wheel = target.parent / f"{stem}-py3-none-any.whl"
    lines = "".join(f"{point} = {value}\n" for point, value in points.items())
    contents = {
        f"{name.replace('-', '_')}.py": module,
        f"{stem}.dist-info/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
        f"{stem}.dist-info/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{stem}.dist-info/entry_points.txt": f"[{registry.GROUP}]\n{lines}",
    }
    record = f"{stem}.dist-info/RECORD"
    with zipfile.ZipFile(wheel, "w") as archive:
        for path, text in contents.items():
            archive.writestr(path, text)
        archive.writestr(record, "".join(f"{path},,\n" for path in (*contents, record)))
    command = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--quiet"]
    command += [
        "--disable-pip-version-check",
        "--no-warn-script-location",
        "--target",
        str(target),
        str(wheel),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def target(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[pathlib.Path]:
    """A directory of packages that this process, and those that it starts, see."""
    directory = tmp_path / "packages"
    directory.mkdir()
    monkeypatch.syspath_prepend(str(directory))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(directory), str(pathlib.Path.cwd())]))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    registry.forget_packages()
    before = set(sys.modules)
    yield directory
    registry.forget_packages()
    for module in set(sys.modules) - before:
        if module.startswith(("circling", "broken", "clashing")):
            del sys.modules[module]


def test_it_is_found_by_name_and_flies(target: pathlib.Path, tmp_path: pathlib.Path) -> None:
    install(target, "circling", {"circler": "circling:STRATEGY"})
    assert registry.names()[-1] == "circler"
    assert isinstance(registry.make("circler", layout=Hexagonal(10.0), speed_mps=1.0), ReactiveStrategy)
    with pytest.raises(ValueError, match="strategy circler has no parameter 'speed'; it has speed_mps"):
        registry.make("circler", layout=Hexagonal(10.0), speed=1.0)
    survey = tmp_path / "survey.yaml"
    survey.write_text(SURVEY, encoding="utf-8")
    loaded = load(survey)
    drafted = draft(loaded, in_process(loaded))
    flight = Scenario(drafted.drones, drafted.fleet)
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.phases() == {Phase.SEARCHING}, 120.0), flight.phases()
    before = {drone: member.vehicle.position_ned_m for drone, member in flight.members.items()}
    flight.run(20.0)
    assert flight.phases() == {Phase.SEARCHING}
    for drone, member in flight.members.items():
        moved = [abs(a - b) for a, b in zip(member.vehicle.position_ned_m, before[drone], strict=True)]
        assert max(moved[:2]) > 3.0
    assert flight.min_separation_m > 4.0


def test_it_runs_in_trials(target: pathlib.Path, tmp_path: pathlib.Path) -> None:
    install(target, "circling", {"circler": "circling:STRATEGY"})
    cell = Cell(strategy="circler", drones=3, arena_m=30.0, limit_ticks=30_000, source=(2.0, -4.0))
    rows = run_cell(cell, 4, 0, 3)
    assert rows.success.any()
    done = subprocess.run(
        [
            *(sys.executable, "-m", "simvehicle.cli.main", "trial", "--strategy", "circler", "--drones", "3"),
            *("--arena", "30", "--plume", "smooth", "--plume-at", "2,-4", "--seed", "4", "--plot", "--json"),
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr
    row = json.loads(done.stdout)
    assert row["strategy"] == "circler"
    assert row["source_s"] == rows.source_s[0]
    assert (tmp_path / row["files"][0]).stat().st_size > 5000


def test_a_broken_one_is_named_and_harms_no_other(target: pathlib.Path) -> None:
    install(target, "broken-strategies", {"limping": "broken_strategies:NOTHING"}, "import no_such_thing\n")
    install(target, "circling", {"circler": "circling:STRATEGY", "renamed": "circling:STRATEGY"})
    install(target, "clashing-one", {"locus": "clashing_one:X", "twice": "clashing_one:X"}, "X = 1\n")
    install(target, "clashing-two", {"twice": "clashing_two:X", "odd": "clashing_two:X"}, "X = 1\n")
    assert registry.find("circler").name == "circler"
    assert registry.find("mobs").legs
    for name, said in (
        (
            "limping",
            "of the package broken-strategies cannot be loaded: ModuleNotFoundError: No module named",
        ),
        ("locus", "one of flightstack's own, and the package clashing-one has another of that name"),
        ("twice", "in more than one package, clashing-"),
        ("odd", "clashing_two:X is no StrategyEntry but int"),
        ("renamed", "of the package circling: its entry is called 'circler'; both need the same name"),
        ("nothing", "there are locus, mobs, .*circler, limping, odd, renamed, twice"),
    ):
        with pytest.raises(ValueError, match=said) as told:
            registry.find(name)
        assert "\n" not in str(told.value)
        assert Cell(strategy=name).problems() == [str(told.value)]
