"""What ArduCopter's parameters mean for the flight."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Return
from simvehicle.autopilot.missions import StoredItem
from simvehicle.autopilot.parameters import Parameters
from simvehicle.vehicle.controller import Limits
from simvehicle.vehicle.dynamics import Battery


def limits(parameters: Parameters, speed_mps: float | None = None) -> Limits:
    """`speed_mps`: instead of the parameter's."""
    p = parameters
    speed_mps = speed_mps or p["WPNAV_SPEED"] / 100.0
    return Limits(
        speed_mps=speed_mps,
        most_mps=30.0,
        climb_mps=p["WPNAV_SPEED_UP"] / 100.0,
        descent_mps=p["WPNAV_SPEED_DN"] / 100.0,
        acceleration_mps2=max(0.5, p["WPNAV_ACCEL"] / 100.0),
        climb_acceleration_mps2=max(0.5, p["WPNAV_ACCEL_Z"] / 100.0),
        tilt_rad=math.radians(p["ANGLE_MAX"] / 100.0),
        land_mps=p["LAND_SPEED"] / 100.0,
        land_slow_below_m=p["LAND_ALT_LOW"] / 100.0,
        return_speed_mps=p["RTL_SPEED"] / 100.0 or speed_mps,
    )


def battery(parameters: Parameters) -> Battery:
    return Battery(parameters["BATT_CAPACITY"], parameters["SIM_BATT_VOLTAGE"])


def estimates_wind(parameters: Parameters) -> bool:
    """ArduCopter estimates none without its drag parameters."""
    p = parameters
    return bool(p["EK3_DRAG_MCOEF"] or (p["EK3_DRAG_BCOEF_X"] and p["EK3_DRAG_BCOEF_Y"]))


def return_to_launch(parameters: Parameters, flight: Flight, rally: Sequence[StoredItem]) -> Return:
    to_m, down_m = _return_point(parameters, flight, rally)
    return Return(to_m, travel_down_m=down_m, loiter_s=parameters["RTL_LOIT_TIME"] / 1000.0)


def _return_point(p: Parameters, flight: Flight, rally: Sequence[StoredItem]) -> tuple[Vector3, float]:
    """Home or the nearest rally point, and the altitude (local down, m) to go there at."""
    nav = flight.nav
    here = nav.position_m[:2]
    best, above_m = nav.home_m, p["RTL_ALT"] / 100.0
    nearest_m = math.dist(here, best[:2]) if p["RALLY_INCL_HOME"] else math.inf
    for item in rally:
        north, east, _ = flight.vehicle.estimator.local(Geodetic(item.x / 1e7, item.y / 1e7))
        away_m = math.dist(here, (north, east))
        if away_m < nearest_m and away_m <= 1000.0 * p["RALLY_LIMIT_KM"]:
            nearest_m, best, above_m = away_m, (north, east, nav.home_m[2]), item.z
    away_m = math.dist(here, best[:2])
    cone_m = max(2.0, away_m * p["RTL_CONE_SLOPE"]) if p["RTL_CONE_SLOPE"] >= 0.5 else math.inf
    climb_m = nav.above_home_m + p["RTL_CLIMB_MIN"] / 100.0
    return best, nav.home_m[2] - max(climb_m, min(above_m, cone_m))
