"""Every survey that cannot be flown is refused in one line that says where and how to mend it."""

from __future__ import annotations

import json
import pathlib

import msgspec
import pytest

from flightstack.config import FormationConfig, LimitsConfig, StrategyConfig
from flightstack.transport.radio_model import RadioModel
from mission.documents.fence_section import FenceSection
from mission.documents.yaml_file import DocumentError
from mission.strategies.locus.strategy import LocusParameters
from mission.strategies.mobs import MobsParameters
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.survey.fault_options import parse_fault
from simvehicle.survey.survey_file import (
    LaunchLine,
    SurveyConfig,
    SurveyDrone,
    load,
    parse_survey,
)
from simvehicle.world.world_config import GaussianPlume, LocusGridPlume, WindConfig

EXAMPLES = pathlib.Path(__file__).parents[4] / "examples"
GOOD = (EXAMPLES / "survey.yaml").read_text(encoding="utf-8")


BOX = "type: rectangle, centre_north_m: {}, centre_east_m: {}, length_north_m: 10, length_east_m: 10"
BLOCK = f"obstacles:\n- {{{{{BOX}}}}}\n"
SECOND = f"obstacles:\n- {{{{{BOX}, unknown: true}}}}\n- {{{{{BOX}}}}}\n"
RING = (
    "obstacles:\n- {type: polygon, top_above_home_m: 30, corners_north_east_m: [[-9, -24], [-9, -12], [-21, -12], "
    "[-21, -24], [-14, -24], [-14, -23], [-20, -23], [-20, -14], [-11, -14], [-11, -24]]}\n"
)
"""Around drone 1 of a launch line with wide spacing; its opening is narrower than two margins."""


def refused(tmp_path: pathlib.Path, text: str) -> str:
    path = tmp_path / "survey.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DocumentError) as caught:
        load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}:"), "the line names the file"
    return message.removeprefix(str(path))


EXAMPLE_PLUME = """plume:
  type: gaussian
  source_north_m: 30.0
  source_east_m: -85.0
  source_above_home_m: 10.0
  emission_kgps: 2.5
  vent_sd_m: 4.0
"""
VENT = "plume: {{type: filaments, sources: [{{north_m: 1, east_m: 2}}], {}}}"


@pytest.mark.parametrize(("file", "flavour"), [("survey.yaml", "ardupilot"), ("survey_px4.yaml", "px4")])
def test_the_examples_are_good(file: str, flavour: str) -> None:
    survey = load(EXAMPLES / file)
    assert [drone.id for drone in survey.drones] == [1, 2, 3, 4, 5]
    assert {drone.flavour for drone in survey.drones} == {flavour}
    assert all(drone.instruments for drone in survey.drones)
    assert survey.geofence is not None
    assert survey.warnings == ()


def test_the_command_line_wins_over_the_file() -> None:
    fault = parse_fault("co2-unplug:2@90")
    survey = load(EXAMPLES / "survey.yaml", speedup=2.0, seed=9, extra_faults=(fault,))
    assert (survey.config.speedup, survey.config.seed, survey.config.faults) == (2.0, 9, (fault,))


def test_more_drones_than_the_file_says_stand_on_its_launch_line() -> None:
    survey = load(EXAMPLES / "survey.yaml", drones=9)
    assert [drone.id for drone in survey.drones] == list(range(1, 10))
    assert survey.drones[4].home_north_m == survey.drones[4].home_east_m == 0.0


def test_how_much_the_radio_loses_is_the_files_unless_the_command_line_says_it() -> None:
    text = GOOD + "radio: {loss: 0.1, delay_s: 0.05}\n"
    assert parse_survey(text, "survey.yaml").config.radio == RadioModel(loss=0.1, delay_s=0.05)
    radio = parse_survey(text, "survey.yaml", radio_loss=0.2).config.radio
    assert radio == RadioModel(loss=0.2, delay_s=0.05)
    assert load(EXAMPLES / "survey.yaml").config.radio == RadioModel()


