"""What simulated vehicles cost: processor time of a fleet with its MAVLink traffic, in this process.

Every vehicle flies circles in GUIDED (or OFFBOARD) under a companion that sends setpoints at 10 Hz and gets the
messages that the agent asks for; a second link carries what a ground station asks for.
"""

from __future__ import annotations

import math
import time
from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks import Figures
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import WindConfig

_COMPANION_HZ = {30: 10, 33: 10, 32: 10, 1: 1, 24: 1, 245: 2, 147: 1, 193: 1, 168: 1, 242: 0.5}
_GROUND_HZ = {33: 2, 30: 2, 1: 1, 245: 1, 242: 0.5}
_FLIGHT_S = 30.0


class _Companion:
    """Messages to one vehicle, packed once a tick as an agent does."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self._vehicle = vehicle
        self._codec: Any = mavlink.MAVLink(None, srcSystem=vehicle.spec.id, srcComponent=191)

    def send(self, message: Any, link: int = 0) -> None:
        self._vehicle.receive(link, bytes(message.pack(self._codec)))

    def command(self, number: int, *params: float, link: int = 0) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(self._vehicle.spec.id, 1, number, 0, *padded), link)

    def circle(self, now_s: float) -> None:
        velocity = (3.0 * math.cos(now_s / 5.0), 3.0 * math.sin(now_s / 5.0), 0.0)
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, self._vehicle.spec.id, 1, 1, 0x0DC7, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
            )
        )


def fleet(count: int, flavour: Literal["ardupilot", "px4"]) -> list[SimulatedVehicle]:
    config = FleetConfig(
        origin=Geodetic(-5.06, 151.3, 500.0),
        vehicles=tuple(
            VehicleSpec(
                id=index + 1,
                flavour=flavour,
                home_east_m=5.0 * index,
                links=("udpout:127.0.0.1:9", "udpout:127.0.0.1:9"),
            )
            for index in range(count)
        ),
        wind=WindConfig(speed_mps=4.0),
        ready_after_s=1.0,
    )
    world = make_world(config)
    return [SimulatedVehicle(spec, world, seed=0, ready_after_s=1.0) for spec in config.vehicles]


def cost(count: int, flavour: Literal["ardupilot", "px4"]) -> tuple[float, float]:
    """Processor seconds per simulated second of the vehicles alone (their input made by us is not counted), and
    messages per simulated second that they sent."""
    vehicles = fleet(count, flavour)
    companions = [_Companion(vehicle) for vehicle in vehicles]
    for vehicle in vehicles:
        for tenth in range(30):
            vehicle.step(0.1 * tenth)
    for companion in companions:
        for link, rates in ((0, _COMPANION_HZ), (1, _GROUND_HZ)):
            for message_id, rate_hz in rates.items():
                companion.command(511, message_id, 1e6 / rate_hz, link=link)
        if flavour == "ardupilot":
            companion.command(176, 1, 4)
        companion.command(400, 1)
        above_m = 15.0 if flavour == "ardupilot" else 515.0  # PX4's is above sea level
        companion.command(22, *([0.0] * 6 if flavour == "ardupilot" else [math.nan] * 6), above_m)
    used_s, sent, now_s = 0.0, 0, 3.0
    for tick in range(int((15.0 + _FLIGHT_S) * 50)):
        now_s = 3.0 + tick * 0.02
        circling = now_s > 12.0 and tick % 5 == 0
        begin_s = time.process_time()
        for vehicle, companion in zip(vehicles, companions, strict=True):
            if circling:
                companion.circle(now_s)
                if flavour == "px4" and tick % 50 == 0 and now_s < 16.0:
                    companion.command(176, 1, 6)
            vehicle.step(now_s)
            frames = vehicle.drain()
            if now_s >= 18.0:
                sent += len(frames)
        if now_s >= 18.0:
            used_s += time.process_time() - begin_s
    flown_s = now_s - 18.0
    assert all(vehicle.airborne for vehicle in vehicles)
    return used_s / flown_s, sent / flown_s


def main() -> None:
    print(f"{'vehicles':>8} {'flavour':>10} {'core at 1x':>11} {'core at 6x':>11} {'messages/s':>11}")
    measured = 0.0
    for count, flavour in ((1, "ardupilot"), (5, "ardupilot"), (20, "ardupilot"), (20, "px4")):
        share, messages = cost(count, flavour)  # type: ignore[arg-type]
        print(f"{count:>8} {flavour:>10} {share:>10.1%} {6 * share:>10.1%} {messages:>11.0f}")
        if count == 20:
            measured = max(measured, share)
    figures = Figures()
    figures.show("20 vehicles at speed-up 1", 100.0 * measured, "% of core", most=40.0)
    figures.leave()


if __name__ == "__main__":
    main()
