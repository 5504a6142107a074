"""From anemometers, the autopilot's estimate and the vehicle's own tilt to one wind, with its covariance.

A Kalman filter over six states: the mean wind and the gust, each north, east, down (m/s, where the air goes).
The mean wanders slowly, the gust dies away with its correlation time (a first-order Gauss-Markov process per
axis, the simplest form of Dryden's, MIL-F-8785C section 3.7.2). Every source has its own trust:

* an anemometer on the airframe feels wind minus the drone's own velocity, turned by its attitude: both
  removed here, with the velocity of the mast's tip from the body's rates;
* the vehicle's tilt against its drag tells the airspeed (`sensors.filters.airframe`), over windows of a second,
  because the acceleration has to be known too;
* the autopilot's own estimate is smooth: its errors last, and it is taken for one statement every few
  seconds.
"""

from __future__ import annotations

import collections
import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from mission.geometry.frames import Vector3
from sensors.filters.airframe import Array, VehicleMotion, body_to_ned, point_velocity_ned_mps
from sensors.filters.health import Health
from sensors.filters.tilt_wind import TiltWindow
from sensors.filters.wind_config import WindFilterConfig
from sensors.instruments.samples import InstrumentState, Quantity, Sample

__all__ = ["VehicleMotion", "WindEstimate", "WindFilter", "WindFilterConfig"]

_STATES: Final = 6
_IDENTITY: Final = np.eye(3)
_H_NED: Final = np.hstack((_IDENTITY, _IDENTITY))
_H_HORIZONTAL: Final = _H_NED[:2]
_UPPER: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Upper triangle of a symmetric 3 x 3 matrix."""
_REFUSALS_MOST: Final = 3
_TILT_MEMORY: Final = 60.0
"""Windows over which the tilt's lasting errors stay the same, at the least."""


class WindEstimate(msgspec.Struct, frozen=True):
    wind_ned_mps: Vector3
    """Where the air goes at the vehicle, now."""
    covariance_m2ps2: tuple[Vector3, Vector3, Vector3]
    variance_m2ps2: float
    """Per horizontal axis: the mean of the two."""
    mean_wind_ned_mps: Vector3
    """Without the gust."""
    age_s: float
    health: Health
    reason: str
    sources: tuple[str, ...]
    """Who told of the wind within the last seconds: names of instruments, "tilt", "autopilot"."""


