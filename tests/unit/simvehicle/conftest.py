"""A ground station for the simulated vehicles, in the same process and on a simulated clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import WindConfig

ORIGIN = Geodetic(-5.06, 151.3, 500.0)


class Ground:
    """Flies one vehicle: what is sent goes out at once, what comes back is kept by link."""

    def __init__(self, vehicle: SimulatedVehicle, system: int = 255, component: int = 190) -> None:
        self.vehicle = vehicle
        self.now_s = 0.0
        self.heard: list[Any] = []
        self.heard_by_link: dict[int, list[Any]] = {}
        self._codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._parsers: dict[int, Any] = {}
        self.heartbeats = True
        vehicle.step(0.0)

    def send(self, message: Any, link: int = 0, sender: tuple[int, int] | None = None) -> None:
        codec = self._codec if sender is None else mavlink.MAVLink(None, *sender)
        self.vehicle.receive(link, bytes(message.pack(codec)))
        self.listen()

    def listen(self) -> None:
        for link, data in self.vehicle.drain():
            if link not in self._parsers:
                self._parsers[link] = mavlink.MAVLink(None)
                self._parsers[link].robust_parsing = True
            for message in self._parsers[link].parse_buffer(data) or ():
                assert message.get_type() != "BAD_DATA"
                if link == 0:
                    self.heard.append(message)
                self.heard_by_link.setdefault(link, []).append(message)

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        """Let time pass; `each` is called ten times a second."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-6:
            if self.heartbeats and math.floor(self.now_s) != math.floor(self.now_s + 0.1):
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            if each is not None:
                each()
            self.now_s += 0.1
            self.vehicle.step(self.now_s)
            self.listen()

    def run_until(self, done: Callable[[], bool], limit_s: float = 120.0, **options: Any) -> None:
        end_s = self.now_s + limit_s
        while not done():
            assert self.now_s < end_s, f"not within {limit_s} s; texts: {self.texts()[-5:]}"
            self.run(0.1, **options)

    def command(self, number: int, *params: float, link: int = 0) -> int:
        """MAV_RESULT of a COMMAND_LONG."""
        padded = [*params, *[0.0] * (7 - len(params))]
        before = len(self.heard_by_link.get(link, ()))
        self.send(mavlink.MAVLink_command_long_message(self.vehicle.spec.id, 1, number, 0, *padded), link)
        (answer,) = [
            m
            for m in self.heard_by_link[link][before:]
            if m.get_type() == "COMMAND_ACK" and m.command == number
        ]
        return int(answer.result)

    def command_int(self, number: int, frame: int, *params: float) -> int:
        """MAV_RESULT of a COMMAND_INT; the last three of seven parameters are latitude, longitude, altitude."""
        p1, p2, p3, p4, latitude_deg, longitude_deg, z = params
        before = len(self.heard)
        x, y = round(latitude_deg * 1e7), round(longitude_deg * 1e7)
        self.send(
            mavlink.MAVLink_command_int_message(
                self.vehicle.spec.id, 1, frame, number, 0, 0, p1, p2, p3, p4, x, y, z
            )
        )
        (answer,) = [m for m in self.heard[before:] if m.get_type() == "COMMAND_ACK" and m.command == number]
        return int(answer.result)

    def of(self, kind: str) -> list[Any]:
        return [message for message in self.heard if message.get_type() == kind]

    def texts(self) -> list[str]:
        """Whole ones, without PX4's tab behind those that are events too."""
        texts: list[str] = []
        for message in self.of("STATUSTEXT"):
            if message.id and message.chunk_seq:
                texts[-1] += message.text
            else:
                texts.append(message.text)
        return [text.removesuffix("\t") for text in texts]

    def mode(self, *params: float) -> int:
        return self.command(176, 1.0, *params)

    def position_target(self, north_m: float, east_m: float, down_m: float) -> None:
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, self.vehicle.spec.id, 1, 1, 0x0DF8, north_m, east_m, down_m, *[0.0] * 8
            )
        )

    def velocity_target(self, north_mps: float, east_mps: float, down_mps: float, frame: int = 1) -> None:
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, self.vehicle.spec.id, 1, frame, 0x0DC7, 0, 0, 0, north_mps, east_mps, down_mps, *[0.0] * 5
            )
        )

    def set_parameter(self, name: str, value: float, kind: int = 9) -> None:
        self.send(mavlink.MAVLink_param_set_message(self.vehicle.spec.id, 1, name.encode(), value, kind))

    def take_off(self, above_m: float = 10.0) -> None:
        """Ready, armed and at a height, in GUIDED or Hold."""
        self.run_until(lambda: self.vehicle.ready)
        self.run(1.0)
        if self.vehicle.spec.flavour == "ardupilot":
            assert self.mode(4) == 0
            assert self.command(400, 1) == 0
            assert self.command(22, 0, 0, 0, 0, 0, 0, above_m) == 0
        else:
            assert self.command(400, 1) == 0
            nan = math.nan
            assert self.command(22, nan, nan, nan, nan, nan, nan, ORIGIN.amsl_m + above_m) == 0
        within_m = 0.3 if self.vehicle.spec.flavour == "ardupilot" else 0.9  # PX4 stops as soon as it is near
        self.run_until(
            lambda: self.above_m > above_m - within_m and abs(self.vehicle.velocity_ned_mps[2]) < 0.2
        )
        self.run(2.0)

    @property
    def above_m(self) -> float:
        return -self.vehicle.position_ned_m[2]


@pytest.fixture
def make_ground() -> Callable[..., Ground]:
    """make_ground(flavour, wind_mps=…, ready_after_s=…, links=…, seed=…, PARAMETER=…)"""

    def make(
        flavour: str,
        *,
        wind_mps: float = 4.0,
        gust_sd_mps: float = 0.3,
        ready_after_s: float = 5.0,
        links: int = 1,
        seed: int = 1,
        **parameters: float,
    ) -> Ground:
        spec = VehicleSpec(
            id=7,
            flavour=flavour,  # type: ignore[arg-type]
            links=("udpout:127.0.0.1:9",) * links,
            parameters=parameters,
        )
        config = FleetConfig(
            origin=ORIGIN,
            vehicles=(spec,),
            wind=WindConfig(speed_mps=wind_mps, from_deg=180.0, gust_sd_mps=gust_sd_mps),
            ready_after_s=ready_after_s,
        )
        return Ground(SimulatedVehicle(spec, make_world(config), seed=seed, ready_after_s=ready_after_s))

    return make
