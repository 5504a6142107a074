"""The parts that a vehicle is put together of, as the others see them: a bridge to hardware may stand in for any."""

from __future__ import annotations

from typing import Protocol

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.vehicle.controller import Limits, Motion


class Body(Protocol):
    """What is moved: the truth, in the world's NED frame."""

    position: list[float]
    velocity: list[float]
    thrust: list[float]
    """Specific thrust, m/s^2, north, east, down."""
    yaw_rad: float
    on_ground: bool
    failed: bool
    """The motors give nothing any more."""
    turned_over: bool
    """It fell out of its attitude and stays on its back."""
    impact_mps: float | None
    """Speed at the last touch of the ground; whoever reads it sets it back to None."""

    def step(
        self, dt_s: float, wanted_thrust_mps2: Vector3, wanted_yaw_rad: float | None, wind_ned_mps: Vector3
    ) -> None: ...

    @property
    def attitude_rad(self) -> Vector3: ...

    @property
    def rates_radps(self) -> Vector3: ...

    @property
    def throttle_fraction(self) -> float: ...


class MotionEstimate(Protocol):
    """What the autopilot's own sensors make of the motion: its local NED frame, and that frame on the earth."""

    gps: bool
    """There is a fix."""
    gps_error_north_m: float
    origin_ned_m: Vector3
    """The local frame's origin in the world's frame."""
    position_m: Vector3
    velocity_mps: Vector3

    def step(self, now_s: float, dt_s: float, position: list[float], velocity: list[float]) -> None: ...

    def lost_for_s(self, now_s: float) -> float: ...

    def geodetic(self, position_m: Vector3) -> Geodetic: ...

    def local(self, point: Geodetic) -> Vector3: ...


class MotionController(Protocol):
    """From the wanted motion to the wanted specific thrust (m/s^2, NED)."""

    def reset(self) -> None: ...

    def step(
        self, dt_s: float, motion: Motion, position_m: Vector3, velocity_mps: Vector3, limits: Limits
    ) -> Vector3: ...


class PowerSupply(Protocol):
    full_volts: float
    current_a: float
    used_mah: float

    def step(self, dt_s: float, motors_on: bool, thrust_mps2: list[float]) -> None: ...

    @property
    def fraction(self) -> float: ...

    @property
    def volts(self) -> float: ...

    def drop_to(self, fraction: float) -> None: ...
