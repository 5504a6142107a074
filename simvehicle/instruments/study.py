"""How good the filters are, measured: emulated instruments in known air, through parser and filter, by seed.

Benchmarks, tests and the plots of the documentation all draw on these two experiments.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from mission.geometry.frames import Vector3
from sensors.filters.airframe import VehicleMotion, body_to_ned
from sensors.filters.co2_filter import Co2Filter, Co2FilterConfig
from sensors.filters.wind_filter import WindFilter, WindFilterConfig
from sensors.instruments.registry import make_instrument
from sensors.instruments.samples import Sample
from simvehicle.instruments import make_emulator
from simvehicle.vehicle.dynamics import GRAVITY_MPS2, Multirotor
from simvehicle.world.air import Air
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import WindConfig

Array = npt.NDArray[np.float64]

TICK_S = 0.1
_FINE = 5
"""Steps of the world in a tick: the lag is exact for air that stands still in a step."""
_SETTLE_S = 13.0
"""The background is learned before; nothing is judged until then."""


@dataclasses.dataclass(frozen=True)
class PlumePass:
    """One flight through a plume; arrays over the ticks after the background was learned."""

    time_s: Array
    truth_ppm: Array
    """Excess over the background at the inlet."""
    raw_ppm: Array
    """The instrument's reading less the true background."""
    estimate_ppm: Array
    variance_ppm2: Array

    @property
    def error_ratio(self) -> float:
        """Root-mean-square error of the estimate over that of the raw reading."""
        return float(
            np.sqrt(np.mean((self.estimate_ppm - self.truth_ppm) ** 2))
            / np.sqrt(np.mean((self.raw_ppm - self.truth_ppm) ** 2))
        )

    @property
    def peak_delay_s(self) -> float:
        """From the true peak to the estimate's."""
        return float(self.time_s[self.estimate_ppm.argmax()] - self.time_s[self.truth_ppm.argmax()])

    @property
    def raw_peak_delay_s(self) -> float:
        return float(self.time_s[self.raw_ppm.argmax()] - self.time_s[self.truth_ppm.argmax()])

    @property
    def nees(self) -> float:
        """Normalised estimation error squared, mean over the flight; 1 for an honest variance."""
        return float(np.mean((self.estimate_ppm - self.truth_ppm) ** 2 / self.variance_ppm2))


