"""Numbers of a drone's file that no drone has, or that contradict each other."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.config import AutopilotConfig, DroneConfig, FormationConfig, LimitsConfig
from flightstack.flight.layers import RETURN_ALTITUDES
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_values import value_problem

_MOST: Final = {
    "speed_mps": 50.0,
    "climb_mps": 20.0,
    "descent_mps": 20.0,
    "acceleration_mps2": 20.0,
    "separation_m": 1000.0,
    "floor_above_home_m": 5000.0,
    "ceiling_above_home_m": 5000.0,
    "fence_margin_m": 1000.0,
    "obstacle_margin_m": 1000.0,
    "peer_suspected_s": 600.0,
    "peer_lost_s": 600.0,
    "position_stale_s": 60.0,
}
"""More is a slip of the pen with any multicopter."""
_LEAST: Final = {
    "speed_mps": 0.1,
    "climb_mps": 0.1,
    "descent_mps": 0.1,
    "acceleration_mps2": 0.1,
    "obstacle_margin_m": 1.0,
    "peer_suspected_s": 0.5,
    "peer_lost_s": 0.5,
    "position_stale_s": 0.2,
    "ground_lost_s": 1.0,
}
"""Less cannot be kept: peers tell their state five times a second, the ground station once; a GPS errs by metres."""
_LONGEST_STOP_S: Final = 30.0
_SHORTEST_STAGE_S: Final = 20.0
_FULLEST_RETURN: Final = 0.9
_NAME: Final = re.compile(r"[A-Za-z0-9_]{1,16}")
_INT32: Final = range(-(1 << 31), 1 << 31)
_NUMBERS: Final = ("SYSID_THISMAV", "MAV_SYSID", "MAV_SYS_ID")
"""The vehicle's own number: ArduPilot's until and since 4.7, PX4's."""
_LONGEST_NAME: Final = 40
_INSTRUMENT_NAME: Final = re.compile(r"[A-Za-z0-9_.-]+")


def limit_problems(limits: LimitsConfig) -> Iterator[tuple[str, str]]:
    """(field, what is wrong and how to mend it)."""
    for name, least in _LEAST.items():
        value = getattr(limits, name)
        if value is not None and value < least:
            yield f"limits.{name}", f"{value:g} is less than any drone keeps; {least:g} is the least"
    for name, most in _MOST.items():
        value = getattr(limits, name)
        if value > most:
            yield f"limits.{name}", f"{value:g} is more than any drone does; {most:g} is the most"
    for name in limits.stages.__struct_fields__:
        value = getattr(limits.stages, name)
        if value is not None and value < _SHORTEST_STAGE_S:
            yield (
                f"limits.stages.{name}",
                f"no stage ends within {value:g} s; {_SHORTEST_STAGE_S:g} is the least",
            )
    stop_s = limits.speed_mps / limits.acceleration_mps2
    if stop_s > _LONGEST_STOP_S:
        yield (
            "limits.acceleration_mps2",
            f"with {limits.acceleration_mps2:g} m/s^2 it takes {stop_s:.0f} s to stop from limits.speed_mps = "
            f"{limits.speed_mps:g} m/s; raise it or fly slower",
        )
    if limits.battery_return_fraction > _FULLEST_RETURN:
        yield (
            "limits.battery_return_fraction",
            f"at {limits.battery_return_fraction:g} of a full battery a drone goes home as soon as it has started",
        )


def formation_problems(formation: FormationConfig) -> Iterator[tuple[str, str]]:
    """(field, what is wrong and how to mend it)."""
    for name, most in (("spacing_m", 5000.0), ("radio_range_m", 100_000.0), ("layer_gap_m", 1000.0)):
        value = getattr(formation, name)
        if value is not None and value > most:
            yield f"formation.{name}", f"{value:g} m is more than any formation has; {most:g} is the most"


def name_problems(config: DroneConfig) -> Iterator[tuple[str, str]]:
    """Names that do not fit where they are sent and written."""
    names = [("swarm.name", config.swarm.name)]
    names += [(f"instruments[{index}].name", one.name) for index, one in enumerate(config.instruments)]
    for field, name in names:
        if len(name) > _LONGEST_NAME:
            yield field, f"a name has at most {_LONGEST_NAME} characters, and this has {len(name)}"
        elif not _INSTRUMENT_NAME.fullmatch(name):
            yield field, f"{name!r}: a name is made of letters, digits, _, - and ."


def parameter_problems(
    autopilot: AutopilotConfig, limits: LimitsConfig, drone: int
) -> Iterator[tuple[str, str]]:
    """Parameters that no autopilot has, values that do not arrive as they are written, ways home over the ceiling."""
    for name, value in autopilot.parameters.items():
        field = f"autopilot.parameters.{name}"
        if not _NAME.fullmatch(name):
            yield (
                field,
                f"a parameter's name has 1 to 16 letters, digits and underscores; {name!r} has {len(name)}",
            )
            continue
        if name != name.upper():
            yield field, f"autopilots write the names of parameters in capitals: {name.upper()}"
        problem = _value_problem(autopilot.flavour, value)
        if problem:
            yield field, f"{name} {problem}"
        if name in _NUMBERS and value != drone:
            yield (
                field,
                f"{name} {value:g} would give drone {drone}'s autopilot the number of another; leave it out",
            )
        above_home_m = value * RETURN_ALTITUDES.get(name, 0.0)
        if above_home_m > limits.ceiling_above_home_m:
            yield (
                field,
                f"{name} {value:g} brings the drone home {above_home_m:g} m above it, over "
                f"limits.ceiling_above_home_m = {limits.ceiling_above_home_m:g} m",
            )


def _value_problem(flavour: str, value: float) -> str | None:
    # The vehicle knows the parameter's type, this file does not: PX4's integers travel whole, all else as a float.
    if flavour == "px4" and float(value).is_integer() and int(value) in _INT32:
        return None
    return value_problem(Flavour.ARDUPILOT, int(mavlink.MAV_PARAM_TYPE_REAL32), value)
