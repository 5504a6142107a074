"""The wind filter's numbers."""

from __future__ import annotations

from typing import Final

import msgspec

from mission.geometry.frames import Vector3
from sensors.filters.airframe import DragModel

UNCALIBRATED_DRAG_SCALE_SD: Final = 0.4
"""How well the drag of an airframe is known that nobody has calibrated, as a fraction."""


class WindFilterConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    gust_sd_mps: float = 0.5
    """Standard deviation of the gusts per horizontal axis."""
    gust_time_s: float = 5.0
    """Correlation time of the gusts."""
    vertical_share: float = 0.5
    """Vertical gusts over horizontal ones (near the ground; R. B. Stull, "Boundary Layer Meteorology",
    1988)."""
    mean_sd_mps: float = 6.0
    """Standard deviation of the mean wind before anything is known."""
    mean_vertical_sd_mps: float = 1.0
    """The same for the vertical: over more than a few seconds air near the ground hardly rises or sinks."""
    mean_walk_mps_per_sqrt_min: float = 0.7
    """Random walk of the mean wind: standard deviation after a minute."""
    anemometer_sd_mps: float = 0.3
    """Where a sample does not state its own."""
    anemometer_bias_mps: float = 0.1
    """What an anemometer's error keeps over minutes: calibration, rotor wash."""
    anemometer_arms_body_m: dict[str, Vector3] = {}
    """Where each anemometer (by its name) sits, from the centre of rotation: forward, right, down."""
    attitude_sd_rad: float = 0.01
    velocity_sd_mps: float = 0.05
    """Noise of the autopilot's velocity, from one message to the next."""
    motion_lag_s: float = 0.02
    """How old the vehicle's motion may be against an anemometer's reading."""
    drag: DragModel | None = DragModel()
    """None: the tilt is not used."""
    drag_window_s: float = 1.0
    drag_scale_sd: float = 0.05
    """How well the drag coefficient is known, as a fraction, where it was calibrated."""
    level_sd_rad: float = 0.004
    """How level the autopilot's horizon and the rotors' plane are to each other; this error stays for a
    flight."""
    autopilot_sd_mps: float = 1.0
    """Where the autopilot does not state its own."""
    autopilot_memory_s: float = 5.0
    """How long the errors of the autopilot's estimate last."""
    gate_sd: float = 5.0
    fresh_s: float = 3.0
    lost_s: float = 15.0

    def __post_init__(self) -> None:
        for name in (
            "gust_sd_mps",
            "gust_time_s",
            "anemometer_sd_mps",
            "velocity_sd_mps",
            "drag_window_s",
            "lost_s",
        ):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} {getattr(self, name)} is not a positive number")
