"""How a multirotor moves: a point mass that tilts its thrust, is dragged along by the air and stops at the ground.

The model is the smallest that makes an autopilot do real work: thrust can only be turned so far and so fast,
drag acts on the velocity relative to the *air*, so that a vehicle that wants to stand still in wind has to lean
into it, and what it leans tells the wind. There are no rotors and no rotational dynamics.

    dv/dt = f + g - DRAG_PER_S (v - wind),     df/dt = (f_wanted - f) / THRUST_LAG_S

with the specific thrust f (metres per second squared, north, east, down). The drag is linear in the airspeed, as
induced rotor drag is at a few metres per second.
"""

from __future__ import annotations

import math

from mission.geometry.frames import Vector3

GRAVITY_MPS2 = 9.80665

DRAG_PER_S = 0.19
"""Acceleration per metre per second of airspeed: 8.9 degrees of lean stand still in 8 m/s of wind. The launcher
tells it to the agents as their airframe's calibration. (The recorded ArduCopter has about twice this: 8.9 degrees in
the 4 m/s that its simulator makes of "8 m/s" at 15 m, and it took the wind's speed with a time constant of 2.5 s when
it was let go.)"""

THRUST_LAG_S = 0.12
"""Time constant of the attitude and motor response."""

YAW_RATE_LIMIT_RADPS = math.radians(60.0)
"""ArduCopter's ATC_SLEW_YAW."""

HOVER_CURRENT_A = 20.0
HOTEL_CURRENT_A = 0.6
"""What the electronics draw with the motors off."""


class Multirotor:
    """The body: truth, which only the simulation knows. Positions and velocities in the world's NED frame."""

    __slots__ = (
        "failed",
        "impact_mps",
        "last_dt_s",
        "on_ground",
        "position",
        "thrust",
        "thrust_before",
        "turned_over",
        "velocity",
        "yaw_rad",
        "yaw_rate_radps",
    )

    def __init__(self, position_ned_m: Vector3, yaw_rad: float = 0.0) -> None:
        self.position = list(position_ned_m)
        self.velocity = [0.0, 0.0, 0.0]
        self.thrust = [0.0, 0.0, 0.0]
        """Specific thrust, m/s^2, north, east, down: level hover is (0, 0, -g)."""
        self.thrust_before = [0.0, 0.0, 0.0]
        self.last_dt_s = 1.0
        self.yaw_rad = yaw_rad
        self.yaw_rate_radps = 0.0
        self.on_ground = True
        self.failed = False
        """The motors give nothing any more."""
        self.turned_over = False
        """It fell out of its attitude and stays on its back."""
        self.impact_mps: float | None = None
        """Speed at the last touch of the ground; whoever reads it sets it back to None."""

    def step(
        self, dt_s: float, wanted_thrust_mps2: Vector3, wanted_yaw_rad: float | None, wind_ned_mps: Vector3
    ) -> None:
        """One step of semi-implicit Euler. The ground is the plane down = 0."""
        thrust, velocity, position = self.thrust, self.velocity, self.position
        blend = min(1.0, dt_s / THRUST_LAG_S)
        self.thrust_before[:] = thrust
        self.last_dt_s = dt_s
        if self.failed:
            wanted_thrust_mps2 = (0.0, 0.0, 0.0)
        wanted_n, wanted_e, wanted_d = wanted_thrust_mps2
        thrust_n, thrust_e, thrust_d = thrust
        thrust_n += (wanted_n - thrust_n) * blend
        thrust_e += (wanted_e - thrust_e) * blend
        thrust_d += (wanted_d - thrust_d) * blend
        thrust[:] = (thrust_n, thrust_e, thrust_d)
        self._turn(dt_s, wanted_yaw_rad)
        if self.on_ground and -thrust_d <= GRAVITY_MPS2:
            velocity[0] = velocity[1] = velocity[2] = 0.0
            return
        self.on_ground = False
        wind_n, wind_e, wind_d = wind_ned_mps
        north_mps, east_mps, down_mps = velocity
        north_mps += (thrust_n - DRAG_PER_S * (north_mps - wind_n)) * dt_s
        east_mps += (thrust_e - DRAG_PER_S * (east_mps - wind_e)) * dt_s
        down_mps += (thrust_d - DRAG_PER_S * (down_mps - wind_d) + GRAVITY_MPS2) * dt_s
        velocity[:] = (north_mps, east_mps, down_mps)
        position[0] += north_mps * dt_s
        position[1] += east_mps * dt_s
        position[2] += down_mps * dt_s
        if position[2] >= 0.0 and velocity[2] > 0.0:
            self.impact_mps = velocity[2]
            self.on_ground = True
            position[2] = 0.0
            velocity[0] = velocity[1] = velocity[2] = 0.0

    def _turn(self, dt_s: float, wanted_yaw_rad: float | None) -> None:
        if wanted_yaw_rad is None or self.on_ground:
            self.yaw_rate_radps = 0.0
            return
        error_rad = wrapped(wanted_yaw_rad - self.yaw_rad)
        rate_radps = 2.0 * error_rad
        if abs(rate_radps) > YAW_RATE_LIMIT_RADPS:
            rate_radps = math.copysign(YAW_RATE_LIMIT_RADPS, rate_radps)
        self.yaw_rate_radps = rate_radps
        self.yaw_rad = wrapped(self.yaw_rad + rate_radps * dt_s)

    @property
    def attitude_rad(self) -> Vector3:
        """Roll, pitch, yaw of the body (aerospace sequence), from where the thrust points."""
        if self.turned_over:
            return math.pi, 0.0, self.yaw_rad
        if self.on_ground:
            return 0.0, 0.0, self.yaw_rad
        return attitude_of(self.thrust, self.yaw_rad)

    @property
    def rates_radps(self) -> Vector3:
        """How fast roll, pitch and yaw change."""
        if self.on_ground:
            return 0.0, 0.0, 0.0
        roll, pitch, _ = attitude_of(self.thrust, self.yaw_rad)
        roll_before, pitch_before, _ = attitude_of(self.thrust_before, self.yaw_rad)
        return (
            (roll - roll_before) / self.last_dt_s,
            (pitch - pitch_before) / self.last_dt_s,
            self.yaw_rate_radps,
        )

    @property
    def throttle_fraction(self) -> float:
        """Thrust over the largest thrust, which is 2.6 times the weight (hover at 0.38, as recorded)."""
        north, east, down = self.thrust
        return min(1.0, math.sqrt(north * north + east * east + down * down) / (2.6 * GRAVITY_MPS2))