def fly_through_plume(
    seed: int, duration_s: float = 50.0, turbulence: float = 0.1, config: Co2FilterConfig | None = None
) -> PlumePass:
    """A straight flight at 4 to 7 m/s across a Gaussian plume of 50 to 1,000 ppm, sd 4 to 10 m, with an
    SBA-5.

    The background is unknown to the filter, and the air of the start departs from it by 1 ppm (standard
    deviation). Inside the plume the concentration fluctuates by `turbulence` of itself, over about a second.
    As in an agent, an answer is read in the tick after its question, and a tick comes up to 40 ms late.
    """
    rng = np.random.default_rng([seed, 0x5BA5])
    speed_mps, sd_m = rng.uniform(4.0, 7.0), rng.uniform(4.0, 10.0)
    peak_ppm = math.exp(rng.uniform(math.log(50.0), math.log(1000.0)))
    peak_s = rng.uniform(0.5, 0.7) * duration_s
    background_ppm, departure_ppm = 420.0 + rng.normal(0.0, 5.0), rng.normal(0.0, 1.0)
    steps = int(duration_s / TICK_S) * _FINE
    eddy = _smooth_noise(rng, steps + 1, TICK_S / _FINE, time_s=0.7)
    late_steps = rng.integers(0, 3, steps // _FINE).tolist()
    ticks = {tick * _FINE + late for tick, late in enumerate(late_steps)}
    emulator = make_emulator("sba5", rng)
    instrument = make_instrument("sba5")
    emulator.receive(0.0, instrument.connected(0.0))
    filter_ = Co2Filter(config)
    said = b""
    rows = []
    for step in range(steps):
        now_s = step * TICK_S / _FINE
        across_m = (now_s - peak_s) * speed_mps
        excess_ppm = (
            peak_ppm * math.exp(-0.5 * (across_m / sd_m) ** 2) * max(1.0 + turbulence * eddy[step], 0.0)
        )
        excess_ppm += departure_ppm * min(max((_SETTLE_S - now_s) / 2.0, 0.0), 1.0)
        said += emulator.step(now_s, Air(co2_ppm=background_ppm + excess_ppm))
        if step not in ticks:
            continue
        samples, said = instrument.receive(now_s, said), b""
        request, silent = instrument.poll(now_s)
        emulator.receive(now_s, request)
        estimate = filter_.step(now_s, samples + silent)
        if estimate is not None and now_s >= _SETTLE_S:
            rows.append(
                (
                    now_s,
                    excess_ppm,
                    estimate.co2_ppm - background_ppm,
                    estimate.excess_co2_ppm,
                    estimate.variance_ppm2,
                )
            )
    return PlumePass(*np.array(rows).T)


@dataclasses.dataclass(frozen=True)
class WindFlight:
    """One flight in gusty wind; arrays over the ticks, horizontal components north and east."""

    time_s: Array
    truth_mps: Array
    estimate_mps: Array
    covariance_m2ps2: Array
    raw_mps: Array
    """The anemometer's last reading, turned to north and east, the drone's own motion still in it; NaN
    without one."""

    @property
    def error_mps(self) -> float:
        """Root-mean-square error per axis."""
        return float(np.sqrt(np.mean((self.estimate_mps - self.truth_mps) ** 2)))

    @property
    def nees(self) -> float:
        """Normalised estimation error squared per axis, mean over the flight; 1 for an honest covariance."""
        error = self.estimate_mps - self.truth_mps
        solved = np.linalg.solve(self.covariance_m2ps2, error[:, :, None])[:, :, 0]
        return float(np.mean(np.sum(error * solved, axis=1))) / 2.0


def fly_in_wind(
    seed: int, anemometer: str | None, duration_s: float = 60.0, config: WindFilterConfig | None = None
) -> WindFlight:
    """A wandering flight at up to 5 m/s in 0 to 8 m/s of wind with gusts of 0.5 m/s, with or without an
    anemometer.

    The drone's attitude and velocity carry the errors that the filter's configuration states, and its drag is
    5 % (standard deviation) off its calibration. The first five seconds are not judged.
    """
    settings = config or WindFilterConfig()
    rng = np.random.default_rng([seed, 0x817D])
    wind = GustyWind(
        WindConfig(
            speed_mps=float(rng.uniform(0.0, 8.0)),
            from_deg=float(rng.uniform(0.0, 360.0)),
            gust_sd_mps=settings.gust_sd_mps,
            gust_time_s=settings.gust_time_s,
        ),
        seed,
    )
    scale = 1.0 + settings.drag_scale_sd * rng.normal()
    level_rad = rng.normal(0.0, settings.level_sd_rad, 2)
    vehicle = Multirotor((0.0, 0.0, -20.0), float(rng.uniform(-math.pi, math.pi)))
    vehicle.on_ground = False
    vehicle.thrust = [0.0, 0.0, -GRAVITY_MPS2]
    emulator = make_emulator(anemometer, rng) if anemometer else None
    instrument = make_instrument(anemometer) if anemometer else None
    if emulator is not None and instrument is not None:
        emulator.receive(0.0, instrument.connected(0.0))
    filter_ = WindFilter(settings)
    pilot = _Wanderer(rng)
    rows, covariances = [], []
    raw_mps = [math.nan, math.nan]
    dt_s = TICK_S / _FINE
    for tick in range(int(duration_s / TICK_S)):
        samples: list[Sample] = []
        now_s, air_mps = 0.0, (0.0, 0.0, 0.0)
        for fine in range(_FINE):
            now_s = (tick * _FINE + fine) * dt_s
            air_mps = wind.wind_ned_mps((0.0, 0.0, -20.0), now_s)
            thrust, yaw = pilot.steer(now_s, dt_s, vehicle)
            # A vehicle whose drag is not the calibrated one: the same tilt means another airspeed.
            blown = tuple(v + scale * (a - v) for a, v in zip(air_mps, vehicle.velocity, strict=True))
            vehicle.step(dt_s, thrust, yaw, (blown[0], blown[1], blown[2]))
            if emulator is not None and instrument is not None:
                felt = _felt(vehicle, air_mps)
                samples += instrument.receive(now_s, emulator.step(now_s, Air(wind_body_mps=felt)))
        if emulator is not None and instrument is not None:
            emulator.receive(now_s, instrument.poll(now_s)[0])
        motion = _reported(vehicle, settings, level_rad, rng)
        estimate = filter_.step(now_s, samples, motion)
        if estimate is not None and now_s >= 5.0:
            readings = [s.wind_body_mps for s in samples if s.wind_body_mps is not None]
            if readings:
                raw_mps = (body_to_ned(motion.attitude_rad) @ np.array(readings[-1]))[:2].tolist()
            rows.append((now_s, *air_mps[:2], *estimate.wind_ned_mps[:2], *raw_mps))
            covariances.append([row[:2] for row in estimate.covariance_m2ps2[:2]])
    table = np.array(rows)
    return WindFlight(table[:, 0], table[:, 1:3], table[:, 3:5], np.array(covariances), table[:, 5:7])


class _Wanderer:
    """A velocity controller that is given a new velocity and heading every few seconds."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._next_s = 0.0
        self._wanted = np.zeros(3)
        self._yaw_rad = 0.0
        self._lean = np.zeros(3)

    def steer(self, now_s: float, dt_s: float, vehicle: Multirotor) -> tuple[Vector3, float]:
        if now_s >= self._next_s:
            self._next_s = now_s + float(self._rng.uniform(3.0, 10.0))
            self._wanted = np.append(self._rng.uniform(-3.5, 3.5, 2), self._rng.uniform(-0.5, 0.5))
            self._yaw_rad = float(self._rng.uniform(-math.pi, math.pi))
        error = self._wanted - np.array(vehicle.velocity)
        self._lean = np.clip(self._lean + 0.5 * error * dt_s, -4.0, 4.0)
        push = np.clip(1.5 * error + self._lean, -4.0, 4.0)
        return (float(push[0]), float(push[1]), float(push[2]) - GRAVITY_MPS2), self._yaw_rad


def _felt(vehicle: Multirotor, air_ned_mps: Vector3) -> Vector3:
    """What a mast on the airframe feels: the air relative to the vehicle, in body axes."""
    relative = np.array(air_ned_mps) - np.array(vehicle.velocity)
    forward, right, down = (body_to_ned(vehicle.attitude_rad).T @ relative).tolist()
    return forward, right, down


def _reported(
    vehicle: Multirotor, settings: WindFilterConfig, level_rad: Array, rng: np.random.Generator
) -> VehicleMotion:
    """What the autopilot says of the vehicle's motion, with its errors."""
    roll, pitch, yaw = vehicle.attitude_rad
    tilts = np.array((roll, pitch)) + level_rad + rng.normal(0.0, settings.attitude_sd_rad, 2)
    velocity = np.array(vehicle.velocity) + rng.normal(0.0, settings.velocity_sd_mps, 3)
    north, east, down = velocity.tolist()
    heading_rad = yaw + float(rng.normal(0.0, settings.attitude_sd_rad))
    return VehicleMotion((float(tilts[0]), float(tilts[1]), heading_rad), (north, east, down))


def _smooth_noise(rng: np.random.Generator, count: int, dt_s: float, time_s: float) -> list[float]:
    """Unit-variance noise without edges: white noise through two first-order lags of `time_s`."""
    blend = -math.expm1(-dt_s / time_s)
    once = twice = 0.0
    values = []
    for kick in rng.standard_normal(count + int(10 * time_s / dt_s)).tolist():
        once += (kick - once) * blend
        twice += (once - twice) * blend
        values.append(twice)
    tail = np.array(values[-count:])
    spread = math.sqrt(blend / 4.0)  # standard deviation of the two-lag cascade for small `blend`
    return [float(v) for v in tail / spread]
