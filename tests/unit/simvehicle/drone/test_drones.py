"""The core of a simulation: drones, instruments and faults on one grid, by bytes."""

from __future__ import annotations

import re

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic
from sensors.instruments.checksums import modbus_crc
from sensors.instruments.sensor_error import SensorError
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.drone.drones import Drone, DroneBytes, SimulatedDrones
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.world.atmosphere import air_pressure_pa
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import GaussianPlume, WorldConfig

READY_S = 2.0


def simulation(
    seed: int = 1, types: tuple[str, ...] = ("sba5", "trisonica"), faults: tuple[FaultSpec, ...] = ()
) -> SimulatedDrones:
    world = make_world(
        WorldConfig(
            origin=Geodetic(-5.06, 151.3, 500.0),
            plume=GaussianPlume(source_north_m=5.0, source_east_m=0.0, vent_sd_m=20.0),
            seed=seed,
        )
    )
    instruments = tuple(EmulatedInstrument(name=kind, type=kind, port="") for kind in types)
    specs = [VehicleSpec(id=n, home_east_m=5.0 * n, links=("",), instruments=instruments) for n in (1, 2)]
    return SimulatedDrones(
        [
            Drone(spec, SimulatedVehicle(spec, world, seed=seed, ready_after_s=READY_S), seed)
            for spec in specs
        ],
        world,
        faults,
    )


def packed(number: int, *params: float, drone: int = 1) -> bytes:
    padded = [*params, *[0.0] * (7 - len(params))]
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    return bytes(mavlink.MAVLink_command_long_message(drone, 1, number, 0, *padded).pack(codec))


_READ_ALL = b"\xfe\x04\x00\x00\x00\x04"
QUESTION = _READ_ALL + modbus_crc(_READ_ALL)
"""Of a K30: its four registers."""
TAKE_OFF = DroneBytes(links=((0, packed(176, 1, 4) + packed(400, 1) + packed(22, 0, 0, 0, 0, 0, 0, 10)),))


class Flown:
    """Everything that was said, by drone and wire."""

    def __init__(self, drones: SimulatedDrones, period_s: float = 0.1) -> None:
        self.drones = drones
        self.period_s = period_s
        self.steps = 0
        self.links: dict[int, bytearray] = {1: bytearray(), 2: bytearray()}
        self.lines: dict[tuple[int, str], bytearray] = {}
        self.step()

    @property
    def now_s(self) -> float:
        return self.steps * self.period_s

    def step(self, **arrived: DroneBytes) -> None:
        said = self.drones.step(self.now_s, {int(name[1:]): data for name, data in arrived.items()})
        self.steps += 1
        for drone, data in said.items():
            for _, frame in data.links:
                self.links[drone] += frame
            for name, text in data.instruments:
                self.lines.setdefault((drone, name), bytearray()).extend(text)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.period_s)):
            self.step()

    def take_off(self) -> None:
        self.run(3.0)
        self.step(d1=TAKE_OFF)
        self.run(8.0)
        assert self.drones.by_id[1].vehicle.airborne


def test_bytes_are_the_same_whatever_the_steps_are() -> None:
    faults = (FaultSpec(drone=1, at_s=1.5, kind="unplug", instrument="trisonica", until_s=3.0),)
    coarse, fine = Flown(simulation(faults=faults), 0.1), Flown(simulation(faults=faults), 0.02)
    for flown in (coarse, fine):
        flown.run(3.0)
        flown.step(d1=TAKE_OFF)
        while flown.steps * flown.period_s < 12.0 - 1e-9:
            flown.step()
    assert coarse.drones.first_takeoff_s == pytest.approx(fine.drones.first_takeoff_s)
    ends = min(len(coarse.links[1]), len(fine.links[1]))
    assert ends > 500
    assert coarse.links[1][:ends] == fine.links[1][:ends]
    heard = [bytes(flown.lines[1, "trisonica"]) for flown in (coarse, fine)]
    ends = min(map(len, heard))
    assert ends > 2000
    assert heard[0][:ends] == heard[1][:ends]


