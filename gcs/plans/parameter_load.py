"""What loading a parameter file into a vehicle would change, and what of the file cannot or should not be loaded."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_values import ParameterValue, is_same, number_text, value_problem
from mission.documents.parameter_file import FileParameter

READ_ONLY: Final = {
    Flavour.ARDUPILOT: (
        "*_DEVID",
        "BARO*_GND_PRESS",
        "CMD_INDEX",
        "CMD_TOTAL",
        "COMPASS_DEV_ID*",
        "FENCE_TOTAL",
        "FORMAT_VERSION",
        "GND_ABS_PRESS*",
        "GND_TEMP",
        "INS_ACC*_ID",
        "INS_GYR*_ID",
        "LOG_LASTFILE",
        "MIS_TOTAL",
        "RALLY_TOTAL",
        "STAT_*",
        "SYSID_SW_*",
        "SYS_NUM_RESETS",
    ),
    Flavour.PX4: ("_HASH_CHECK", "COM_FLIGHT_UUID", "LND_FLIGHT_T_*"),
}
"""Patterns of what the autopilots count or find out by themselves ("ReadOnly", "volatile" in their references)."""
IDENTITY: Final = {Flavour.ARDUPILOT: "SYSID_THISMAV", Flavour.PX4: "MAV_SYS_ID"}
"""The vehicle's number: a file saved from another vehicle would make a twin of it."""

_AUTOPILOT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1."""


class Change(msgspec.Struct, frozen=True):
    name: str
    old: float
    new: float

    def __str__(self) -> str:
        return f"{self.name} {number_text(self.old)} -> {number_text(self.new)}"


class LoadPlan(msgspec.Struct, frozen=True):
    """A file beside a vehicle."""

    changes: tuple[Change, ...] = ()
    same: int = 0
    """How many the vehicle holds already."""
    unknown: tuple[str, ...] = ()
    """The vehicle has none of these names."""
    read_only: tuple[str, ...] = ()
    """Left alone: the autopilot's own."""
    identity: tuple[str, ...] = ()
    """Left alone: another vehicle's number, as a sentence."""
    other_components: tuple[str, ...] = ()
    """Left alone: parameters of cameras, gimbals and the like, which stand in the same file."""
    other_vehicles: tuple[int, ...] = ()
    """The file says that it is of these vehicles."""
    impossible: tuple[str, ...] = ()
    """Values that their parameters cannot have, one sentence each, with the file's line."""


def plan_load(
    wanted: Sequence[FileParameter], held: Mapping[str, ParameterValue], flavour: Flavour, drone: int
) -> LoadPlan:
    """Compare the parameters of a file with all that a vehicle holds."""
    changes: list[Change] = []
    unknown: list[str] = []
    read_only: list[str] = []
    identity: list[str] = []
    impossible: list[str] = []
    same = 0
    others = [each for each in wanted if each.component not in (None, _AUTOPILOT)]
    wanted = [each for each in wanted if each.component in (None, _AUTOPILOT)]
    for each in wanted:
        now = held.get(each.name)
        problem = None if now is None else value_problem(flavour, now.kind, each.value)
        if now is None:
            unknown.append(each.name)
        elif problem is None and is_same(now.kind, now.value, each.value):
            same += 1
        elif each.is_read_only or is_read_only(each.name, flavour):
            read_only.append(each.name)
        elif each.name == IDENTITY.get(flavour):
            identity.append(
                f"{each.name} {number_text(each.value)}: this is drone {drone}; "
                f"`gcs param set` changes it, if that is meant"
            )
        elif problem is not None:
            impossible.append(f"line {each.line}: {each.name} {problem}")
        else:
            changes.append(Change(each.name, now.value, each.value))
    return LoadPlan(
        tuple(changes),
        same,
        tuple(unknown),
        tuple(read_only),
        tuple(identity),
        tuple(f"{each.name} (component {each.component})" for each in others),
        tuple(sorted({each.vehicle for each in wanted if each.vehicle not in (None, drone)})),
        tuple(impossible),
    )


def is_read_only(name: str, flavour: Flavour) -> bool:
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in READ_ONLY.get(flavour, ()))
