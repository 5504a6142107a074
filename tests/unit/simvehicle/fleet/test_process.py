"""The fleet: configurations that cannot be run, faults at their times, the truth file, instruments over TCP."""

from __future__ import annotations

import contextlib
import csv
import itertools
import pathlib
import socket
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.transport.node_places import NodePlaces
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import FleetError
from simvehicle.fleet.process import Fleet
from simvehicle.fleet.truth import COLUMNS, read_tracks
from simvehicle.survey.ports import free_port


def config(**changes: Any) -> FleetConfig:
    fleet = FleetConfig(
        origin=Geodetic(-5.06, 151.3, 500.0),
        vehicles=(VehicleSpec(id=1, links=(f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}",)),),
        ready_after_s=2.0,
    )
    return msgspec.structs.replace(fleet, **changes)


def refused(fleet_config: FleetConfig) -> FleetError:
    with pytest.raises(FleetError) as caught:
        Fleet(fleet_config)
    return caught.value


def test_two_vehicles_with_one_id() -> None:
    vehicle = VehicleSpec(id=4, links=("udpout:127.0.0.1:9",))
    error = refused(config(vehicles=(vehicle, vehicle)))
    assert error.field == "vehicles[1].id"
    assert "4" in error.problem


def test_a_port_in_use_leaves_nothing_open() -> None:
    first, second = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
    vehicles = tuple(
        VehicleSpec(id=n + 1, links=(f"udpin:127.0.0.1:{port}",)) for n, port in enumerate((first, second))
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", second))
        error = refused(config(vehicles=vehicles))
        assert error.field == "vehicles[1].links[0]"
        assert str(second) in error.problem
        assert "\n" not in str(error)
    fleet = Fleet(config(vehicles=vehicles))  # the first port was given back
    fleet.close()


@pytest.mark.parametrize(
    ("vehicle", "field"),
    [
        ({"links": ("carrier pigeon",)}, "vehicles[0].links[0]"),
        ({"parameters": {"NO_SUCH": 1.0}}, "vehicles[0].parameters"),
        (
            {"instruments": (EmulatedInstrument(name="co2", type="nose", port="127.0.0.1:0"),)},
            "vehicles[0].instruments[0].type",
        ),
        (
            {"instruments": (EmulatedInstrument(name="co2", type="sba5", port="nowhere"),)},
            "vehicles[0].instruments[0].port",
        ),
    ],
)
def test_vehicles_that_cannot_be(vehicle: dict[str, Any], field: str) -> None:
    spec = msgspec.structs.replace(VehicleSpec(id=1, links=("udpout:127.0.0.1:9",)), **vehicle)
    assert refused(config(vehicles=(spec,))).field == field


@pytest.mark.parametrize(
    ("fault", "field"),
    [
        (FaultSpec(drone=9, at_s=1.0, kind="motor"), "faults[0].drone"),
        (FaultSpec(drone=1, at_s=1.0, kind="unplug", instrument="co2"), "faults[0].instrument"),
        (FaultSpec(drone=1, at_s=5.0, kind="silence", until_s=2.0), "faults[0].until_s"),
    ],
)
def test_faults_that_cannot_be(fault: FaultSpec, field: str) -> None:
    assert refused(config(faults=(fault,))).field == field


def test_a_truth_file_that_cannot_be_written(tmp_path: pathlib.Path) -> None:
    assert refused(config(truth=str(tmp_path / "no" / "such" / "t.csv"))).field == "truth"


class Flown:
    """A fleet of one, flown by its own autopilot object instead of over its sockets."""

    def __init__(self, fleet_config: FleetConfig) -> None:
        self.fleet = Fleet(fleet_config)
        self.vehicle = self.fleet.drones.by_id[1].vehicle
        self.now_s = 0.0
        self._codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.run(4.0)
        for number, *params in ((176, 1, 4), (400, 1), (22, 0, 0, 0, 0, 0, 0, 10)):
            padded = [*params, *[0] * (7 - len(params))]
            message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded)
            self.vehicle.receive(0, bytes(message.pack(self._codec)))

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += 0.02
            self.fleet.step(self.now_s)

    def until_takeoff(self) -> None:
        while self.fleet.drones.first_takeoff_s is None:
            assert self.now_s < 20.0
            self.run(0.1)


def test_faults_come_after_the_takeoff_and_mend(tmp_path: pathlib.Path) -> None:
    faults = (
        FaultSpec(drone=1, at_s=2.0, kind="gps_loss", until_s=4.0),
        FaultSpec(drone=1, at_s=3.0, kind="silence", until_s=5.0),
        FaultSpec(drone=1, at_s=6.0, kind="battery_low"),
        FaultSpec(drone=1, at_s=14.0, kind="motor"),
    )
    flown = Flown(config(faults=faults, truth=str(tmp_path / "truth.csv")))
    try:
        flown.run(1.5)
        assert flown.vehicle.autopilot.vehicle.estimator.gps
        flown.until_takeoff()
        seen = []
        for _ in range(16):
            flown.run(1.0)
            autopilot = flown.vehicle.autopilot
            seen.append(
                (autopilot.vehicle.estimator.gps, autopilot.silent, flown.vehicle.battery_fraction > 0.5)
            )
        assert seen[:6] == [
            (True, False, True),
            (False, False, True),
            (False, True, True),
            (True, True, True),
            (True, False, True),
            (True, False, False),
        ]
        flown.run(4.0)
        assert not flown.vehicle.airborne
        assert flown.vehicle.autopilot.flight.crashed
        assert flown.vehicle.armed  # an ArduCopter that falls flat takes it for no crash
    finally:
        flown.fleet.close()


def test_truth_is_written_ten_times_a_second(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "truth.csv"
    flown = Flown(config(truth=str(path)))
    try:
        flown.until_takeoff()
        flown.run(8.0)
        (track,) = read_tracks(path).values()  # readable while it is written
        assert track.time_s[-1] > 5.0
    finally:
        flown.fleet.close()
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    times = [float(row["time_s"]) for row in rows]
    assert len(rows) == pytest.approx(flown.now_s * 10, abs=2)
    assert all(0.07 < after - before < 0.13 for before, after in itertools.pairwise(times))
    last = rows[-1]
    assert (last["mode"], last["airborne"], last["armed"]) == ("GUIDED", "1", "1")
    assert float(last["down_m"]) == pytest.approx(flown.vehicle.position_ned_m[2], abs=0.5)
    assert float(last["co2_ppm"]) == pytest.approx(420.0)


def test_the_nodes_radio_is_told_where_the_vehicles_are(tmp_path: pathlib.Path) -> None:
    with contextlib.closing(NodePlaces.make(tmp_path / "places", 2)) as places:
        flown = Flown(config(places=str(tmp_path / "places")))
        try:
            flown.until_takeoff()
            flown.run(8.0)
            assert places.of(0) == flown.vehicle.position_ned_m
            assert places.of(1) is None, "the ground station's is none of the vehicles'"
        finally:
            flown.fleet.close()


def test_a_file_for_places_that_has_no_room(tmp_path: pathlib.Path) -> None:
    assert refused(config(places=str(tmp_path / "none"))).field == "places"
    NodePlaces.make(tmp_path / "places", 1).close()
    vehicles = tuple(VehicleSpec(id=d, links=("udpout:127.0.0.1:9",)) for d in (1, 2))
    assert "room" in refused(config(places=str(tmp_path / "places"), vehicles=vehicles)).problem


def test_instruments_speak_until_they_are_unplugged_and_again_afterwards() -> None:
    port = free_port()
    instrument = EmulatedInstrument(name="co2", type="sba5", port=f"127.0.0.1:{port}")
    vehicle = VehicleSpec(id=1, links=("udpout:127.0.0.1:9",), instruments=(instrument,))
    fault = FaultSpec(drone=1, at_s=3.0, kind="unplug", instrument="co2", until_s=6.0)
    flown = Flown(config(vehicles=(vehicle,), faults=(fault,)))

    def talk(client: socket.socket) -> bytes:
        client.settimeout(0.0)
        heard = b""
        for _ in range(20):
            client.sendall(b"M")
            flown.run(0.2)
            try:
                data = client.recv(4096)
            except BlockingIOError:
                continue
            if not data:
                return heard
            heard += data
        return heard

    try:
        with socket.create_connection(("127.0.0.1", port)) as client:
            assert b"M " in talk(client)
            flown.until_takeoff()
            flown.run(3.5)
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", port))
        flown.run(4.0)
        with socket.create_connection(("127.0.0.1", port)) as client:
            assert b"M " in talk(client)
    finally:
        flown.fleet.close()


def test_keys_and_usb_ports_that_are_none(tmp_path: pathlib.Path) -> None:
    link = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    unkeyed = VehicleSpec(id=1, links=(link,), signing_key=str(tmp_path / "absent"))
    error = refused(config(vehicles=(unkeyed,)))
    assert error.field == "vehicles[0].signing_key"
    assert "No such file" in error.problem
    assert refused(config(vehicles=(VehicleSpec(id=1, links=(link,), usb_links=(1,)),))).field == (
        "vehicles[0].usb_links"
    )