def test_equal_seeds_give_equal_bytes_and_others_do_not() -> None:
    heard = []
    for seed in (3, 3, 4):
        flown = Flown(simulation(seed))
        flown.run(3.0)
        heard.append(bytes(flown.lines[1, "trisonica"]))
        assert heard[-1] != bytes(flown.lines[2, "trisonica"]), "each instrument has noise of its own"
    assert heard[0] == heard[1] != heard[2]


def test_instruments_are_in_the_air_of_the_vehicles_altitude() -> None:
    flown = Flown(simulation(types=("li850",)))
    flown.take_off()
    flown.run(4.0)
    pressures = re.findall(rb"<cellpres>([0-9.e]+)</cellpres>", flown.lines[1, "li850"])
    ground_pa, above_pa = air_pressure_pa(500.0), air_pressure_pa(510.0)
    assert 1000.0 * float(pressures[0]) == pytest.approx(ground_pa, abs=1.0)
    assert 1000.0 * float(pressures[-1]) == pytest.approx(above_pa, abs=15.0)
    assert above_pa < ground_pa - 100.0


def test_a_question_is_answered_within_the_step_that_follows_it() -> None:
    flown = Flown(simulation(types=("k30",)))
    flown.run(1.0)
    assert not flown.lines, "it speaks when it is asked"
    flown.step(d1=DroneBytes(instruments=(("k30", QUESTION),)))
    assert flown.lines[1, "k30"].startswith(b"\xfe\x04\x08")
    assert (2, "k30") not in flown.lines, "the other one was not asked"


def test_faults_count_from_the_first_takeoff_and_an_unplugged_line_says_nothing() -> None:
    fault = FaultSpec(drone=1, at_s=2.0, kind="unplug", instrument="trisonica", until_s=4.0)
    flown = Flown(simulation(faults=(fault,)))
    flown.run(5.0)
    assert flown.drones.first_takeoff_s is None
    assert flown.drones.by_id[1].lines.is_plugged("trisonica")
    flown.step(d1=TAKE_OFF)
    while flown.drones.first_takeoff_s is None:
        assert flown.now_s < 15.0
        flown.step()
    flown.run(2.2)
    assert not flown.drones.by_id[1].lines.is_plugged("trisonica")
    assert flown.drones.by_id[2].lines.is_plugged("trisonica")
    silent = len(flown.lines[1, "trisonica"])
    flown.run(1.0)
    assert len(flown.lines[1, "trisonica"]) == silent
    flown.run(1.0)
    assert flown.drones.by_id[1].lines.is_plugged("trisonica")
    assert len(flown.lines[1, "trisonica"]) > silent


def test_what_is_sent_to_an_unplugged_instrument_is_lost() -> None:
    flown = Flown(simulation(types=("k30",)))
    flown.run(1.0)
    flown.drones.by_id[1].set_plugged("k30", False)
    flown.step(d1=DroneBytes(instruments=(("k30", QUESTION),)))
    flown.drones.by_id[1].set_plugged("k30", True)
    flown.run(1.0)
    assert not flown.lines


@pytest.mark.parametrize("kind", ["gps_loss", "battery_low", "motor", "tumble", "silence"])
def test_faults_reach_the_vehicle(kind: str) -> None:
    fault = FaultSpec(drone=1, at_s=8.0, kind=kind)  # type: ignore[arg-type]
    flown = Flown(simulation(faults=(fault,)))
    flown.take_off()
    before = len(flown.links[1])
    flown.run(12.0)
    vehicle = flown.drones.by_id[1].vehicle
    seen = {
        "gps_loss": not vehicle.autopilot.vehicle.estimator.gps,  # type: ignore[attr-defined]
        "battery_low": vehicle.battery_fraction < 0.2,
        "motor": not vehicle.airborne,
        "silence": len(flown.links[1]) - before < 200,
    }
    assert {name for name, is_so in seen.items() if is_so} == {"motor" if kind == "tumble" else kind}
    assert (abs(vehicle.attitude_rad[0]) > 3.0) is (kind == "tumble")


def test_an_instrument_that_cannot_be_emulated_is_refused() -> None:
    with pytest.raises(SensorError):
        simulation(types=("nose",))
