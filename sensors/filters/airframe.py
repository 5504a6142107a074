"""How a multirotor's own attitude and motion tell the wind: rotation, lever arm, and tilt against drag."""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

from mission.geometry.frames import Vector3

GRAVITY_MPS2: Final = 9.80665

Array = npt.NDArray[np.float64]


class VehicleMotion(msgspec.Struct, frozen=True):
    """What the autopilot says of the vehicle in this tick."""

    attitude_rad: Vector3
    """Roll, pitch, yaw of the body in NED (aerospace sequence: yaw, then pitch, then roll)."""
    velocity_ned_mps: Vector3
    angular_rate_radps: Vector3 | None = None
    """Body rates about forward, right, down; None: taken from the change of attitude."""
    acceleration_ned_mps2: Vector3 | None = None
    """Of the vehicle over ground; None: taken from the change of velocity."""
    airborne: bool = True
    """On the ground the legs hold against the wind, and the tilt tells nothing."""


class DragModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Deceleration of the airframe by its airspeed u (m/s): `linear_per_s` u + `quadratic_per_m` u^2.

    The linear part is the rotors' induced drag, the quadratic one the body's (M. Bangura, R. Mahony,
    "Nonlinear Dynamic Modeling for High Performance Control of a Quadrotor", ACRA 2012, section 3;
    ArduPilot's parameters EK3_DRAG_MCOEF and EK3_DRAG_BCOEF_X state the same two). The default is the simulated
    vehicle's. Airframes differ by a factor of two and more: ArduCopter 4.6.3's simulated quadrotor, hovering in
    1.4 to 4.6 m/s (its wind falls with the square root of the height), leans like 0.24 u + 0.034 u^2.
    """

    linear_per_s: float = 0.19
    quadratic_per_m: float = 0.0

    def __post_init__(self) -> None:
        if not (
            self.linear_per_s >= 0.0
            and self.quadratic_per_m >= 0.0
            and self.linear_per_s + self.quadratic_per_m > 0.0
        ):
            raise ValueError("drag coefficients must not be negative, nor both zero")

    def airspeed_mps(self, deceleration_mps2: float) -> float:
        """The airspeed that causes this deceleration (both not negative)."""
        a, b = self.quadratic_per_m, self.linear_per_s
        if a == 0.0:
            return deceleration_mps2 / b
        return (math.sqrt(b * b + 4.0 * a * deceleration_mps2) - b) / (2.0 * a)

    def slope_per_s(self, airspeed_mps: float) -> float:
        """Change of deceleration per change of airspeed."""
        return self.linear_per_s + 2.0 * self.quadratic_per_m * airspeed_mps


def body_to_ned(attitude_rad: Vector3) -> Array:
    """Rotation matrix from body axes (forward, right, down) to north, east, down."""
    roll, pitch, yaw = attitude_rad
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def point_velocity_ned_mps(
    motion: VehicleMotion, rotation: Array, arm_body_m: Vector3, rates_radps: Vector3
) -> Array:
    """Velocity over ground of a point fixed to the airframe: v + R (rates x arm)."""
    p, q, r = rates_radps
    x, y, z = arm_body_m
    turning = np.array((q * z - r * y, r * x - p * z, p * y - q * x))
    velocity: Array = np.array(motion.velocity_ned_mps) + rotation @ turning
    return velocity


def thrust_ned_mps2(attitude_rad: Vector3, acceleration_down_mps2: float) -> tuple[float, float]:
    """Horizontal specific force of the rotors, from the tilt and the vertical balance of forces.

    The rotors push along the body's negative down axis; how hard follows from what they do vertically:
    acceleration_down = g - f R33. Vertical drag is neglected: 1 m/s of updraught changes f by 2 %.
    """
    roll, pitch, yaw = attitude_rad
    cr, sr, sp = math.cos(roll), math.sin(roll), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    upright = max(math.cos(pitch) * cr, 0.2)
    thrust = (GRAVITY_MPS2 - acceleration_down_mps2) / upright
    return -thrust * (cy * sp * cr + sy * sr), -thrust * (sy * sp * cr - cy * sr)