def test_a_file_that_lists_its_drones_has_no_other_number_of_them(tmp_path: pathlib.Path) -> None:
    head, _, rest = GOOD.partition("launch_line:")
    path = tmp_path / "survey.yaml"
    path.write_text(head + "drones: [{id: 1}]\n" + rest[rest.index("formation:") :], encoding="utf-8")
    with pytest.raises(
        DocumentError, match=r"^--drones 9: .*lists its drones; give it a launch_line instead$"
    ):
        load(path, drones=9)


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(DocumentError, match=r"^no/such\.yaml: cannot be read: No such file or directory$"):
        load("no/such.yaml")


def test_a_file_that_is_not_text(tmp_path: pathlib.Path) -> None:
    (tmp_path / "survey.yaml").write_bytes(b"\xfa\xfe\x00")
    with pytest.raises(DocumentError, match="not UTF-8"):
        load(tmp_path / "survey.yaml")


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("speedup: 5.0", "speedupp: 5.0", ["speedupp", "unknown key"]),
        ("speedup: 5.0", "speedup: fast", ["speedup", "float"]),
        ("  spacing_m: 10.0", "  spacing_m: -1", ["formation.spacing_m"]),
        ("spacing_m: 6.0", "spacing_m: 3.0", ["launch_line", "drones 1 and 2 start 3.0 m apart", "separation_m"]),
        ("  spacing_m: 10.0", "  spacing_m: 3.5", ["formation", "must stay 4 m apart"]),
        ("radio_range_m: 60.0", "radio_range_m: 8.0", ["formation", "radio"]),
        ("above_home_m: 10.0\n\n", "above_home_m: 130.0\n\n", ["formation.above_home_m", "ceiling"]),
        ("above_home_m: 10.0\n\n", "above_home_m: 5.0\n\n", ["formation.above_home_m", "heir"]),
        ("ceiling_above_home_m: 120.0", "ceiling_above_home_m: 30.0", ["formation.layer_gap_m", "highest of 5"]),
        ("above_home_m: 10.0\n\n", "above_home_m: 10.0\n  layer_gap_m: 2.0\n\n", ["formation.layer_gap_m"]),
        ("[38.405081, 14.965175]", "[38.4020, 14.9600]", ["geofence", "cross"]),
        ("  towards_deg: 50.0", "  north_m: 400.0", ["launch_line", "outside the geofence"]),
        ("name: locus", "name: lotus", ["strategy", "lotus"]),
        ("parameters: {step_m", "parameters: {stepp_m", ["strategy", "stepp_m"]),
        ("seed: 1", "seed: 1\nfaults: [{drone: 9, at_s: 5, kind: motor}]", ["faults[0].drone", "no drone 9"]),
        (
            "seed: 1",
            "seed: 1\nfaults: [{drone: 1, at_s: 5, kind: unplug, instrument: c02}]",
            ["faults[0].instrument", "c02"],
        ),
        ("seed: 1", "seed: 1\ninstruments: [{name: co2, type: sba6}]", ["instruments[0].type", "sba5"]),
        ("seed: 1", "seed: 1\ninstruments: [{name: a, type: sba5}, {name: a, type: sba5}]", ["instruments[1].name"]),
        ("launch_line:", "drones: [{id: 1}]\nlaunch_line:", ["drones", "one of them"]),
        ("type: gaussian", "type: gausian", ["plume.type: ", "'gausian'; write gaussian or locus-grid"]),
        ("flavour: ardupilot", "flavour: px5", ["launch_line.flavour: ", "'px5'; write ardupilot or px4"]),
        ("seed: 1", "seed: 1\nfaults: [{kind: fire}]", ["faults[0].kind: ", "battery_low or failsafe or gps_jump"]),
        ("gust_time_s: 5.0", "gust_time_s: 0.001", ["wind.gust_time_s", ">= 0.1"]),
        ("vent_sd_m: 4.0", "vent_sd_m: 0.1", ["plume.vent_sd_m", "more than pure CO2"]),
        (EXAMPLE_PLUME, "plume: {type: filaments, sources: []}", ["plume.sources"]),
        (EXAMPLE_PLUME, VENT.format("initial_radius_m: 0.1"), ["plume.initial_radius_m: ", "ppm", "larger radius"]),
        (EXAMPLE_PLUME, VENT.format("puffs_per_s: 5e4"), ["plume.puffs_per_s: ", "30,000,000 puffs", "lifetime_s"]),
        ("source_above_home_m: 10.0", "source_above_home_m: -1.0", ["plume.source_above_home_m"]),
        ("seed: 1", "seed: 1\nradio: {bandwidth_bytes_per_s: 9e3}", ["radio.bandwidth", "only scenarios"]),
        ("seed: 1", "seed: 1\nradio: {dead_links: [[1, 9]]}", ["radio.dead_links[0]", "there is no 9"]),
        ("geofence:", "geofence:\n  file: none.plan", ["geofence.file", "not both"]),
        ("seed: 1", f"seed: 1\n{BLOCK.format(-14, 4)}", ["obstacles[0]", "slot 4", "inside this obstacle"]),
        ("seed: 1", f"seed: 1\n{SECOND.format(-14, 4, -14, 4)}", ["obstacles[1]", "forms up", "slot 4"]),
        ("seed: 1", f"seed: 1\n{BLOCK.format(-8.5, -16.2)}",
         ["launch_line: drone 1's launch point is 2.0 m from an obstacle", "obstacle_margin_m = 3 m", "move it"]),
        ("  spacing_m: 6.0\n  towards_deg: 50.0\n", f"  spacing_m: 12.0\n  towards_deg: 50.0\n{RING}",
         ["launch_line: drone 1's launch point has no way", "layer 15 m high"]),
        ("seed: 1", "seed: 1\nobstacles: [{type: polygon, corners_north_east_m: [[0, 0], [1, 0]]}]",
         ["obstacles[0].corners_north_east_m", "length >= 3"]),
    ],
)  # fmt: skip
def test_what_cannot_be_flown(tmp_path: pathlib.Path, before: str, after: str, expected: list[str]) -> None:
    assert before in GOOD
    message = refused(tmp_path, GOOD.replace(before, after, 1))
    for part in expected:
        assert part in message
    assert message[1].isdigit(), f"the line number is missing: {message}"


