"""The survey with real ArduCopter processes; agents, ground station and launcher are those of every survey.

ARDUCOPTER_SITL names the `arducopter` program built for simulation, ARDUCOPTER_DEFAULTS its parameter file (for a
quadcopter: Tools/autotest/default_params/copter.parm of the same version). ArduCopter waits for remote controls on
every interface: run it where that does no harm.
"""

from __future__ import annotations

import importlib.util
import os
import pathlib
import signal
import socket
import stat
import subprocess
import sys
import time
import types

import msgspec
import pytest
import yaml

from mission.frames import Geodetic
from simvehicle.conductor import Outcome
from simvehicle.config import EmulatedInstrument, FleetConfig, GaussianPlume, VehicleSpec
from simvehicle.fly import fly
from simvehicle.launch import free_ports
from simvehicle.survey import load
from simvehicle.truth import TruthRow, TruthTail

pytestmark = pytest.mark.system

HERE = pathlib.Path(__file__).parent
SURVEY = HERE.parents[1] / "examples" / "survey.yaml"
SPEEDUP = 2.0
"""Five ArduCopters and five agents on two cores."""


def load_fleet_module() -> types.ModuleType:
    spec = importlib.util.spec_from_file_location("ardupilot_sitl_fleet", HERE / "ardupilot_sitl_fleet.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.optional
@pytest.mark.timeout(3600)
@pytest.mark.skipif(
    "ARDUCOPTER_SITL" not in os.environ, reason="ARDUCOPTER_SITL does not name an arducopter program"
)
def test_the_survey_with_real_arducopters(tmp_path: pathlib.Path) -> None:
    survey = load(SURVEY, speedup=SPEEDUP)
    got = fly(survey, out=tmp_path, commands=load_fleet_module().fleet_command).summary
    assert got.outcome == Outcome.SOURCE_FOUND, got
    assert (got.alive, got.lost_processes, got.fence_breaches) == (len(survey.drones), (), 0)
    assert got.source_error_m is not None
    assert got.source_error_m < 5.0
    assert got.min_separation_m is not None
    assert got.min_separation_m >= survey.config.limits.separation_m


def test_the_harness_of_real_arducopters_with_a_stand_in(tmp_path: pathlib.Path) -> None:
    """One vehicle: it is started as the options say, watched, measured around, recorded, and ended."""
    program = tmp_path / "arducopter"
    program.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" "{HERE / "arducopter_standin.py"}" "$@"\n', encoding="utf-8"
    )
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    defaults = tmp_path / "defaults.parm"
    defaults.write_text("RTL_ALT 2500\n", encoding="utf-8")
    companion, ground = free_ports(socket.SOCK_DGRAM, 2)
    (instrument,) = free_ports(socket.SOCK_STREAM, 1)
    fleet = FleetConfig(
        origin=Geodetic(38.4040, 14.9630, 300.0),
        vehicles=(
            VehicleSpec(
                id=7,
                home_north_m=12.0,
                links=(f"udpout:127.0.0.1:{companion}", f"udpout:127.0.0.1:{ground}"),
                instruments=(EmulatedInstrument(name="co2", type="sba5", port=f"127.0.0.1:{instrument}"),),
            ),
        ),
        plume=GaussianPlume(source_north_m=30.0, source_east_m=-85.0),
        speedup=10.0,
        truth=str(tmp_path / "truth.csv"),
    )
    config = tmp_path / "fleet.yaml"
    config.write_text(yaml.safe_dump(msgspec.to_builtins(fleet)), encoding="utf-8")
    environment = {**os.environ, "ARDUCOPTER_SITL": str(program), "ARDUCOPTER_DEFAULTS": str(defaults)}
    command = [sys.executable, str(HERE / "ardupilot_sitl_fleet.py"), "--config", str(config)]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    tail = TruthTail(tmp_path / "truth.csv")
    try:
        row = wait_for_position(process, tail)
        line = read_line(instrument)
    finally:
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=30.0)
        tail.close()
    assert process.returncode == 0, errors
    assert row.drone == 7
    assert row.position_ned_m == pytest.approx((12.0, 0.0, 0.0), abs=2.0)
    assert row.mode == "STABILIZE"
    assert not row.airborne
    assert line.startswith("M ")
    assert "arducopter-7.log" in os.listdir(tmp_path)


def wait_for_position(process: subprocess.Popen[str], tail: TruthTail) -> TruthRow:
    """The first row with a position of the vehicle's own estimate, not only its launch point."""
    deadline_s = time.monotonic() + 60.0
    while time.monotonic() < deadline_s:
        assert process.poll() is None
        for row in tail.read():
            if row.mode and row.position_ned_m[2] != 0.0:
                return row
        time.sleep(0.1)
    raise AssertionError("the vehicle never told its position")


def read_line(port: int) -> str:
    with socket.create_connection(("127.0.0.1", port), timeout=20.0) as line:
        line.sendall(b"!M")
        return line.makefile(encoding="ascii").readline()
