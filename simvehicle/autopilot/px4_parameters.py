"""What PX4's parameters mean for the flight."""

from __future__ import annotations

import math

from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import Return
from simvehicle.autopilot.parameters import Parameters
from simvehicle.vehicle.controller import Limits
from simvehicle.vehicle.dynamics import Battery


def limits(parameters: Parameters, speed_mps: float | None = None) -> Limits:
    """`speed_mps`: instead of the parameter's."""
    p = parameters
    speed_mps = speed_mps or p["MPC_XY_CRUISE"]
    return Limits(
        speed_mps=speed_mps,
        most_mps=p["MPC_XY_VEL_MAX"],
        climb_mps=p["MPC_Z_VEL_MAX_UP"],
        descent_mps=p["MPC_Z_VEL_MAX_DN"],
        acceleration_mps2=max(0.5, p["MPC_ACC_HOR"]),
        climb_acceleration_mps2=max(0.5, min(p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"])),
        tilt_rad=math.radians(p["MPC_TILTMAX_AIR"]),
        land_mps=p["MPC_LAND_SPEED"],
        land_slow_below_m=p["MPC_LAND_ALT2"],
        return_speed_mps=speed_mps,
        land_slows_from_m=p["MPC_LAND_ALT1"],
        crawl_mps=p["MPC_LAND_CRWL"],
        crawl_below_m=p["MPC_LAND_ALT3"],
    )


def battery(parameters: Parameters) -> Battery:
    p = parameters
    return Battery(p["BAT1_CAPACITY"], p["BAT1_N_CELLS"] * p["BAT1_V_CHARGED"])


def return_to_launch(parameters: Parameters, flight: Flight) -> Return:
    p, nav = parameters, flight.nav
    away_m = math.dist(nav.position_m[:2], nav.home_m[:2])
    cone_rad = math.radians(p["RTL_CONE_ANG"])
    highest_m = p["RTL_RETURN_ALT"]
    if away_m < p["RTL_MIN_DIST"]:
        highest_m = p["RTL_DESCEND_ALT"]
    elif 0.0 < cone_rad < math.radians(85.0):
        highest_m = max(p["RTL_DESCEND_ALT"], min(highest_m, away_m / math.tan(cone_rad)))
    highest_m = min(highest_m, p["RTL_RETURN_ALT"])
    travel_m = max(nav.above_home_m, highest_m)
    return Return(
        nav.home_m,
        travel_down_m=nav.home_m[2] - travel_m,
        loiter_s=max(0.0, p["RTL_LAND_DELAY"]),
        loiter_down_m=nav.home_m[2] - min(travel_m, p["RTL_DESCEND_ALT"]),
    )
