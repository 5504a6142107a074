"""A drone's file: what can be known from it alone is checked."""

from __future__ import annotations

import logging
import pathlib
import shutil

import pytest

from flightstack.config_file import load
from flightstack.mavlink.signing_store import write_key
from gcs.station_config import load as load_station
from mission.documents.yaml_file import DocumentError
from mission.geometry.geofence import Geofence

ROOT = pathlib.Path(__file__).parents[3]
CASES = ROOT / "tests" / "data" / "cases"
GOOD = (ROOT / "examples" / "drone.yaml").read_text(encoding="utf-8")


def refused(tmp_path: pathlib.Path, old: str, new: str) -> str:
    assert old in GOOD
    (tmp_path / "drone.yaml").write_text(GOOD.replace(old, new), encoding="utf-8")
    with pytest.raises(DocumentError) as caught:
        load(tmp_path / "drone.yaml")
    text = str(caught.value)
    assert "\n" not in text
    return text.removeprefix(f"{tmp_path}/drone.yaml")


def test_a_real_drone_has_no_radio_that_loses_on_purpose(tmp_path: pathlib.Path) -> None:
    text = refused(tmp_path, "instruments:\n", "radio: /tmp/radio.yaml\ninstruments:\n")
    assert text.startswith(":14: radio: loses messages on purpose; only a simulated flight")


