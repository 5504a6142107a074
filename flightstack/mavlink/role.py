"""What a MAVLink component is: an autopilot, a companion, a ground station, or something else on the same link."""

from __future__ import annotations

import enum
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import FLAVOURS, FLYING_TYPES

AUTOPILOT_COMPONENT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1


class Role(enum.StrEnum):
    """What a component is, by its ids and its own heartbeat."""

    UNKNOWN = "unknown"
    AUTOPILOT = "autopilot"
    COMPANION = "companion"
    GROUND = "ground"
    OTHER = "other"


def role_of(system: int, component: int, heartbeat: Any) -> Role:
    """Who sent this heartbeat.

    Receivers, gimbals, cameras, companions and ground stations share links and even system ids with a vehicle, some
    claim an autopilot, and what they send says nothing about the vehicle. An autopilot is component 1, of a flavour
    that we know, in something that flies (`docs/decisions/0012-who-is-an-autopilot.md`). System id 0 is everybody's,
    and so nobody's.
    """
    if heartbeat.type == mavlink.MAV_TYPE_GCS:
        return Role.GROUND
    if component == AUTOPILOT_COMPONENT and system != 0 and not why_not_flown(heartbeat):
        return Role.AUTOPILOT
    if heartbeat.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER:
        return Role.COMPANION
    return Role.OTHER


def why_not_flown(heartbeat: Any) -> str:
    """Why whoever sends this is no autopilot of an aircraft that we know; empty if it is one."""
    if heartbeat.autopilot not in FLAVOURS:
        return f"autopilot type {heartbeat.autopilot} is neither ArduPilot nor PX4"
    if heartbeat.type not in FLYING_TYPES:
        return f"vehicle type {heartbeat.type} (MAV_TYPE) is nothing that flies"
    return ""