def test_two_drones_with_one_id(tmp_path: pathlib.Path) -> None:
    head, _, rest = GOOD.partition("launch_line:")
    drones = "drones:\n- {id: 1}\n- {id: 2, home_north_m: 10}\n- {id: 1, home_north_m: 20}\n"
    message = refused(tmp_path, head + drones + rest[rest.index("formation:") :])
    assert message.startswith(":12: drones[2].id: drones[0] has the id 1 too")


def test_a_parameter_that_the_flavour_does_not_have(tmp_path: pathlib.Path) -> None:
    head, _, rest = GOOD.partition("launch_line:")
    drones = "drones:\n- {id: 1}\n- {id: 2, home_north_m: 10, parameters: {RTL_RETURN_ALT: 20}}\n"
    message = refused(tmp_path, head + drones + rest[rest.index("formation:") :])
    assert message.startswith(
        ":11: drones[1].parameters: parameters.RTL_RETURN_ALT: the simulated ardupilot has no"
    )


def test_a_source_outside_the_fence_is_only_warned_of(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "survey.yaml"
    path.write_text(GOOD.replace("source_north_m: 30.0", "source_north_m: 900.0"), encoding="utf-8")
    (warning,) = load(path).warnings
    assert "outside the geofence" in warning


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("spacing_m: 6.0", "spacing_m: 5.0", "drones 1 and 2, 2 and 3, 3 and 4, 4 and 5 start less than 6 m apart"),
        ("ceiling_above_home_m: 120.0", "ceiling_above_home_m: 60.0", "ceiling_above_home_m: 60 m leave no room"),
        ("above_home_m: 10.0\n\n", "above_home_m: 10.0\n  layers: 4\n\n", "5 drones share 4 layers"),
    ],
)  # fmt: skip
def test_what_is_kept_apart_by_hearing_only_is_warned_of(
    tmp_path: pathlib.Path, before: str, after: str, words: str
) -> None:
    path = tmp_path / "survey.yaml"
    path.write_text(GOOD.replace(before, after, 1), encoding="utf-8")
    (warning,) = load(path).warnings
    assert words in warning


