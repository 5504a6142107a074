"""A world is made from its file alone."""

from __future__ import annotations

import pytest

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import GaussianPlume


def fleet(**changes: object) -> FleetConfig:
    values: dict[str, object] = {
        "origin": Geodetic(14.38, -90.6, 2400.0),
        "vehicles": (VehicleSpec(id=1, links=("udpout:127.0.0.1:14541",)),),
        "plume": GaussianPlume(source_north_m=10.0, source_east_m=20.0),
        "seed": 5,
    }
    return FleetConfig(**(values | changes))  # type: ignore[arg-type]


def test_equal_files_make_equal_worlds() -> None:
    one, other = make_world(fleet()), make_world(fleet())
    point = (30.0, 10.0, -10.0)
    assert one.wind.wind_ned_mps(point, 100.0) == other.wind.wind_ned_mps(point, 100.0)
    assert one.co2_ppm(point, 100.0) == other.co2_ppm(point, 100.0)
    assert one.frame.identity == other.frame.identity


def test_without_a_plume_the_air_is_background() -> None:
    assert make_world(fleet(plume=None)).co2_ppm((0.0, 0.0, -10.0), 0.0) == 420.0


def test_the_plume_lies_where_the_wind_goes() -> None:
    world = make_world(fleet())  # the default wind comes from the east
    assert world.co2_ppm((10.0, -30.0, -10.0), 0.0) > 425.0 > world.co2_ppm((10.0, 70.0, -10.0), 0.0)
    assert world.gas.source_ned_m == pytest.approx((10.0, 20.0, -10.0))
