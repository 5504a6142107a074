"""The survey with real ArduCopter processes; agents, ground station and launcher are those of every survey.

ARDUCOPTER_SITL names the `arducopter` program (4.3 to 4.6) built for simulation, ARDUCOPTER_DEFAULTS its parameter
file (for a quadcopter: Tools/autotest/default_params/copter.parm of the same version). ArduCopter waits for remote
controls on every interface: run it where that does no harm.
"""

from __future__ import annotations

import os
import pathlib
import stat
import sys

import pytest

from simvehicle.hil.sitl_fleet import fleet_command
from simvehicle.survey.conduct import fly
from simvehicle.survey.supervisor import SurveyOutcome
from simvehicle.survey.survey_file import load

pytestmark = pytest.mark.system

HERE = pathlib.Path(__file__).parent
SURVEY = HERE.parents[1] / "examples" / "survey.yaml"
SPEEDUP = 1.0
"""A real ArduCopter does not wait for an agent that is late: the machine must have time to spare."""


@pytest.mark.optional
@pytest.mark.timeout(3600)
@pytest.mark.skipif(
    "ARDUCOPTER_SITL" not in os.environ, reason="ARDUCOPTER_SITL does not name an arducopter program"
)
def test_the_survey_with_real_arducopters(tmp_path: pathlib.Path) -> None:
    survey = load(SURVEY, speedup=SPEEDUP)
    got = fly(survey, out=tmp_path, commands=fleet_command).summary
    assert got.outcome == SurveyOutcome.SOURCE_FOUND, got
    assert (got.alive, got.lost_processes, got.fence_breaches) == (len(survey.drones), (), 0)
    assert got.source_error_m is not None
    assert got.source_error_m < 5.0
    assert got.min_separation_m is not None
    assert got.min_separation_m >= survey.config.limits.separation_m


SHORT = """
name: stand-ins
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
launch_line: {count: 2, spacing_m: 10.0}
formation: {radio_range_m: 60.0}
wind: {speed_mps: 3.0, from_deg: 320.0}
plume: {type: gaussian, source_north_m: 30.0, source_east_m: -85.0}
speedup: 10.0
time_limit_s: 20.0
"""


def test_the_harness_of_real_arducopters_with_stand_ins(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are started as the options say, flown by their agents, measured around, recorded, brought home, ended."""
    program = tmp_path / "arducopter"
    program.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" "{HERE / "arducopter_standin.py"}" "$@"\n', encoding="utf-8"
    )
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    defaults = tmp_path / "defaults.parm"
    defaults.write_text("RTL_LOIT_TIME 500\n", encoding="utf-8")
    file = tmp_path / "survey.yaml"
    file.write_text(SHORT, encoding="utf-8")
    monkeypatch.setenv("ARDUCOPTER_SITL", str(program))
    monkeypatch.setenv("ARDUCOPTER_DEFAULTS", os.path.relpath(defaults))
    flown = fly(load(file), out=tmp_path / "out", commands=fleet_command)
    got = flown.summary
    assert (got.outcome, got.alive, got.lost_processes) == (SurveyOutcome.TIME_LIMIT, 2, ()), got
    assert not [text for text in got.warnings if "killed" in text]
    for drone in got.per_drone:
        assert drone.landed
        assert drone.flight_s > 20.0
        assert drone.home_distance_m == pytest.approx(0.0, abs=2.0)
        assert drone.highest_co2_ppm == pytest.approx(420.0, abs=20.0)
    assert {"arducopter-1.log", "arducopter-2.log"} <= set(os.listdir(flown.directory))


def test_an_arducopter_that_does_not_start_is_named(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "arducopter"
    program.write_text("#!/bin/sh\necho Failed to load defaults\nexit 1\n", encoding="utf-8")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    file = tmp_path / "survey.yaml"
    file.write_text(SHORT, encoding="utf-8")
    monkeypatch.setenv("ARDUCOPTER_SITL", str(program))
    got = fly(load(file), out=tmp_path / "out", commands=fleet_command).summary
    assert got.outcome == SurveyOutcome.FAILED
    assert "arducopter-1 ended (exit code 1): Failed to load defaults" in got.reason
