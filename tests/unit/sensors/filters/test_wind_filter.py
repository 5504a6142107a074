"""The wind filter: conventions, sources, and what it says about itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.frames import Vector3
from sensors.filters.airframe import GRAVITY_MPS2, DragModel, VehicleMotion, body_to_ned, thrust_ned_mps2
from sensors.filters.health import Health
from sensors.filters.wind_filter import WindEstimate, WindFilter, WindFilterConfig
from sensors.instruments.samples import InstrumentState, Quantity, Sample

angles = st.floats(-math.pi, math.pi)
tilts = st.floats(-0.5, 0.5)
speeds = st.floats(-8.0, 8.0)


def felt(wind_ned_mps: Vector3, motion: VehicleMotion, arm_body_m: Vector3 = (0.0, 0.0, 0.0)) -> Vector3:
    """What a perfect anemometer at `arm_body_m` says."""
    rates = np.array(motion.angular_rate_radps or (0.0, 0.0, 0.0))
    rotation = body_to_ned(motion.attitude_rad)
    point = np.array(motion.velocity_ned_mps) + rotation @ np.cross(rates, arm_body_m)
    forward, right, down = (rotation.T @ (np.array(wind_ned_mps) - point)).tolist()
    return forward, right, down


def mast(time_s: float, vector: Vector3, *, flat: bool = False, name: str = "mast") -> Sample:
    return Sample(
        time_s,
        name,
        InstrumentState.MEASURING,
        wind_body_mps=(*vector[:2], 0.0) if flat else vector,
        wind_down_measured=not flat,
        wind_sd_mps=0.15,
        quantity=Quantity.WIND,
    )


def settle(
    filter_: WindFilter, sample_of: object, motion: VehicleMotion, seconds: float = 12.0
) -> WindEstimate:
    estimate = None
    for tick in range(round(seconds / 0.1)):
        now_s = 0.1 * tick
        samples = [sample_of(now_s)] if callable(sample_of) else []
        estimate = filter_.step(now_s, samples, motion)
    assert estimate is not None
    return estimate


@settings(max_examples=15, deadline=None)
@given(
    wind=st.tuples(speeds, speeds, st.floats(-1.0, 1.0)),
    velocity=st.tuples(speeds, speeds, st.floats(-2.0, 2.0)),
    attitude=st.tuples(tilts, tilts, angles),
    rates=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 2)),
    flat=st.booleans(),
)
def test_own_motion_rotation_and_mast_are_removed(
    wind: Vector3, velocity: Vector3, attitude: Vector3, rates: Vector3, flat: bool
) -> None:
    arm = (0.3, -0.1, -0.6)
    filter_ = WindFilter(WindFilterConfig(drag=None, anemometer_arms_body_m={"mast": arm}))
    motion = VehicleMotion(attitude, velocity, rates)
    still = wind if not flat else (wind[0], wind[1], 0.0)
    estimate = settle(filter_, lambda now_s: mast(now_s, felt(still, motion, arm), flat=flat), motion)
    assert estimate.wind_ned_mps[:2] == pytest.approx(wind[:2], abs=0.25)
    if not flat:
        assert estimate.wind_ned_mps[2] == pytest.approx(wind[2], abs=0.25)
    assert estimate.health is Health.GOOD
    assert estimate.sources == ("mast",)


def test_a_recorded_quadrotor_has_linear_and_quadratic_drag() -> None:
    """ArduCopter 4.6.3's simulated quadrotor, hovering: its tilt and the wind at its height."""
    drag = DragModel(linear_per_s=0.24, quadratic_per_m=0.034)
    for tilt_deg, wind_mps in (
        (2.34, 1.39),
        (3.98, 2.14),
        (4.96, 2.55),
        (6.51, 3.17),
        (8.9, 4.0),
        (10.68, 4.62),
    ):
        push_mps2 = GRAVITY_MPS2 * math.tan(math.radians(tilt_deg))
        assert drag.airspeed_mps(push_mps2) == pytest.approx(wind_mps, rel=0.06)


@settings(max_examples=30, deadline=None)
@given(
    wind=st.tuples(speeds, speeds), velocity=st.tuples(speeds, speeds), yaw=angles, quadratic=st.booleans()
)
def test_tilt_against_drag_in_steady_flight(
    wind: tuple[float, float], velocity: tuple[float, float], yaw: float, quadratic: bool
) -> None:
    drag = DragModel(linear_per_s=0.1, quadratic_per_m=0.02) if quadratic else DragModel()
    relative = np.array(velocity) - np.array(wind)
    speed = float(np.hypot(*relative))
    pull = drag.linear_per_s * speed + drag.quadratic_per_m * speed * speed
    push = relative / speed * pull if speed > 0.0 else np.zeros(2)  # the rotors push against the drag
    ahead = push[0] * math.cos(yaw) + push[1] * math.sin(yaw)
    right = -push[0] * math.sin(yaw) + push[1] * math.cos(yaw)
    pitch = math.atan2(-ahead, GRAVITY_MPS2)
    roll = math.atan2(right * math.cos(pitch), GRAVITY_MPS2)
    motion = VehicleMotion((roll, pitch, yaw), (*velocity, 0.0))
    assert thrust_ned_mps2(motion.attitude_rad, 0.0) == pytest.approx(tuple(push), abs=1e-6)
    estimate = settle(WindFilter(WindFilterConfig(drag=drag)), None, motion, seconds=30.0)
    assert estimate.wind_ned_mps[:2] == pytest.approx(wind, abs=0.4)
    assert estimate.sources == ("tilt",)


