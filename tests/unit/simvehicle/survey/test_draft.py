"""A survey becomes the configurations of its parts, at the addresses that it is given."""

from __future__ import annotations

import itertools
import pathlib
import socket

import pytest

from flightstack.config_file import cautions
from flightstack.config_file import problems as drone_problems
from gcs.station_config import problems as ground_problems
from simvehicle.scenario.scenario_file import load_scenario
from simvehicle.survey.draft import (
    Addresses,
    Draft,
    DroneAddresses,
    draft,
    in_process,
    numbered,
    ports_needed,
)
from simvehicle.survey.survey_file import Survey, load, parse_survey

EXAMPLES = pathlib.Path(__file__).parents[4] / "examples"
SURVEY = """
name: two
origin: {latitude_deg: 38.4040, longitude_deg: 14.9630, amsl_m: 300.0}
drones:
  - {id: 4, home_east_m: 0.0}
  - id: 9
    flavour: px4
    home_east_m: 10.0
    instruments: [{name: co2, type: k30}, {name: wind, type: ft205}]
formation: {radio_range_m: 60.0}
speedup: 4.0
"""
ADDRESSES = Addresses(
    "tcp/10.0.0.1:7447",
    "10.0.0.1:14550",
    (
        DroneAddresses("tcp/10.0.0.4:7447", "10.0.0.4:14540", ("10.0.0.4:9001",)),
        DroneAddresses("tcp/10.0.0.9:7447", "10.0.0.9:14540", ("10.0.0.9:9001", "10.0.0.9:9002")),
    ),
)


@pytest.fixture
def survey() -> Survey:
    return parse_survey(SURVEY, "two.yaml")


def fits(drafted: Draft) -> None:
    """Each part of it accepts what it is given."""
    assert list(ground_problems(drafted.ground)) == []
    for drone in drafted.drones:
        assert list(drone_problems(drone)) == []


def test_every_part_is_told_where_the_others_are(survey: Survey) -> None:
    drafted = draft(survey, ADDRESSES)
    fits(drafted)
    first, second = drafted.drones
    assert first.autopilot.link == "udpin:10.0.0.4:14540"
    assert [i.port for i in second.instruments] == ["socket://10.0.0.9:9001", "socket://10.0.0.9:9002"]
    assert second.swarm.listen == ("tcp/10.0.0.9:7447",)
    everybody = ("tcp/10.0.0.1:7447", "tcp/10.0.0.4:7447", "tcp/10.0.0.9:7447")
    assert {first.swarm.connect, second.swarm.connect, drafted.ground.swarm.connect} == {everybody}
    assert first.swarm.members == second.swarm.members == drafted.ground.swarm.members == (4, 9)
    assert drafted.ground.mavlink.links == ("udpin:10.0.0.1:14550",)
    vehicle = drafted.fleet.vehicles[1]
    assert vehicle.links == ("udpout:10.0.0.9:14540", "udpout:10.0.0.1:14550")
    assert [(i.type, i.port) for i in vehicle.instruments] == [
        ("k30", "10.0.0.9:9001"),
        ("ft205", "10.0.0.9:9002"),
    ]


def test_a_directory_gives_all_one_clock_and_each_a_slot(survey: Survey) -> None:
    directory = pathlib.Path("/nowhere")
    drafted = draft(
        survey, Addresses(ADDRESSES.ground_endpoint, ADDRESSES.ground_mavlink, ADDRESSES.drones, directory)
    )
    assert drafted.fleet.clock == "/nowhere/clock"
    assert drafted.fleet.truth == "/nowhere/truth.csv"
    clocks = [drafted.ground.clock, *(drone.clock for drone in drafted.drones)]
    assert [clock and (clock.file, drafted.followers[clock.slot - 1]) for clock in clocks] == [
        ("/nowhere/clock", "ground"),
        ("/nowhere/clock", "drone-4"),
        ("/nowhere/clock", "drone-9"),
    ]
    assert [drone.record_to for drone in drafted.drones] == ["/nowhere/drone-4", "/nowhere/drone-9"]
    assert drafted.ground.record_to == "/nowhere"


