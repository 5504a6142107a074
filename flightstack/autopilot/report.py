"""What the session knows of the vehicle at one instant, as one frozen value."""

from __future__ import annotations

import enum

import msgspec

from flightstack.mavlink.modes import Duty, Flavour
from flightstack.mavlink.obstacle_distance import Ranges
from flightstack.mavlink.statustext import StatusText
from mission.geometry.frames import Vector3


class TakenBy(enum.StrEnum):
    """Who ended our authority over the vehicle in this flight."""

    NOBODY = "nobody"
    PILOT = "pilot"
    """A person, by remote control or ground station: a mode that we did not ask for, and no failsafe in sight."""
    AUTOPILOT = "autopilot"
    """The autopilot itself: fence, estimator, battery, lost link."""


class VehicleReport(msgspec.Struct, frozen=True, kw_only=True):
    """A snapshot. Positions are in the swarm's frame; ages are on the agent's clock, None before the first value."""

    connected: bool
    """A heartbeat of our own autopilot came within the last 5 s."""
    heartbeat_age_s: float | None
    flavour: Flavour
    armed: bool
    airborne: bool
    mode: str
    """The autopilot's mode in its own words, "" before the first heartbeat."""
    mode_ours: bool
    """The mode is GUIDED or OFFBOARD and nobody took the vehicle from us since the last arming or `take_control`."""
    taken_by: TakenBy
    way_down: Duty | None = None
    """How the autopilot brings the vehicle to the ground in this mode (RETURN, LAND); None where it does not."""
    taken_reason: str
    """Why and how authority was lost, in words; empty while it was not."""
    ready: bool
    """The autopilot may be armed as far as it tells."""
    ready_reason: str
    """What it still waits for, or why it refused the last arming; empty otherwise."""
    position_ned_m: Vector3 | None
    """The newest position that the autopilot's estimator vouched for."""
    position_age_s: float | None
    velocity_ned_mps: Vector3 | None
    attitude_rad: Vector3 | None
    """Roll, pitch, yaw."""
    attitude_age_s: float | None
    heading_rad: float | None
    """The nose's direction from true north towards east, 0 to 2 pi."""
    home_ned_m: Vector3 | None
    """Where the autopilot will return to."""
    battery_fraction: float | None
    battery_voltage_v: float | None
    wind_ned_mps: Vector3 | None
    """The autopilot's own estimate of where the air goes, if one came since the last `step`."""
    wind_sd_mps: float | None
    """Standard deviation of `wind_ned_mps` per horizontal axis; None where the autopilot does not say."""
    crash: str
    """How it crashed since it was armed, in words; empty if it did not. A wreck is not `airborne`, unless it
    is armed and high over home: then it may be none."""
    failsafe: bool
    """A failsafe acts or has taken the vehicle."""
    failsafe_reason: str
    ranges: Ranges | None
    """The newest look around of a range finder, while it is fresh."""
    ranges_age_s: float | None
    """Since the newest one came; None before the first."""
    named_values: tuple[tuple[str, float], ...]
    """NAMED_VALUE_FLOATs (name, value) since the last `step`: how instruments behind the autopilot report."""
    new_texts: tuple[StatusText, ...]
    """Status texts since the last `step`."""
    stood_still_s: float
    """How long we ourselves did nothing before this tick, while the vehicle needed our setpoints; mostly 0."""
    notes: tuple[str, ...]
    """What an operator should know: streams that do not come, an autopilot with a wrong system id."""