def test_the_fence_of_a_plan_file(tmp_path: pathlib.Path) -> None:
    polygon = [[38.4060, 14.9600], [38.4060, 14.9660], [38.4020, 14.9660], [38.4020, 14.9600]]
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {
            "circles": [],
            "polygons": [{"inclusion": True, "polygon": polygon, "version": 1}],
            "version": 2,
        },
        "mission": {
            "cruiseSpeed": 5,
            "firmwareType": 3,
            "hoverSpeed": 5,
            "items": [],
            "plannedHomePosition": [38.404, 14.963, 300],
            "vehicleType": 2,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
    }
    (tmp_path / "crater.plan").write_text(json.dumps(plan), encoding="utf-8")
    start, end = GOOD.index("geofence:"), GOOD.index("strategy:")
    path = tmp_path / "survey.yaml"
    path.write_text(f"{GOOD[:start]}geofence: {{file: crater.plan}}\n{GOOD[end:]}", encoding="utf-8")
    fence = load(path).geofence
    assert fence is not None
    assert len(fence.inclusion[0]) == 4
    (tmp_path / "crater.plan").unlink()
    with pytest.raises(DocumentError, match=r"crater\.plan: cannot be read"):
        load(path)


def test_faults_from_the_command_line() -> None:
    unplug = parse_fault("co2-unplug:2@90")
    assert (unplug.kind, unplug.instrument, unplug.drone, unplug.at_s) == ("unplug", "co2", 2, 90.0)
    loss = parse_fault("gps-loss:3@60-75.5")
    assert (loss.kind, loss.drone, loss.at_s, loss.until_s) == ("gps_loss", 3, 60.0, 75.5)
    assert parse_fault("battery-low:1@5").kind == "battery_low"
    assert parse_fault("gps-jump:1@5-9").kind == "gps_jump"
    stuck = parse_fault("wind_2-stuck:4@1")
    assert (stuck.kind, stuck.instrument) == ("stuck", "wind_2")
    failsafe = parse_fault("remote-control-failsafe:3@60")
    assert (failsafe.kind, failsafe.unheard, failsafe.instrument) == ("failsafe", "remote_control", "")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "unplug:2@90",
        "co2-motor:2@90",
        "failsafe:2@90",
        "co2-failsafe:2@9",
        "co2-gps-loss:2@9",
        "motor:2",
        "motor:x@1",
        "fire:1@1",
    ],
)
def test_faults_that_mean_nothing(text: str) -> None:
    with pytest.raises(DocumentError, match="--fault"):
        parse_fault(text)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("motor:9@1", r"there is no drone 9, but \[1, 2, 3, 4, 5\]"),
        ("wind-unplug:2@1", "no instrument called 'wind', but \\['co2'\\]"),
        ("wind-lying:2@1", "no instrument called 'wind', but \\['co2'\\]"),
        ("gps-loss:3@75-60", "it breaks at 75 s, so it cannot mend at 60 s"),
    ],
)
def test_faults_that_do_not_fit_the_survey_are_named_as_they_were_given(text: str, problem: str) -> None:
    with pytest.raises(DocumentError, match=rf"^--fault {text}: .*{problem}"):
        load(EXAMPLES / "survey.yaml", extra_faults=(parse_fault(text),))


@pytest.mark.parametrize(
    "section",
    [
        SurveyConfig, SurveyDrone, LaunchLine, FenceSection, WindConfig, GaussianPlume, LocusGridPlume, FaultSpec,
        FormationConfig, LimitsConfig, StrategyConfig, LocusParameters, MobsParameters,
    ],
)  # fmt: skip
def test_every_key_is_explained(section: type[msgspec.Struct]) -> None:
    page = (EXAMPLES.parent / "docs" / "simulate.md").read_text(encoding="utf-8")
    assert [name for name in section.__struct_fields__ if f"`{name}`" not in page] == []