def test_with_keys_everybody_shows_their_own_and_hears_the_launcher(survey: Survey) -> None:
    addresses = numbered(
        survey, "127.0.0.1", itertools.count(1), itertools.count(1), keys=pathlib.Path("/keys")
    )
    drafted = draft(survey, addresses)
    fits(drafted)
    assert all(endpoint.startswith("tls/") for endpoint in drafted.ground.swarm.connect)
    sections = [
        *(drone.swarm.tls for drone in drafted.drones),
        drafted.ground.swarm.tls,
        drafted.launcher_tls,
    ]
    assert [tls and (tls.authority, tls.certificate, tls.private_key) for tls in sections] == [
        (f"/keys/{name}/authority.pem", f"/keys/{name}/{name}.pem", f"/keys/{name}/{name}.key")
        for name in ("drone-4", "drone-9", "ground", "launcher")
    ]
    assert {tls and tls.stations for tls in sections} == {("ground", "launcher")}
    assert draft(survey, ADDRESSES).launcher_tls is None


def test_without_a_directory_there_is_no_file_to_write(survey: Survey) -> None:
    drafted = draft(survey, ADDRESSES)
    assert drafted.fleet.clock is None
    assert drafted.fleet.truth is None
    assert [drone.clock for drone in drafted.drones] == [None, None]


def test_a_draft_opens_nothing_and_writes_nothing(
    survey: Survey, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a socket was opened")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.chdir(tmp_path)
    fits(draft(survey, in_process(survey)))
    draft(survey, numbered(survey, "127.0.0.1", itertools.count(1), itertools.count(1), tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_numbered_takes_exactly_the_ports_that_are_needed(survey: Survey) -> None:
    tcp, udp = ports_needed(survey)
    assert (tcp, udp) == (1 + 2 + 3, 1 + 2)
    addresses = numbered(survey, "127.0.0.1", range(100, 100 + tcp), range(200, 200 + udp))
    listens = [addresses.ground_endpoint, *(drone.endpoint for drone in addresses.drones)]
    instruments = [port for drone in addresses.drones for port in drone.instruments]
    assert len({*listens, *(f"tcp/{port}" for port in instruments)}) == tcp
    assert len({addresses.ground_mavlink, *(drone.companion for drone in addresses.drones)}) == udp


@pytest.mark.parametrize(
    ("file", "name", "scale"), [("survey.yaml", "RTL_ALT", 100.0), ("survey_px4.yaml", "RTL_RETURN_ALT", 1.0)]
)
def test_each_autopilot_returns_in_a_layer_of_its_own(file: str, name: str, scale: float) -> None:
    survey = load(EXAMPLES / file)
    altitudes = [d.autopilot.parameters[name] / scale for d in draft(survey, in_process(survey)).drones]
    assert altitudes == [40.0, 45.0, 50.0, 55.0, 60.0], "above the agents' layers, which end at 35 m"


def test_px4_drones_come_home_by_themselves_in_layers() -> None:
    survey = load(EXAMPLES / "survey_px4.yaml")
    for drone in draft(survey, in_process(survey)).drones:
        assert drone.autopilot.parameters["COM_OBL_RC_ACT"] == 3.0
        assert drone.autopilot.parameters["RTL_CONE_ANG"] == 0.0
        own_m = drone.autopilot.parameters["RTL_RETURN_ALT"]
        assert drone.autopilot.parameters["RTL_DESCEND_ALT"] == own_m, "it does not wait among the others"


def test_what_a_file_says_of_a_drones_failsafes_is_not_overwritten_by_its_agent() -> None:
    text = SURVEY.replace("home_east_m: 10.0", "home_east_m: 10.0\n    parameters: {COM_OBL_RC_ACT: 5}")
    survey = parse_survey(text, "own.yaml")
    _, drafted = draft(survey, in_process(survey)).drones
    assert drafted.autopilot.parameters["COM_OBL_RC_ACT"] == 5.0
    assert drafted.autopilot.parameters["RTL_CONE_ANG"] == 0.0


@pytest.mark.parametrize("file", ["survey.yaml", "survey_px4.yaml", "survey_multi.yaml", "scenario.yaml"])
def test_what_is_drafted_gives_no_reason_for_caution(file: str) -> None:
    survey = load_scenario(EXAMPLES / file).survey if file == "scenario.yaml" else load(EXAMPLES / file)
    assert survey.warnings == ()
    for drone in draft(survey, in_process(survey)).drones:
        assert list(cautions(drone)) == []