LIMIT = "  separation_m: 4.0"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "port: /dev/ttysba5",
            "port: /dev/ttypixhawk",
            ":15: instruments[0].port: /dev/ttypixhawk is the same device",
        ),
        ("port: /dev/ttysba5", "port: /dev/../dev/ttypixhawk", ":15: instruments[0].port"),
        (
            "instruments:\n",
            "instruments:\n  - {name: a, type: sba5, port: /dev/ttysba5}\n",
            ":16: instruments[1].port: /dev/ttysba5 stands twice",
        ),
        ("[tcp/192.168.2.11:7447]", "[tcp/0.0.0.0:7447, tcp/10.0.0.1:7447]", ":7: swarm.listen[1]"),
        ("link: /dev/ttypixhawk,115200", "link: tcpin:0.0.0.0:7447", ":7: swarm.listen[0]"),
        ("RTL_ALT: 4000", "RTL_ALTITUDE_TOO_LONG: 1", ":13: autopilot.parameters.RTL_ALTITUDE_TOO_LONG"),
        ("RTL_ALT: 4000", "RTL-ALT: 1", "1 to 16 letters"),
        ("RTL_ALT: 4000", "X: 16777217", "24 bits"),
        ("RTL_ALT: 4000", "X: 1e40", "no number to work with"),
        ("RTL_ALT: 4000", "RTL_ALT: '1500'", "Expected `float`, got `str`"),
        ("RTL_ALT: 4000", "RTL_ALT: true", ":13: autopilot.parameters.RTL_ALT: Expected `float`, got `bool`"),
        ("GUID_TIMEOUT: 1", "GUID_TIMEOUT: null", ":13: autopilot.parameters.GUID_TIMEOUT: Expected `float`"),
        ("RTL_ALT: 4000", "rtl_alt: 1500", "in capitals: RTL_ALT"),
        (
            "RTL_ALT: 4000",
            "SYSID_THISMAV: 77",
            ":13: autopilot.parameters.SYSID_THISMAV: SYSID_THISMAV 77 would give",
        ),
        ("RTL_ALT: 4000", "RTL_ALT: 15\a", ":13: unacceptable character #x0007"),
        (
            "RTL_ALT: 4000",
            "RTL_ALT: 19000",
            "brings the drone home 190 m above it, over limits.ceiling_above_home_m",
        ),
        (
            "layer_gap_m: 5.0",
            "layer_gap_m: 4.5",
            "4.5 m between layers is less than limits.separation_m = 4 m and 1 m",
        ),
        (
            "above_home_m: 10.0",
            "above_home_m: 7.0",
            "for an heir to pass under the others; fly 8 m high or higher",
        ),
        ("layer_gap_m: 5.0", "layer_gap_m: 25.0", "the highest of 5 layers is at 135 m"),
        (LIMIT, f"{LIMIT}\n  speed_mps: 4", "'speed_mps' stands twice"),
        ("speed_mps: 5.0", "speed_mps: 500", ":18: limits.speed_mps: 500 is more than any drone does"),
        ("speed_mps: 5.0", "speed_mps: 0.001", "0.001 is less than any drone keeps"),
        (LIMIT, f"{LIMIT}\n  acceleration_mps2: 0.12", "it takes 42 s to stop"),
        (
            "ceiling_above_home_m: 120.0",
            "ceiling_above_home_m: 1e9",
            "limits.ceiling_above_home_m: 1e+09 is more",
        ),
        (LIMIT, f"{LIMIT}\n  peer_lost_s: 0.1", "limits.peer_lost_s: 0.1 is less"),
        (LIMIT, f"{LIMIT}\n  ground_lost_s: 0.2", "limits.ground_lost_s: 0.2 is less"),
        (LIMIT, f"{LIMIT}\n  stages: {{holding_s: 5}}", "limits.stages.holding_s: no stage ends within 5 s"),
        (LIMIT, f"{LIMIT}\n  stages: {{returning_s: 5}}", "limits.stages.returning_s: no stage ends within"),
        (
            "battery_return_fraction: 0.3",
            "battery_return_fraction: 1.0",
            "goes home as soon as it has started",
        ),
        ("radio_range_m: 60.0", "radio_range_m: 1e7", "formation.radio_range_m: 1e+07 m is more"),
        ("name: co2", "name: 'co 2'", "instruments[0].name: 'co 2': a name is made of"),
        ("name: crater", f"name: {'c' * 50}", "swarm.name: a name has at most 40 characters"),
    ],
)
def test_what_the_file_alone_tells_is_checked(tmp_path: pathlib.Path, old: str, new: str, words: str) -> None:
    assert words in refused(tmp_path, old, new)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("RTL_ALT: 4000", "RTL_ALT: 1500", ":13: autopilot.parameters.RTL_ALT: RTL_ALT 1500 is not the altitude"),
        ("RTL_ALT: 4000", "RTL_ALT_M: 15", "set it to 40"),
        ("RTL_CONE_SLOPE: 0", "RTL_CONE_SLOPE: 3", "RTL_CONE_SLOPE 3: near home it returns lower; set it to 0"),
        ("RTL_LOIT_TIME: 0", "RTL_LOIT_TIME: 5000", "RTL_LOIT_TIME 5000: it waits over home"),
        ("RTL_LOIT_TIME: 0", "RTL_DESCEND_ALT: 10", "RTL_DESCEND_ALT 10: it waits over home at that altitude"),
        ("layer_gap_m: 5.0", "layers: 3", "formation.layers: 5 drones share 3 layers"),
        ("ceiling_above_home_m: 120.0", "ceiling_above_home_m: 60.0", "ceiling_above_home_m: 60 m leave no room"),
    ],
)  # fmt: skip
def test_what_may_bring_two_together_that_do_not_hear_each_other_is_warned_of(
    tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture, old: str, new: str, words: str
) -> None:
    with caplog.at_level(logging.WARNING):
        load(ROOT / "examples" / "drone.yaml")
        load(ROOT / "examples" / "drone_px4.yaml")
    assert caplog.text == ""
    assert old in GOOD
    (tmp_path / "drone.yaml").write_text(GOOD.replace(old, new), encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        load(tmp_path / "drone.yaml")
    assert words in caplog.text


ROCK = "corners_north_east_m: [[{0}, -80], [{0}, -60], [-60, -60], [-60, -80]]"


@pytest.mark.parametrize(
    ("obstacles", "words"),
    [
        ("[{top_above_home_m: 3}]", ": obstacles[0]: give corners"),
        ("[{corners_north_east_m: [[-4, -4], [-4, 4], [4, 4], [4, -4]]}]",
         ": obstacles[0]: the swarm forms up over the origin, 10 m high, and slot 0 of its formation is inside"),
        ("[{corners_north_east_m: [[2, -4], [2, 4], [8, 4], [8, -4]], top_above_home_m: 8}]",
         "slot 0 of its formation is 2.0 m from this obstacle; limits.obstacle_margin_m = 3 m"),
        ("[{corners_north_east_m: [[20, 0], [30, 0], [30, 1]], height_m: 3}]", ": obstacles[0].height_m"),
    ],
)  # fmt: skip
def test_obstacles_that_nobody_can_fly_among_are_refused(
    tmp_path: pathlib.Path, obstacles: str, words: str
) -> None:
    assert words in refused(tmp_path, "record_to:", f"obstacles: {obstacles}\nrecord_to:")


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (f"{{{ROCK.format(-90)}}}",
         "obstacles[0]: obstacle 0 stands as high as the autopilot of every drone comes home"),
        (f"{{{ROCK.format(-90)}, top_above_home_m: 45}}",
         "obstacles[0]: obstacle 0 stands as high as the autopilot of drones 1, 2 comes home by itself (the lowest "
         "at 40 m): it flies straight, and into what is between it and its home, while agents fly around; 48 m are"),
        (f"{{{ROCK.format(-90)}, top_above_home_m: 37}}", ""),
        (f"{{{ROCK.format(-90).replace('-60', '-900').replace('-80', '-990')}}}", ""),
    ],
)  # fmt: skip
def test_an_obstacle_that_an_autopilot_may_fly_into_is_warned_of(
    tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture, obstacle: str, words: str
) -> None:
    text = GOOD.replace("record_to:", f"obstacles: [{obstacle}]\nrecord_to:")
    (tmp_path / "drone.yaml").write_text(text, encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        load(tmp_path / "drone.yaml")
    told = [record.message for record in caplog.records]
    assert [words in text for text in told] == [True] * bool(words)


def test_integers_of_px4_travel_whole(tmp_path: pathlib.Path) -> None:
    text = GOOD.replace("flavour: ardupilot", "flavour: px4").replace("RTL_ALT: 4000", "COM_X: 16777217")
    (tmp_path / "drone.yaml").write_text(text, encoding="utf-8")
    assert load(tmp_path / "drone.yaml").autopilot.parameters["COM_X"] == 16777217.0


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    return pathlib.Path(shutil.copytree(CASES, tmp_path / "cases"))


def test_a_fence_from_another_file_is_a_fence_like_any_other(folder: pathlib.Path) -> None:
    from_plan, from_kml = load(folder / "drone_fence_of_plan.yaml"), load(folder / "drone_fence_of_kml.yaml")
    assert from_plan.geofence is not None
    assert from_kml.geofence is not None
    assert type(from_plan.geofence) is Geofence
    assert (len(from_plan.geofence.inclusion[0]), len(from_kml.geofence.inclusion[0])) == (4, 3)


def test_the_name_alone_will_do(folder: pathlib.Path) -> None:
    file = folder / "drone_fence_of_kml.yaml"
    fence = load(file).geofence
    file.write_text(file.read_text().replace("{file: fence.kml}", "fence.kml"))
    assert load(file).geofence == fence


def test_what_the_fence_s_file_holds_besides_is_told(
    folder: pathlib.Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = folder / "drone_fence_of_kml.yaml"
    file.write_text(file.read_text().replace("fence.kml", "dragonfly.mission"))
    with caplog.at_level(logging.WARNING):
        load(file)
    assert "dragonfly.mission: steps: not taken over" in caplog.text


@pytest.mark.parametrize(
    ("fence", "words"),
    [
        ("{file: none.kml}", "drone_fence_of_plan.yaml:17: geofence.file: {folder}/none.kml: cannot be read"),
        (
            "{file: p06_bowtie.plan}",
            "drone_fence_of_plan.yaml:17: geofence.file: {folder}/p06_bowtie.plan: geoFence",
        ),
        (
            "{file: fence.kml, inclusion_circles: [{latitude_deg: 47, longitude_deg: 8, radius_m: 5}]}",
            "not both",
        ),
        ("{file: ''}", "geofence.file"),
        ("{file: 5}", "geofence.file: Expected `str | null`, got `int`"),
        ("none.kml", "drone_fence_of_plan.yaml:17: geofence: {folder}/none.kml: cannot be read"),
        ("[fence.kml]", "geofence: Expected `str | object | null`, got `array`"),
    ],
)
def test_a_fence_that_is_none_is_refused_at_its_line(folder: pathlib.Path, fence: str, words: str) -> None:
    file = folder / "drone_fence_of_plan.yaml"
    file.write_text(file.read_text().replace("{file: p01_ok.plan}", fence))
    with pytest.raises(DocumentError) as caught:
        load(file)
    assert words.replace("{folder}", str(folder)) in str(caught.value)


def test_a_station_watches_the_fence_of_a_file_too(folder: pathlib.Path) -> None:
    station = folder / "ground.yaml"
    station.write_text(station.read_text() + "\ngeofence: {file: fence.geojson}\n")
    fence = load_station(station).geofence
    assert type(fence) is Geofence
    assert len(fence.inclusion[0]) == 3


def test_a_signing_key_lies_beside_the_file(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "drone.yaml"
    file.write_text(
        GOOD.replace("  flavour: ardupilot\n", "  flavour: ardupilot\n  signing_key: mavlink.key\n")
    )
    with pytest.raises(DocumentError, match=r"drone\.yaml:13: autopilot\.signing_key: .*No such file"):
        load(file)
    write_key(tmp_path / "mavlink.key")
    assert load(file).autopilot.signing_key == str(tmp_path / "mavlink.key")
