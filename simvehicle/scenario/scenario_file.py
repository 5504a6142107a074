"""A scenario as its file says it: a survey, its radio, and what goes wrong with it when.

Everything that a survey's file has (docs/simulate.md) stands here too and is checked as there; what `ScenarioConfig`
adds comes on top.
"""

from __future__ import annotations

import pathlib
from collections.abc import Iterator
from typing import Final

import msgspec

from flightstack.config import Positive
from mission.documents.yaml_file import DocumentError, line_of, parse, read_text
from simvehicle.faults.fault_table import SWARM_FAULTS, SwarmFaultSpec
from simvehicle.survey.survey_file import Survey, SurveyConfig, check

ENDS_WITHIN_S: Final = 600.0
"""From the last fault to everybody on the ground. A search of some hundred metres takes 200 s, declaring the source
60 s, the way home with everybody waiting for everybody 120 s; the rest is for heals."""


class ScenarioConfig(SurveyConfig, frozen=True, kw_only=True):
    swarm_faults: tuple[SwarmFaultSpec, ...] = ()
    """What goes wrong with agents, radio and people; `faults` is for vehicles and instruments."""
    ground_brings_home: bool = True
    """Whether there is a ground station that brings vehicles home whose agents are silent."""
    ends_within_s: Positive = ENDS_WITHIN_S
    """After the last fault everybody must be on the ground within this time."""

    @property
    def last_fault_s(self) -> float:
        """When the last fault begins or mends, seconds after the first take-off."""
        times_s = [fault.until_s or fault.at_s for fault in self.faults]
        times_s += [fault.until_s or fault.at_s for fault in self.swarm_faults]
        return max(times_s, default=0.0)


class FlownScenario(msgspec.Struct, frozen=True):
    """A scenario that passed its checks."""

    config: ScenarioConfig
    survey: Survey


def load_scenario(path: str | pathlib.Path) -> FlownScenario:
    """Read and check a scenario's file; `DocumentError` says in one line what is wrong, where, how to mend it."""
    return parse_scenario(read_text(path), str(path))


def parse_scenario(text: str, file: str) -> FlownScenario:
    """As `load_scenario`, from the text; `file` stands in the errors."""
    config = parse(text, ScenarioConfig, file)
    survey = check(config, text, file)
    drones = [drone.id for drone in survey.drones]
    for index, fault in enumerate(config.swarm_faults):
        for field, problem in swarm_fault_problems(fault, drones):
            place = f"swarm_faults[{index}].{field}"
            raise DocumentError(file, problem, line=line_of(text, place), field=place)
    return FlownScenario(config, survey)


def swarm_fault_problems(fault: SwarmFaultSpec, drones: list[int]) -> Iterator[tuple[str, str]]:
    """(field, what is wrong with it)."""
    row = SWARM_FAULTS[fault.kind]
    for field in row.needs:
        if not getattr(fault, field):
            yield field, f'"{fault.kind}" needs {field}; give it'
    given = {
        field
        for field in ("drone", "towards", "parts", "loss", "by_s", "command", "until_s")
        if getattr(fault, field) not in (0, (), None)
    }
    allowed = {
        *row.needs,
        *(("until_s",) if row.end else ()),
        *(("drone",) if fault.kind == "command" else ()),
    }
    for field in sorted(given - allowed):
        yield field, f'"{fault.kind}" has no {field}; remove it'
    for field in ("drone", "towards"):
        drone = getattr(fault, field)
        if drone and drone not in drones:
            yield field, f"there is no drone {drone}, but {drones}"
    if fault.kind == "one_way" and fault.drone == fault.towards:
        yield "towards", "a drone hears itself; name another one"
    if fault.until_s is not None and fault.until_s <= fault.at_s:
        yield "until_s", f"it begins at {fault.at_s:g} s, so it cannot be over at {fault.until_s:g} s"
    named = [drone for part in fault.parts for drone in part]
    for drone in named:
        if drone not in drones:
            yield "parts", f"there is no drone {drone}, but {drones}"
        if named.count(drone) > 1:
            yield "parts", f"drone {drone} stands in it twice; a drone is in one part"
    if fault.kind == "partition" and (len(fault.parts) < 2 or not all(fault.parts)):
        yield "parts", "a partition has two parts or more, each with a drone: [[1, 2], [3, 4, 5]]"
