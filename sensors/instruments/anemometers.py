"""What all anemometers share: how they sit on the airframe, and the one place where "from" becomes
"towards"."""

from __future__ import annotations

import math
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from mission.geometry.frames import Vector3
from sensors.instruments.samples import InstrumentState, Quantity, Sample

MPS_PER_UNIT: Final = {"M": 1.0, "N": 1852.0 / 3600.0, "K": 1.0 / 3.6, "P": 0.44704, "F": 0.00508}
"""Metres per second in a metre per second, a knot, a km/h, a mile per hour and a foot per minute, by their
letters."""


class Mounting(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of every anemometer."""

    mount_yaw_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    """From the drone's nose to the instrument's north mark, clockwise seen from above."""
    upside_down: bool = False
    """Hung below the drone, rolled over about the line through its north mark."""
    sd_mps: Annotated[float, Meta(gt=0.0)] | None = None
    """Standard deviation of one reading per axis; None: as its data sheet says."""


def body_axes(north_mps: float, east_mps: float, up_mps: float, mounting: Mounting) -> Vector3:
    """Where the air goes in body axes, from where it goes in the instrument's (its marks for north and east,
    and up)."""
    right, down = east_mps, 0.0 - up_mps  # never -0.0, which reads odd, nor below
    if mounting.upside_down:
        right, down = -right, -down
    turn = math.radians(mounting.mount_yaw_deg)
    forward = north_mps * math.cos(turn) - right * math.sin(turn)
    return 0.0 + forward, 0.0 + north_mps * math.sin(turn) + right * math.cos(turn), down


def towards(speed_mps: float, from_deg: float) -> tuple[float, float]:
    """North and east components of where the air goes, from a speed and the direction that it comes from."""
    angle = math.radians(from_deg + 180.0)
    return speed_mps * math.cos(angle), speed_mps * math.sin(angle)


def wind_sample(
    now_s: float,
    instrument: str,
    north_mps: float,
    east_mps: float,
    up_mps: float | None,
    *,
    mounting: Mounting,
    sd_mps: float,
    range_mps: float,
    status: str = "",
    temperature_c: float | None = None,
    pressure_pa: float | None = None,
) -> Sample:
    """A wind reading, checked: what is not finite or beyond the instrument's range is no value."""
    reason = ""
    speed_mps = math.sqrt(north_mps**2 + east_mps**2 + (up_mps or 0.0) ** 2)
    if not math.isfinite(speed_mps):
        reason = "the reading is not a number"
    elif speed_mps > range_mps:
        reason = f"{speed_mps:.1f} m/s is beyond its range of {range_mps:g} m/s"
    if reason:
        return without_value(now_s, instrument, InstrumentState.ERROR, reason, status)
    return Sample(
        time_s=now_s,
        instrument=instrument,
        state=InstrumentState.MEASURING,
        status=status,
        wind_body_mps=body_axes(north_mps, east_mps, up_mps or 0.0, mounting),
        wind_down_measured=up_mps is not None,
        wind_sd_mps=mounting.sd_mps or sd_mps,
        temperature_c=temperature_c,
        pressure_pa=pressure_pa,
        quantity=Quantity.WIND,
    )


def without_value(
    now_s: float, instrument: str, state: InstrumentState, reason: str, status: str = ""
) -> Sample:
    return Sample(now_s, instrument, state, status=status, reason=reason, quantity=Quantity.WIND)
