"""The command line as the documentation shows it."""

from __future__ import annotations

import pathlib
import re
import shlex

import pytest
import typer
from typer.testing import CliRunner

from gcs.cli.main import app
from gcs.errors import GroundError
from gcs.fleet.monitor import Monitor

DOCUMENT = pathlib.Path(__file__).parents[4] / "docs" / "ground-station.md"
COMMANDS = re.findall(r"^gcs (.+)$", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_of_the_documentation_exists_with_its_options(line):
    words = shlex.split(line)
    command = typer.main.get_command(app)
    while hasattr(command, "commands"):
        command = command.commands[words.pop(0)]
    known = {name for parameter in command.params for name in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= known


def names(command, path=()):
    if not hasattr(command, "commands"):
        return [path]
    return [path, *(p for name, sub in command.commands.items() for p in names(sub, (*path, name)))]


@pytest.mark.parametrize("path", names(typer.main.get_command(app)), ids=" ".join)
def test_every_command_explains_itself(path):
    done = CliRunner().invoke(app, [*path, "--help"])
    assert done.exit_code == 0
    assert "Usage" in done.output


def test_every_alarm_is_documented():
    source = pathlib.Path(Monitor.step.__code__.co_filename).read_text(encoding="utf-8")
    codes = set(re.findall(r'Condition\(f?"([a-z_]+)[":]', source))
    assert len(codes) > 10
    text = DOCUMENT.read_text(encoding="utf-8")
    assert [code for code in sorted(codes) if f"`{code}`" not in text] == []


def test_a_plan_that_is_good_and_one_that_is_not(tmp_path):
    plan = tmp_path / "a.plan"
    item = '{"type":"SimpleItem","command":22,"frame":3,"params":[0,0,0,null,47,8,%d],"doJumpId":1}'
    text = '{"fileType":"Plan","version":1,"mission":{"plannedHomePosition":[47,8,500],"items":[%s]}}'
    plan.write_text(text % (item % 20))
    done = CliRunner().invoke(app, ["plan", "check", str(plan)])
    assert (done.exit_code, done.stdout) == (
        0,
        f"{plan}: good: 1 items, 1 waypoints over 0 m, 0 fence areas, 0 rally points\n",
    )
    plan.write_text(text % (item % 200))
    done = CliRunner().invoke(app, ["plan", "check", str(plan), "--json"])
    assert done.exit_code == 2
    assert "ceiling" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["param", "get", "A" * 17], "1 to 16 letters"),
        (["param", "set", "RTL_ALT", "nan"], "nan is no value"),
        (["param", "save", "/absent/x.param"], "there is no directory /absent"),
        (["plan", "download", "/absent/x.plan"], "there is no directory /absent"),
    ],
)
def test_what_cannot_be_is_refused_before_a_vehicle_is_looked_for(arguments, words, monkeypatch):
    monkeypatch.setattr("gcs.plans.autopilot_client.open_vehicle", None)
    done = CliRunner().invoke(app, [*arguments, "--drone", "1", "--link", "udpin:127.0.0.1:0"])
    assert isinstance(done.exception, GroundError)
    assert words in str(done.exception)


def test_only_a_start_can_do_without_recording():
    done = CliRunner().invoke(
        app, ["survey", "abort", "--without-recording", "--swarm", "s", "--connect", "tcp/x:1"]
    )
    assert isinstance(done.exception, GroundError)
    assert "--without-recording is for start, not for abort" in str(done.exception)