class WindFilter:
    """The wind at one vehicle. Give `step` every sample of the tick, whoever made it; it takes what tells of
    wind."""

    def __init__(self, config: WindFilterConfig | None = None) -> None:
        # Imported late: it costs a second and 95 MB, and only a process that filters shall pay.
        from filterpy.kalman import KalmanFilter

        self.config = config or WindFilterConfig()
        self._kf = KalmanFilter(dim_x=_STATES, dim_z=3)
        self._now_s: float | None = None
        self._time_s = 0.0
        """Time of the filter's state: of the newest measurement in it."""
        self._shares = np.array((1.0, 1.0, self.config.vertical_share**2))
        self._steps: dict[int, tuple[Array, Array]] = {}
        self._heard_s: dict[str, float] = {}
        self._refused: collections.Counter[str] = collections.Counter()
        self._trouble: dict[str, str] = {}
        self._tilt = TiltWindow(self.config)
        self._last_motion: tuple[float, VehicleMotion] | None = None
        self._told: tuple[Health, str] = (Health.BAD, "nothing has told of the wind yet")
        self._reset()

    def _reset(self) -> None:
        config = self.config
        self._kf.x = np.zeros(_STATES)
        mean = np.array((config.mean_sd_mps, config.mean_sd_mps, config.mean_vertical_sd_mps)) ** 2
        self._kf.P = np.diag(np.concatenate((mean, config.gust_sd_mps**2 * self._shares)))
        self._now_s = None
        self._state: tuple[list[float], list[Vector3]] | None = None
        self._heard_s.clear()
        self._refused.clear()
        self._tilt.clear()
        self._last_motion = None

    @property
    def verdict(self) -> tuple[Health, str]:
        """Health and its reason after the last step; there also while `step` returns None."""
        return self._told

    def step(
        self, now_s: float, samples: Sequence[Sample], motion: VehicleMotion | None
    ) -> WindEstimate | None:
        """The wind at `now_s` with these samples and this motion in it; None while nothing has told of it.

        Without `motion` an anemometer's readings cannot be used, and the autopilot's still can.
        """
        if self._now_s is not None and now_s < self._now_s:
            self._reset()
        if self._now_s is None:
            self._time_s = now_s
        self._now_s = now_s
        mine = [s for s in samples if _tells_wind(s)]
        if mine:
            self._take(now_s, mine, motion)
        if motion is not None and _finite(motion.attitude_rad) and _finite(motion.velocity_ned_mps):
            if self.config.drag is not None:
                tilt = self._tilt.add(now_s, motion)
                if tilt is not None:
                    self._update(
                        now_s, "tilt", np.array(tilt[0]), tilt[1] + self._tilt_bias(now_s), _H_HORIZONTAL
                    )
            self._last_motion = (now_s, motion)
        return self._estimate(now_s)

    # -- sources
    # ----------------------------------------------------------------------------------------------

    def _take(self, now_s: float, samples: list[Sample], motion: VehicleMotion | None) -> None:
        bodies: dict[str, list[Sample]] = {}
        for sample in samples:
            name = sample.instrument
            if sample.state is not InstrumentState.MEASURING:
                self._trouble[name] = sample.reason or sample.state.value
            elif sample.wind_body_mps is not None and _finite(sample.wind_body_mps):
                bodies.setdefault(name, []).append(sample)
            elif sample.wind_ned_mps is not None and _finite(sample.wind_ned_mps):
                self._trouble.pop(name, None)
                self._autopilot(now_s, sample, sample.wind_ned_mps)
        for name, readings in bodies.items():
            self._trouble.pop(name, None)
            if motion is not None and _finite(motion.attitude_rad) and _finite(motion.velocity_ned_mps):
                self._anemometer(now_s, name, readings, motion)

    def _anemometer(self, now_s: float, name: str, readings: list[Sample], motion: VehicleMotion) -> None:
        """All of a tick's readings as one: they are a fraction of a gust apart, and share the vehicle's
        motion."""
        config = self.config
        rates = motion.angular_rate_radps or self._rates(now_s, motion)
        moved_mps = config.motion_lag_s * self._acceleration(now_s, motion)
        motion = self._motion_at(sum(s.time_s for s in readings) / len(readings), now_s, motion)
        rotation = body_to_ned(motion.attitude_rad)
        arm = config.anemometer_arms_body_m.get(name, (0.0, 0.0, 0.0))
        own = point_velocity_ned_mps(motion, rotation, arm, rates)
        felt = np.mean([s.wind_body_mps for s in readings if s.wind_body_mps is not None], axis=0)
        sd_mps = readings[-1].wind_sd_mps or config.anemometer_sd_mps
        # Attitude errs by its noise, and by what the vehicle turns while the reading waits.
        turned_rad = math.hypot(config.attitude_sd_rad, config.motion_lag_s * rates[2])
        turned_mps = turned_rad * math.sqrt(float(felt @ felt))
        own_var = config.velocity_sd_mps**2 + moved_mps * moved_mps
        variance = sd_mps**2 / len(readings) + turned_mps * turned_mps + own_var
        if all(s.wind_down_measured for s in readings):
            self._update(now_s, name, rotation @ felt + own, variance, _H_NED)
        else:
            body = rotation.T
            self._update(now_s, name, felt[:2] + body[:2] @ own, variance, body[:2] @ _H_NED)

    def _autopilot(self, now_s: float, sample: Sample, wind_ned_mps: Vector3) -> None:
        heard_s = self._heard_s.get(sample.instrument, -math.inf)
        if now_s - heard_s < 1.0:
            return
        sd_mps = max(sample.wind_sd_mps or self.config.autopilot_sd_mps, 0.1)
        # Statements a second apart share their error for `autopilot_memory_s`: together they are worth one.
        variance = sd_mps**2 * max(self.config.autopilot_memory_s, 1.0)
        self._update(now_s, sample.instrument, np.array(wind_ned_mps[:2]), variance, _H_HORIZONTAL)

    def _motion_at(self, time_s: float, now_s: float, motion: VehicleMotion) -> VehicleMotion:
        """Velocity and attitude when the readings were taken, between the vehicle's last two messages."""
        if self._last_motion is None:
            return motion
        then_s, before = self._last_motion
        if not (then_s < time_s < now_s and now_s - then_s < 0.5):
            return motion
        share = (time_s - then_s) / (now_s - then_s)
        north, east, down = (
            a + share * (b - a) for a, b in zip(before.velocity_ned_mps, motion.velocity_ned_mps, strict=True)
        )
        roll, pitch, yaw = (
            a + share * math.remainder(b - a, math.tau)
            for a, b in zip(before.attitude_rad, motion.attitude_rad, strict=True)
        )
        return msgspec.structs.replace(
            motion, velocity_ned_mps=(north, east, down), attitude_rad=(roll, pitch, yaw)
        )

    def _acceleration(self, now_s: float, motion: VehicleMotion) -> float:
        """Size of the vehicle's horizontal acceleration, m/s^2, as far as two messages show it."""
        if self._last_motion is None or now_s - self._last_motion[0] <= 1e-3:
            return 0.0
        then_s, before = self._last_motion
        north, east, _ = motion.velocity_ned_mps
        then_north, then_east, _ = before.velocity_ned_mps
        return math.hypot(north - then_north, east - then_east) / (now_s - then_s)

    def _tilt_bias(self, now_s: float) -> float:
        """Extra variance of the tilt's wind while another source is heard.

        Its errors of level and drag last. Alone it cannot do better, and the output says so; beside a better
        source they must not count as new information every second.
        """
        others = any(now_s - t <= self.config.fresh_s for n, t in self._heard_s.items() if n != "tilt")
        return self._tilt.lasting_variance() * _TILT_MEMORY if others else 0.0

    def _rates(self, now_s: float, motion: VehicleMotion) -> Vector3:
        """Body rates from the change of attitude; small angles suffice for the tip of a short mast."""
        if self._last_motion is None or now_s - self._last_motion[0] <= 1e-3:
            return 0.0, 0.0, 0.0
        then_s, before = self._last_motion
        roll, pitch, yaw = (
            math.remainder(a - b, math.tau) / (now_s - then_s)
            for a, b in zip(motion.attitude_rad, before.attitude_rad, strict=True)
        )
        return roll, pitch, yaw

    # -- the filter
    # -------------------------------------------------------------------------------------------

    def _predict_to(self, time_s: float) -> None:
        """Only for a measurement: many steps without one are exactly one long step."""
        if time_s > self._time_s:
            transition, noise = self._discrete(time_s - self._time_s)
            self._kf.predict(F=transition, Q=noise)
        self._time_s = time_s

    def _discrete(self, dt_s: float) -> tuple[Array, Array]:
        """Exact transition and noise over `dt_s` (to the millisecond), kept for the steps that recur."""
        key = round(dt_s * 1000.0)
        found = self._steps.get(key)
        if found is None:
            if len(self._steps) > 2000:
                self._steps.clear()
            decay, walk, gust = self._ahead(key / 1000.0)
            transition = np.diag((1.0, 1.0, 1.0, decay, decay, decay))
            noise = np.diag(np.concatenate((walk * self._shares, gust * self._shares)))
            found = self._steps[key] = (transition, noise)
        return found

    def _ahead(self, dt_s: float) -> Vector3:
        """What is left of a gust after `dt_s` (a share), and what the mean's and the gust's horizontal variances grow
        by."""
        config = self.config
        decay = math.exp(-dt_s / config.gust_time_s)
        walk = config.mean_walk_mps_per_sqrt_min**2 * dt_s / 60.0
        return decay, walk, config.gust_sd_mps**2 * (1.0 - decay * decay)

    def _update(self, now_s: float, source: str, z: Array, variance: float, h: Array) -> None:
        """One measurement of a source, unless it is further off than its errors and the filter's allow."""
        self._predict_to(now_s)
        self._state = None
        innovation = z - h @ self._kf.x
        most = self.config.gate_sd**2 * len(z)
        nis = float(innovation @ innovation) / variance  # too large, but mostly small enough, and cheap
        if nis > most:
            spread = h @ self._kf.P @ h.T
            spread.flat[:: len(z) + 1] += variance
            nis = float(innovation @ np.linalg.solve(spread, innovation))
        if nis > most:
            self._refused[source] += 1
            if self._refused[source] < _REFUSALS_MOST:
                return
            # It keeps saying so: the wind has changed more than the model thought it could.
            self._kf.P = self._kf.P + np.diag(np.concatenate((np.full(3, 2.0), np.full(3, 1.0)))) * nis / len(
                z
            )
        self._refused[source] = 0
        self._kf.update(z, np.eye(len(z)) * variance, h)
        # filterpy's state silently takes another shape when a measurement has the wrong one.
        assert self._kf.x.shape == (_STATES,)  # noqa: S101
        self._heard_s[source] = now_s

    def _estimate(self, now_s: float) -> WindEstimate | None:
        sources = tuple(n for n, t in self._heard_s.items() if now_s - t <= self.config.fresh_s)
        self._told = self._judge(now_s, sources)
        if not self._heard_s:
            return None
        # Mean wind plus gust, carried on to now, in plain numbers: six by six is too few for arrays.
        (mean_north, mean_east, mean_down, north, east, down), upper = self._numbers()
        kept, walk, gust = self._ahead(now_s - self._time_s)
        lasting = self._lasting_variance(sources)
        nn, ne, nd, ee, ed, dd = [mean + kept * (both + kept * gusts) for mean, both, gusts in upper]
        nn, ee = nn + walk + gust + lasting, ee + walk + gust + lasting
        dd += self.config.vertical_share**2 * (walk + gust) + lasting
        health, reason = self._told
        return WindEstimate(
            wind_ned_mps=(mean_north + kept * north, mean_east + kept * east, mean_down + kept * down),
            covariance_m2ps2=((nn, ne, nd), (ne, ee, ed), (nd, ed, dd)),
            variance_m2ps2=0.5 * (nn + ee),
            mean_wind_ned_mps=(mean_north, mean_east, mean_down),
            age_s=now_s - max(self._heard_s.values()),
            health=health,
            reason=reason,
            sources=sources,
        )

    def _numbers(self) -> tuple[list[float], list[Vector3]]:
        """The state after the newest measurement, and what its covariance is for the whole wind: upper triangle of
        the mean's, of mean with gust and gust with mean, of the gust's."""
        if self._state is None:
            p = self._kf.P.tolist()
            upper = [(p[i][j], p[i][j + 3] + p[i + 3][j], p[i + 3][j + 3]) for i, j in _UPPER]
            self._state = self._kf.x.tolist(), upper
        return self._state

    def _lasting_variance(self, sources: tuple[str, ...]) -> float:
        """What no averaging removes, per axis: calibration of the best source that is heard."""
        config = self.config
        if config.drag is None or any(s != "tilt" for s in sources):
            return config.anemometer_bias_mps**2
        return self._tilt.lasting_variance()

    def _judge(self, now_s: float, sources: tuple[str, ...]) -> tuple[Health, str]:
        trouble = "; ".join(f"{name}: {why}" for name, why in sorted(self._trouble.items()))
        if not self._heard_s:
            return Health.BAD, trouble or "nothing has told of the wind yet"
        age_s = now_s - max(self._heard_s.values())
        if age_s > self.config.lost_s:
            return Health.BAD, trouble or f"nothing has told of the wind for {age_s:.0f} s"
        if trouble:
            return Health.DEGRADED, trouble
        if not sources:
            return Health.DEGRADED, f"nothing has told of the wind for {age_s:.1f} s"
        return Health.GOOD, ""


def _tells_wind(sample: Sample) -> bool:
    return sample.quantity is Quantity.WIND or not (
        sample.wind_body_mps is None and sample.wind_ned_mps is None
    )


def _finite(vector: Vector3) -> bool:
    return math.isfinite(vector[0] + vector[1] + vector[2])
