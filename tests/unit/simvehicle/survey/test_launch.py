"""What is written for the parts of a survey can be read by them."""

from __future__ import annotations

import contextlib
import datetime
import pathlib
import socket
import subprocess
import sys

import pytest

from flightstack.config_file import load as load_drone
from flightstack.recording.shared_clock import ClockCells
from flightstack.transport.certificates import check_certificates
from flightstack.transport.node_places import NodePlaces
from flightstack.transport.radio_model import RadioModel
from flightstack.transport.shared_radio import SharedRadio
from gcs.station_config import load as load_ground
from mission.documents.yaml_file import DocumentError, parse
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.survey import launch
from simvehicle.survey.draft import LAUNCHER
from simvehicle.survey.ports import free_ports
from simvehicle.survey.survey_file import load

EXAMPLES = pathlib.Path(__file__).parents[4] / "examples"
NOW = datetime.datetime(2026, 5, 4, 3, 2, 1, tzinfo=datetime.UTC)


def test_free_ports_differ() -> None:
    ports = free_ports(socket.SOCK_DGRAM, 50)
    assert len(set(ports)) == 50


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nothing reserves a port")
def test_no_other_process_gets_a_port_before_it_is_opened() -> None:
    program = (
        "import socket; from simvehicle.survey.ports import free_ports; "
        "print(*free_ports(socket.SOCK_DGRAM, 300))"
    )
    own = free_ports(socket.SOCK_STREAM, 300)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    others = [int(word) for word in done.stdout.split()]
    assert len(set(others)) == 300
    assert not set(own) & set(others)
    assert max(*own, *others) < 32_768, "the operating system gives those from 32768 to whoever asks"


def test_every_part_can_read_its_file(tmp_path: pathlib.Path) -> None:
    survey = load(EXAMPLES / "survey.yaml")
    prepared = launch.prepare(survey, tmp_path)
    plan = prepared.draft
    fleet = parse((tmp_path / "fleet.yaml").read_text(encoding="utf-8"), FleetConfig, "fleet.yaml")
    assert fleet == plan.fleet
    ground = load_ground(tmp_path / "ground.yaml")
    assert ground == plan.ground
    assert ground.speedup == survey.config.speedup
    assert ground.geofence == survey.geofence
    for vehicle, spec in zip(fleet.vehicles, plan.drones, strict=True):
        drone = load_drone(tmp_path / f"drone-{spec.drone}.yaml")
        assert drone == spec
        assert drone.geofence == survey.geofence
        companion, to_ground = vehicle.links
        assert companion.replace("udpout", "udpin") == drone.autopilot.link
        assert to_ground.replace("udpout", "udpin") == ground.mavlink.links[0]
        assert [f"socket://{i.port}" for i in vehicle.instruments] == [i.port for i in drone.instruments]
        assert ground.swarm.listen[0] in drone.swarm.connect
    links = [link for vehicle in fleet.vehicles for link in vehicle.links[:1]]
    assert len(set(links)) == len(links)
    clock = ClockCells(prepared.clock)
    assert len(clock.values) == 1 + 1 + len(plan.drones) + 1, "the time, ground station, agents, launcher"
    clock.close()


def test_every_part_believes_the_keys_that_it_is_given(tmp_path: pathlib.Path) -> None:
    survey = load(EXAMPLES / "survey.yaml", drones=2)
    prepared = launch.prepare(survey, tmp_path, tls=True)
    assert load_ground(tmp_path / "ground.yaml") == prepared.draft.ground
    for spec in prepared.draft.drones:
        assert load_drone(tmp_path / f"drone-{spec.drone}.yaml") == spec
    assert prepared.draft.launcher_tls is not None
    check_certificates(prepared.draft.launcher_tls, LAUNCHER)


def test_everybody_hears_through_the_surveys_radio(tmp_path: pathlib.Path) -> None:
    text = (EXAMPLES / "survey.yaml").read_text(encoding="utf-8")
    far = tmp_path / "survey.yaml"
    far.write_text(text + "radio: {range_m: 300.0}\nground_ned_m: [5.0, 6.0, -2.0]\n", encoding="utf-8")
    prepared = launch.prepare(load(far, radio_loss=0.2), tmp_path)
    assert load_ground(tmp_path / "ground.yaml").radio == str(tmp_path / "radio.yaml")
    assert load_drone(tmp_path / "drone-5.yaml").radio == str(tmp_path / "radio.yaml")
    radio = parse((tmp_path / "radio.yaml").read_text(encoding="utf-8"), SharedRadio, "radio.yaml")
    assert radio.model == RadioModel(loss=0.2, range_m=300.0)
    assert radio.placed == (1, 2, 3, 4, 5, "ground")
    assert prepared.draft.fleet.places == radio.places == str(prepared.places)
    with contextlib.closing(NodePlaces(prepared.places)) as places:
        assert [places.of(node) for node in range(6)] == [None] * 5 + [(5.0, 6.0, -2.0)]


def test_a_radio_that_loses_alike_everywhere_needs_no_places(tmp_path: pathlib.Path) -> None:
    prepared = launch.prepare(load(EXAMPLES / "survey.yaml", radio_loss=0.2), tmp_path)
    assert prepared.draft.fleet.places is None
    assert not prepared.places.exists()
    assert (tmp_path / "radio.yaml").exists()


def test_each_survey_gets_a_directory_of_its_own(tmp_path: pathlib.Path) -> None:
    first = launch.make_directory(tmp_path / "out", "crater", NOW)
    second = launch.make_directory(tmp_path / "out", "crater", NOW)
    assert first.name == "crater-20260504-030201"
    assert second.name == "crater-20260504-030201-2"


def test_a_directory_that_cannot_be_made(tmp_path: pathlib.Path) -> None:
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    with pytest.raises(DocumentError, match="choose another --out"):
        launch.make_directory(tmp_path / "out", "crater", NOW)
