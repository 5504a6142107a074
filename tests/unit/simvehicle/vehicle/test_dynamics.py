"""The body and its position controller: limits are kept, wind is leant into, the ground holds."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from simvehicle.vehicle.controller import Limits, Motion, PositionController, approach_mps
from simvehicle.vehicle.dynamics import (
    DRAG_PER_S,
    GRAVITY_MPS2,
    Battery,
    Multirotor,
    attitude_of,
    in_body,
    quaternion_of,
)
from simvehicle.vehicle.estimator import Estimator
from simvehicle.vehicle.vehicle import make_vehicle
from simvehicle.world.configured import make_world
from simvehicle.world.world_config import BoundaryLayerWindConfig, ThermalsConfig, WorldConfig

LIMITS = Limits(
    speed_mps=8.0,
    most_mps=15.0,
    climb_mps=2.5,
    descent_mps=1.5,
    acceleration_mps2=2.5,
    climb_acceleration_mps2=1.0,
    tilt_rad=math.radians(30.0),
    land_mps=0.5,
    land_slow_below_m=10.0,
    return_speed_mps=8.0,
)
DT_S = 0.02


def fly(body: Multirotor, motion: Motion, seconds: float, wind: Vector3 = (0.0, 0.0, 0.0)) -> list[Vector3]:
    """Perfect knowledge of the state; returns the velocities."""
    control, velocities = PositionController(), []
    for _ in range(int(seconds / DT_S)):
        position = body.position[0], body.position[1], body.position[2]
        velocity = body.velocity[0], body.velocity[1], body.velocity[2]
        body.step(DT_S, control.step(DT_S, motion, position, velocity, LIMITS), motion.yaw_rad, wind)
        velocities.append((body.velocity[0], body.velocity[1], body.velocity[2]))
    return velocities


def hovering(above_m: float = 20.0) -> Multirotor:
    body = Multirotor((0.0, 0.0, -above_m))
    body.on_ground = False
    body.thrust = [0.0, 0.0, -GRAVITY_MPS2]
    return body


def test_stays_on_the_ground_until_the_thrust_carries_it() -> None:
    body = Multirotor((1.0, 2.0, 0.0))
    for _ in range(100):
        body.step(DT_S, (0.0, 0.0, -0.9 * GRAVITY_MPS2), None, (10.0, 0.0, 0.0))
    assert body.on_ground
    assert body.position == [1.0, 2.0, 0.0]


def test_leans_into_the_wind_by_the_drag() -> None:
    body = hovering()
    motion = Motion(horizontal_m=(0.0, 0.0), down_m=-20.0, yaw_rad=0.0)
    fly(body, motion, 20.0, wind=(6.0, 0.0, 0.0))
    assert math.dist(body.position, (0.0, 0.0, -20.0)) < 0.1
    roll, pitch, _ = body.attitude_rad
    # wind to the north pushes from behind: nose up
    assert math.degrees(pitch) == pytest.approx(
        math.degrees(math.atan(6.0 * DRAG_PER_S / GRAVITY_MPS2)), abs=0.3
    )
    assert abs(roll) < 0.01


def test_without_control_the_wind_takes_it_along() -> None:
    body = hovering()
    fly(body, Motion(level=True, down_m=-20.0), 30.0, wind=(0.0, 4.0, 0.0))
    assert body.velocity[1] == pytest.approx(4.0, abs=0.1)


def test_rising_air_carries_a_part_of_the_weight_and_sinking_air_adds_to_it() -> None:
    throttles = []
    for down_mps in (-3.0, 0.0, 3.0):
        body = hovering()
        fly(body, Motion(horizontal_m=(0.0, 0.0), down_m=-20.0), 20.0, wind=(0.0, 0.0, down_mps))
        assert body.position[2] == pytest.approx(-20.0, abs=0.2)
        throttles.append(body.throttle_fraction)
    share = 3.0 * DRAG_PER_S / GRAVITY_MPS2
    assert [throttle / throttles[1] for throttle in throttles] == pytest.approx(
        [1.0 - share, 1.0, 1.0 + share], rel=0.01
    )


def test_a_vehicle_feels_the_thermal_that_it_hovers_in() -> None:
    wind = BoundaryLayerWindConfig(speed_mps=0.0, thermals=ThermalsConfig(convective_mps=4.0, life_s=36000.0))
    world = make_world(WorldConfig(origin=Geodetic(-5.06, 151.3, 500.0), wind=wind, seed=2))
    places = [(10.0 * row, 10.0 * column, -40.0) for row in range(70) for column in range(70)]
    up_mps = -world.wind.winds_ned_mps(np.array(places), 0.0)[:, 2]
    used = []
    for index in (int(up_mps.argmin()), int(up_mps.argmax())):
        home = places[index]
        vehicle = make_vehicle(world, home, Battery(5000.0), system=1, seed=1)
        vehicle.body.on_ground = False
        vehicle.body.thrust = [0.0, 0.0, -GRAVITY_MPS2]
        hold = Motion(horizontal_m=(0.0, 0.0), down_m=0.0)  # of its home
        for tick in range(1000):
            vehicle.look_at_wind(tick * DT_S)
            vehicle.sense(tick * DT_S, DT_S)
            vehicle.move(DT_S, hold, LIMITS)
            vehicle.battery.step(DT_S, True, vehicle.body.thrust)
        used.append(1.0 - vehicle.battery.fraction)
    assert up_mps.max() > 1.5
    assert used[1] < 0.95 * used[0]


@settings(max_examples=25, deadline=None)
@given(
    north=st.floats(-200.0, 200.0),
    east=st.floats(-200.0, 200.0),
    up=st.floats(2.0, 60.0),
    wind=st.floats(-8.0, 8.0),
)
def test_position_targets_are_reached_within_the_limits(
    north: float, east: float, up: float, wind: float
) -> None:
    body = hovering()
    velocities = fly(body, Motion(horizontal_m=(north, east), down_m=-up), 75.0, wind=(wind, 0.0, 0.0))
    assert math.dist(body.position, (north, east, -up)) < 0.3
    assert max(math.hypot(v[0], v[1]) for v in velocities) < LIMITS.speed_mps * 1.15 + abs(wind) * 0.2
    assert max(-v[2] for v in velocities) < LIMITS.climb_mps * 1.15
    assert max(v[2] for v in velocities) < LIMITS.descent_mps * 1.15


@pytest.mark.parametrize("wind_mps", [0.0, 12.0, 40.0])
def test_it_never_leans_more_than_the_limit(wind_mps: float) -> None:
    """Also where it goes down at the same time and little thrust points up; too strong a wind takes it along."""
    body, control = hovering(), PositionController()
    there = Motion(horizontal_mps=(12.0, 0.0), down_mps=1.5)
    back = Motion(horizontal_mps=(-12.0, 0.0), down_mps=-2.5)
    limits = dataclasses.replace(LIMITS, acceleration_mps2=5.0, climb_acceleration_mps2=4.0)
    for tick in range(1000):
        position = body.position[0], body.position[1], body.position[2]
        velocity = body.velocity[0], body.velocity[1], body.velocity[2]
        motion = there if tick // 200 % 2 else back
        thrust = control.step(DT_S, motion, position, velocity, limits)
        body.step(DT_S, thrust, None, (wind_mps, 0.0, 0.0))
        north, east, down = body.thrust
        assert math.atan2(math.hypot(north, east), -down) <= limits.tilt_rad + 1e-9
    assert (body.velocity[0] > 2.0) == (wind_mps == 40.0)


def test_velocity_targets_are_reached_in_about_a_second() -> None:
    body = hovering()
    velocities = fly(body, Motion(horizontal_mps=(0.0, 2.0), down_mps=0.0), 4.0)
    assert velocities[60][1] > 1.6
    assert velocities[-1][1] == pytest.approx(2.0, abs=0.1)


def test_a_stopped_motor_lets_it_fall() -> None:
    body = hovering(20.0)
    body.failed = True
    fly(body, Motion(horizontal_m=(0.0, 0.0), down_m=-20.0), 3.0)
    assert body.on_ground
    assert body.impact_mps is not None
    assert body.impact_mps > 10.0


def test_approach_ends_at_the_point_and_joins_smoothly() -> None:
    assert approach_mps(0.0, 10.0, 1.5) == 0.0
    assert approach_mps(1000.0, 10.0, 1.5) == 10.0
    below, above = approach_mps(1.4999, 10.0, 1.5), approach_mps(1.5001, 10.0, 1.5)
    assert below == pytest.approx(above, abs=1e-3)


@given(
    roll=st.floats(-1.0, 1.0),
    pitch=st.floats(-1.0, 1.0),
    yaw=st.floats(-3.0, 3.0),
    thrust=st.floats(3.0, 20.0),
)
def test_attitude_and_quaternion_agree_with_the_thrust(
    roll: float, pitch: float, yaw: float, thrust: float
) -> None:
    w, x, y, z = quaternion_of((roll, pitch, yaw))
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
    # the third column of the rotation matrix, times minus the thrust
    up = [
        -thrust * (2.0 * (x * z + w * y)),
        -thrust * (2.0 * (y * z - w * x)),
        -thrust * (1.0 - 2.0 * (x * x + y * y)),
    ]
    assert attitude_of(up, yaw) == pytest.approx((roll, pitch, yaw), abs=1e-9)
    assert in_body((up[0], up[1], up[2]), (roll, pitch, yaw)) == pytest.approx((0.0, 0.0, -thrust), abs=1e-9)


def test_battery_lasts_about_half_an_hour_of_hovering() -> None:
    battery = Battery(10_000.0)
    seconds = 0
    while battery.fraction > 0.0:
        battery.step(1.0, True, [0.0, 0.0, -GRAVITY_MPS2])
        seconds += 1
    assert 25 * 60 < seconds < 35 * 60
    assert battery.volts < 10.5


def test_voltage_falls_with_the_charge_and_drop_never_charges() -> None:
    battery = Battery(1000.0)
    volts = []
    for fraction in (1.0, 0.8, 0.5, 0.2, 0.1, 0.0):
        battery.drop_to(fraction)
        volts.append(battery.volts)
    assert volts == sorted(volts, reverse=True)
    battery.drop_to(0.9)
    assert battery.fraction == 0.0


def test_estimator_is_near_the_truth_and_exact_about_the_earth() -> None:
    frame = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
    estimator = Estimator(frame, (30.0, -20.0, 0.0), np.random.default_rng(3))
    errors = []
    for step in range(3000):
        truth = [30.0 + step * 0.1, -20.0, -15.0]
        estimator.step(step * DT_S, DT_S, truth, [5.0, 0.0, 0.0])
        local = estimator.position_m
        world = tuple(a + b for a, b in zip(local, estimator.origin_ned_m, strict=True))
        errors.append(math.dist(world, truth))
        if step % 50 == 0:
            exact = frame.to_geodetic((world[0], world[1], world[2]))
            near = estimator.geodetic(local)
            assert near.latitude_deg == pytest.approx(exact.latitude_deg, abs=5e-9)
            assert near.longitude_deg == pytest.approx(exact.longitude_deg, abs=5e-9)
            assert near.amsl_m == pytest.approx(exact.amsl_m, abs=1e-3)
            assert estimator.local(near) == pytest.approx(local, abs=2e-3)
    assert max(errors) < 1.2
    assert sum(errors) / len(errors) > 0.02


def test_estimator_drifts_without_gps_and_comes_back() -> None:
    frame = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
    estimator = Estimator(frame, (0.0, 0.0, 0.0), np.random.default_rng(3))
    now_s = 0.0

    def run(seconds: float) -> float:
        nonlocal now_s
        for _ in range(int(seconds / DT_S)):
            now_s += DT_S
            estimator.step(now_s, DT_S, [0.0, 0.0, -10.0], [0.0, 0.0, 0.0])
        return math.hypot(*estimator.position_m[:2])

    assert run(20.0) < 1.0
    estimator.gps = False
    assert run(60.0) > 1.0
    assert estimator.lost_for_s(now_s) == pytest.approx(60.0, abs=0.1)
    estimator.gps = True
    assert run(20.0) < 1.0
    assert estimator.lost_for_s(now_s) == 0.0