def attitude_of(thrust_mps2: list[float], yaw_rad: float) -> Vector3:
    """Roll, pitch, yaw (radians) of a body whose specific thrust (NED) is `thrust_mps2` and that heads `yaw_rad`."""
    north, east, down = thrust_mps2
    size = math.sqrt(north * north + east * east + down * down)
    if size < 0.5:  # (nearly) free fall: the thrust does not tell the attitude
        return 0.0, 0.0, yaw_rad
    cos_yaw, sin_yaw = math.cos(yaw_rad), math.sin(yaw_rad)
    ahead = north * cos_yaw + east * sin_yaw
    right = -north * sin_yaw + east * cos_yaw
    return math.asin(max(-1.0, min(1.0, right / size))), math.atan2(-ahead, -down), yaw_rad


def quaternion_of(attitude_rad: Vector3) -> tuple[float, float, float, float]:
    """Unit quaternion (w first, body to NED) of roll, pitch, yaw."""
    roll, pitch, yaw = (angle / 2.0 for angle in attitude_rad)
    cr, sr, cp, sp, cy, sy = (
        math.cos(roll),
        math.sin(roll),
        math.cos(pitch),
        math.sin(pitch),
        math.cos(yaw),
        math.sin(yaw),
    )
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def in_body(vector_ned: Vector3, attitude_rad: Vector3) -> Vector3:
    """A vector given in NED, seen in the body frame (forward, right, down)."""
    roll, pitch, yaw = attitude_rad
    north, east, down = vector_ned
    cy, sy, cp, sp, cr, sr = (
        math.cos(yaw),
        math.sin(yaw),
        math.cos(pitch),
        math.sin(pitch),
        math.cos(roll),
        math.sin(roll),
    )
    ahead = cy * north + sy * east
    right = -sy * north + cy * east
    forward = cp * ahead - sp * down
    below = sp * ahead + cp * down
    return forward, cr * right + sr * below, -sr * right + cr * below


class Battery:
    """A three-cell pack that empties with the current, which grows with the thrust (power ~ thrust^1.5)."""

    __slots__ = ("capacity_mah", "current_a", "full_volts", "used_mah")

    def __init__(self, capacity_mah: float, full_volts: float = 12.6) -> None:
        self.capacity_mah = capacity_mah
        self.full_volts = full_volts
        self.used_mah = 0.0
        self.current_a = 0.0

    def step(self, dt_s: float, motors_on: bool, thrust_mps2: list[float]) -> None:
        current_a = HOTEL_CURRENT_A
        if motors_on:
            north, east, down = thrust_mps2
            load = math.sqrt(north * north + east * east + down * down) / GRAVITY_MPS2
            current_a += HOVER_CURRENT_A * max(0.05, load**1.5)
        self.current_a = current_a
        self.used_mah = min(self.capacity_mah, self.used_mah + current_a * dt_s / 3.6)

    @property
    def fraction(self) -> float:
        return max(0.0, 1.0 - self.used_mah / self.capacity_mah)

    @property
    def volts(self) -> float:
        """Terminal voltage: a straight line down to 20 % charge, a steeper one below, as lithium packs fall off."""
        fraction = self.fraction
        if fraction >= 0.2:
            return self.full_volts - 1.4 * (1.0 - fraction) / 0.8
        return self.full_volts - 1.4 - 2.0 * (0.2 - fraction) / 0.2

    def drop_to(self, fraction: float) -> None:
        """A cell fails: what is left is at most this fraction."""
        self.used_mah = max(self.used_mah, (1.0 - fraction) * self.capacity_mah)


def wrapped(angle_rad: float) -> float:
    """The same angle within -pi to pi."""
    return math.remainder(angle_rad, math.tau)