def test_a_gust_of_acceleration_is_not_wind() -> None:
    """Leaning to speed up in still air: the tilt is explained by the change of velocity."""
    filter_ = WindFilter()
    estimate, speed = None, 0.0
    for tick in range(60):
        lean = 0.1  # about 1 m/s^2, growing airspeed taken off
        acceleration = GRAVITY_MPS2 * math.tan(lean) - 0.19 * speed
        speed += 0.1 * acceleration
        estimate = filter_.step(0.1 * tick, [], VehicleMotion((0.0, -lean, 0.0), (speed, 0.0, 0.0)))
    assert estimate is not None
    assert estimate.wind_ned_mps[:2] == pytest.approx((0.0, 0.0), abs=0.6)


def test_on_the_ground_the_legs_hold_and_nothing_is_known() -> None:
    filter_ = WindFilter()
    standing = VehicleMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), airborne=False)
    for tick in range(100):
        assert filter_.step(0.1 * tick, [], standing) is None
    assert filter_.verdict == (Health.BAD, "nothing has told of the wind yet")


def test_the_autopilots_estimate_counts_once_in_a_while() -> None:
    filter_ = WindFilter()
    estimate = None
    for tick in range(300):
        sample = Sample(
            0.1 * tick,
            "autopilot wind",
            InstrumentState.MEASURING,
            wind_ned_mps=(3.0, -4.0, 0.0),
            wind_sd_mps=0.8,
        )
        estimate = filter_.step(0.1 * tick, [sample], None)
    assert estimate is not None
    assert estimate.wind_ned_mps[:2] == pytest.approx((3.0, -4.0), abs=0.3)
    assert 0.2 < math.sqrt(estimate.variance_m2ps2) < 0.9


def test_losing_the_anemometer_is_told_and_the_tilt_takes_over() -> None:
    filter_ = WindFilter()
    hover = VehicleMotion(
        (0.0, -math.atan2(-0.19 * -5.0, GRAVITY_MPS2), 0.0), (0.0, 0.0, 0.0)
    )  # 5 m/s headwind
    wind = (-5.0, 0.0, 0.0)
    good = settle(filter_, lambda now_s: mast(now_s, felt(wind, hover)), hover)
    assert (good.health, good.sources) == (Health.GOOD, ("mast", "tilt"))
    lost = Sample(20.0, "mast", InstrumentState.SILENT, reason="unplugged", quantity=Quantity.WIND)
    estimate = filter_.step(12.0, [lost], hover)
    for tick in range(121, 320):
        estimate = filter_.step(0.1 * tick, [], hover)
    assert estimate is not None
    assert (estimate.health, estimate.reason) == (Health.DEGRADED, "mast: unplugged")
    assert estimate.sources == ("tilt",)
    assert estimate.wind_ned_mps[0] == pytest.approx(-5.0, abs=0.5)
    assert estimate.variance_m2ps2 > good.variance_m2ps2


def test_wild_readings_are_refused_until_they_insist() -> None:
    filter_ = WindFilter(WindFilterConfig(drag=None))
    hover = VehicleMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    settle(filter_, lambda now_s: mast(now_s, (2.0, 0.0, 0.0)), hover)
    spark = filter_.step(12.0, [mast(12.0, (30.0, 0.0, 0.0))], hover)
    assert spark is not None
    assert spark.wind_ned_mps[0] == pytest.approx(2.0, abs=0.5)
    estimate = spark
    for tick in range(121, 180):
        estimate = filter_.step(0.1 * tick, [mast(0.1 * tick, (12.0, 0.0, 0.0))], hover) or estimate
    assert estimate.wind_ned_mps[0] == pytest.approx(12.0, abs=0.5)


def test_without_news_it_ages_and_ends() -> None:
    filter_ = WindFilter(WindFilterConfig(drag=None))
    hover = VehicleMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    fresh = settle(filter_, lambda now_s: mast(now_s, (2.0, 0.0, 0.0)), hover)
    old = filter_.step(18.0, [], hover)
    assert old is not None
    assert (old.health, old.age_s) == (Health.DEGRADED, pytest.approx(6.1))
    assert old.variance_m2ps2 > 2.0 * fresh.variance_m2ps2
    gone = filter_.step(40.0, [], hover)
    assert gone is not None
    assert gone.health is Health.BAD
    assert "nothing has told of the wind" in gone.reason
    assert filter_.step(1.0, [], hover) is None, "a clock set back: begin anew"


history = st.lists(
    st.tuples(
        st.floats(-3.0, 20.0),
        st.one_of(st.none(), st.tuples(*[st.floats(allow_nan=True, allow_infinity=True, width=32)] * 3)),
        st.tuples(*[st.floats(-200.0, 200.0) | st.just(math.nan)] * 3),
        st.booleans(),
    ),
    max_size=40,
)


@settings(max_examples=60, deadline=None)
@given(history=history)
def test_no_history_breaks_it(history: list[tuple[float, Vector3 | None, Vector3, bool]]) -> None:
    filter_ = WindFilter()
    now_s = 0.0
    for dt_s, vector, velocity, flat in history:
        now_s += dt_s
        if vector is not None and any(abs(v) > 80.0 for v in vector if math.isfinite(v)):
            continue  # the parsers' range check
        samples = (
            [] if vector is None else [mast(now_s, vector, flat=flat and all(map(math.isfinite, vector)))]
        )
        estimate = filter_.step(now_s, samples, VehicleMotion((0.1, -0.1, 0.5), velocity))
        if estimate is not None:
            assert all(math.isfinite(v) for v in estimate.wind_ned_mps)
            assert estimate.variance_m2ps2 > 0.0
            assert np.linalg.eigvalsh(np.array(estimate.covariance_m2ps2)).min() > 0.0
