"""How real ArduCopters are started, and which fleets they cannot fly. No process is started here."""

from __future__ import annotations

import os
import pathlib
from typing import Any

import msgspec
import pytest

from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import FleetError
from simvehicle.hil.arducopter_command import command_line, parameter_text
from simvehicle.hil.sitl_fleet import ArducopterProgram, check
from simvehicle.world.world_config import WindConfig

SPEC = VehicleSpec(
    id=3,
    links=("udpout:127.0.0.1:14503", "udpout:127.0.0.1:14600"),
    parameters={"RTL_ALT": 1200.0, "BATT_CAPACITY": 5000.0},
)


def test_the_command_line_names_links_home_and_files(tmp_path: pathlib.Path) -> None:
    line = command_line(
        "/opt/arducopter",
        ("copter.parm", "own.parm"),
        SPEC,
        speedup=2.0,
        home=Geodetic(38.5, 14.25, 300.0),
        monitor="udpin:127.0.0.1:15000",
        remote_control_port=5501,
        directory=tmp_path,
    )
    assert line[:3] == ["/bin/sh", "-c", 'cd "$1" && shift && exec "$@"']
    assert line[4:6] == [str(tmp_path), "/opt/arducopter"]
    options = dict(zip(line[6::2], line[7::2], strict=True))
    assert options == {
        "--model": "+",
        "--speedup": "2",
        "--home": "38.5000000,14.2500000,300.00,0",
        "--defaults": "copter.parm,own.parm",
        "--sysid": "3",
        "--instance": "3",
        "--rc-in-port": "5501",
        "--serial0": "udpclient:127.0.0.1:14503",
        "--serial1": "udpclient:127.0.0.1:14600",
        "--serial2": "udpclient:127.0.0.1:15000",
    }


def test_its_parameters_carry_our_wind_and_what_the_survey_sets() -> None:
    lines = dict(
        line.split() for line in parameter_text(SPEC, WindConfig(speed_mps=4.5, from_deg=320)).splitlines()
    )
    assert lines == {
        "SIM_WIND_SPD": "4.5",
        "SIM_WIND_DIR": "320",
        "SIM_WIND_T": "1",
        "BATT_CAPACITY": "5000",
        "RTL_ALT": "1200",
    }


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        (
            {"vehicles": (VehicleSpec(id=1, flavour="px4", links=("udpout:x:1",)),)},
            "vehicles[0].flavour",
            "px4",
        ),
        (
            {"vehicles": (VehicleSpec(id=1, links=("udpout:x:1",), signing_key="mavlink.key"),)},
            "vehicles[0].signing_key",
            "gcs signing setup",
        ),
        (
            {"faults": (FaultSpec(drone=3, at_s=1.0, kind="motor"),)},
            "faults[0].kind",
            "battery_low, gps_loss",
        ),
        ({"faults": (FaultSpec(drone=3, at_s=1.0, kind="silence"),)}, "faults[0].kind", "unplug"),
        ({"faults": (FaultSpec(drone=9, at_s=1.0, kind="gps_loss"),)}, "faults[0].drone", "9"),
    ],
)
def test_fleets_that_real_arducopters_cannot_fly(changes: dict[str, Any], field: str, words: str) -> None:
    fleet = FleetConfig(origin=Geodetic(38.5, 14.25, 300.0), vehicles=(SPEC,))
    check(fleet)
    with pytest.raises(FleetError) as caught:
        check(msgspec.structs.replace(fleet, **changes))
    assert caught.value.field == field
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_program_is_named_by_the_environment(tmp_path: pathlib.Path) -> None:
    program = tmp_path / "arducopter"
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    with pytest.raises(DocumentError, match="ARDUCOPTER_SITL: names no program"):
        ArducopterProgram.named({})
    with pytest.raises(DocumentError, match="names no program"):
        ArducopterProgram.named({"ARDUCOPTER_SITL": str(program)})  # it cannot be executed
    program.chmod(0o755)
    named = ArducopterProgram.named(
        {"ARDUCOPTER_SITL": os.path.relpath(program), "ARDUCOPTER_DEFAULTS": "a.parm,/b.parm"}
    )
    assert named == ArducopterProgram(str(program), (os.path.abspath("a.parm"), "/b.parm"))
