"""A scenario's file: what it may say, and what is told of what it may not."""

from __future__ import annotations

import pathlib

import pytest

from flightstack.transport.radio_model import LinkBudget, RadioModel
from mission.documents.yaml_file import DocumentError
from simvehicle.scenario.scenario_file import parse_scenario

EXAMPLE = (pathlib.Path(__file__).parents[4] / "examples" / "scenario.yaml").read_text(encoding="utf-8")
BEFORE, _, _ = EXAMPLE.partition("swarm_faults:")


def with_fault(fault: str) -> str:
    return f"{BEFORE}swarm_faults:\n  - {{at_s: 5.0, {fault}}}\n"


def test_the_example_is_a_survey_with_faults() -> None:
    scenario = parse_scenario(EXAMPLE, "example.yaml")
    assert [fault.kind for fault in scenario.config.swarm_faults] == ["kill", "freeze"]
    assert [drone.id for drone in scenario.survey.drones] == [1, 2, 3, 4, 5, 6, 7]
    assert scenario.config.last_fault_s == 47.0


@pytest.mark.parametrize(
    "fault",
    [
        "kind: kill, drone: 7",
        "kind: reboot, drone: 1, until_s: 9.0",
        "kind: radio_dead, drone: 1, until_s: 9.0",
        "kind: one_way, drone: 1, towards: 2",
        "kind: partition, parts: [[1, 2], [3, 4], [5, 6, 7]], until_s: 9.0",
        "kind: loss, loss: 0.5",
        "kind: clock_jump, drone: 1, by_s: 3.0",
        "kind: pilot, drone: 1",
        "kind: ground_gone",
        "kind: command, command: pause",
        "kind: command, command: rtl, drone: 2",
    ],
)
def test_every_kind_can_be_written(fault: str) -> None:
    assert len(parse_scenario(with_fault(fault), "f.yaml").config.swarm_faults) == 1


@pytest.mark.parametrize(
    ("fault", "field", "problem"),
    [
        ("kind: kill", "drone", '"kill" needs drone; give it'),
        ("kind: kill, drone: 8", "drone", "there is no drone 8, but [1, 2, 3, 4, 5, 6, 7]"),
        ("kind: kill, drone: 1, until_s: 9.0", "until_s", '"kill" has no until_s; remove it'),
        ("kind: kill, drone: 1, loss: 0.5", "loss", '"kill" has no loss; remove it'),
        ("kind: reboot, drone: 1", "until_s", '"reboot" needs until_s; give it'),
        ("kind: freeze, drone: 1, until_s: 4.0", "until_s", "cannot be over at 4 s"),
        ("kind: one_way, drone: 1, towards: 1", "towards", "a drone hears itself"),
        ("kind: partition", "parts", '"partition" needs parts; give it'),
        ("kind: partition, parts: [[1, 2]]", "parts", "two parts or more"),
        ("kind: partition, parts: [[1, 2], [2, 3]]", "parts", "drone 2 stands in it twice"),
        ("kind: partition, parts: [[1], [9]]", "parts", "there is no drone 9"),
        ("kind: comand, command: pause", "kind", "write clock_jump or command or"),
        ("kind: command, command: fly", "command", "write abort or land or pause"),
        ("kind: loss, loss: 1.0", "loss", "< 1.0"),
        ("kind: freeze, dron: 1", "dron", "unknown key"),
    ],
)
def test_what_cannot_be_is_one_line_with_place_and_mend(fault: str, field: str, problem: str) -> None:
    text = with_fault(fault)
    with pytest.raises(DocumentError) as caught:
        parse_scenario(text, "f.yaml")
    told = str(caught.value)
    line = text[: text.index("at_s: 5.0")].count("\n") + 1
    assert told.startswith(f"f.yaml:{line}: swarm_faults[0].{field}: ")
    assert problem in told
    assert "\n" not in told


def test_what_is_wrong_with_its_survey_is_told_as_of_a_survey() -> None:
    with pytest.raises(DocumentError, match=r"f\.yaml:\d+: launch_line: .*start 1\.0 m apart"):
        parse_scenario(EXAMPLE.replace("spacing_m: 6.0, towards", "spacing_m: 1.0, towards"), "f.yaml")


def test_a_scenarios_radio_is_the_radio_model() -> None:
    radio = "radio: {loss: 0.1, link_budget: {shadowing_db: 6.0}, dead_links: [[1, 2], [3, ground]]}"
    text = EXAMPLE.replace("radio: {loss: 0.1}", f"{radio}\nground_ned_m: [-20, 0, 0]")
    config = parse_scenario(text, "f.yaml").config
    assert config.radio == RadioModel(
        loss=0.1, link_budget=LinkBudget(shadowing_db=6.0), dead_links=((1, 2), (3, "ground"))
    )
    assert config.ground_ned_m == (-20.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("radio", "field", "problem"),
    [
        ("dead_links: [[1, 2], [8, 2]]", "radio.dead_links[1]", "there is no 8 to hear or be heard"),
        (
            "dead_links: [[1, base]]",
            "radio.dead_links[0]",
            """there is no 'base' to hear or be heard, but "ground\"""",
        ),
        ("dead_links: [[2, 2]]", "radio.dead_links[0]", "2 hears itself"),
        ("loss: 1.0", "radio.loss", "< 1.0"),
        ("ridges: [{crest_ned_m: [[0, 0, -9]]}]", "radio.ridges[0].crest_ned_m", "length >= 2"),
        ("bandwidth: 3", "radio.bandwidth", "unknown key"),
    ],
)
def test_a_radio_that_cannot_be_is_one_line(radio: str, field: str, problem: str) -> None:
    text = EXAMPLE.replace("radio: {loss: 0.1}", f"radio: {{{radio}}}")
    line = text[: text.index("radio: {" + radio[:4])].count("\n") + 1
    with pytest.raises(DocumentError) as caught:
        parse_scenario(text, "f.yaml")
    assert str(caught.value).startswith(f"f.yaml:{line}: {field}: ")
    assert problem in str(caught.value)
