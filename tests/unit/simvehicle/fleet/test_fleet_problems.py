"""What of a fleet's file cannot be run, known before anything is opened."""

from __future__ import annotations

import pytest

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import problems


def told(*links: tuple[str, ...]) -> list[str]:
    vehicles = tuple(VehicleSpec(id=index, links=each) for index, each in enumerate(links, 1))
    return [
        str(error) for error in problems(FleetConfig(origin=Geodetic(-5.06, 151.3, 500.0), vehicles=vehicles))
    ]


@pytest.mark.parametrize("link", ["tcpin:127.0.0.1:5760", "udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600"])
def test_two_vehicles_cannot_have_one_port(link: str) -> None:
    (problem,) = told((link,), ("udpout:127.0.0.1:14540", link))
    assert problem.startswith(f"vehicles[1].links[1]: {link} stands twice: vehicles[0].links[0] has that")


def test_all_vehicles_may_send_to_one_place() -> None:
    assert told(("udpout:127.0.0.1:14550",), ("udpout:127.0.0.1:14550",)) == []
