"""What the phase is decided by: facts of the vehicle, and of the drone's place in the swarm."""

from __future__ import annotations

import msgspec

from mission.strategies.contract import Order


class VehicleFacts(msgspec.Struct, frozen=True):
    """What the phase needs to know of the vehicle, from the autopilot's own reports."""

    connected: bool
    problem: str
    """Why the newest request to the autopilot failed for good, empty otherwise."""
    armed: bool
    airborne: bool
    ours: bool
    """The autopilot is in the mode in which it follows our setpoints."""
    mode: str
    taken_reason: str
    """How authority was lost, as the session saw it; empty while it was not."""
    at_takeoff_altitude: bool
    failsafe: bool = False
    """Authority was lost to a failsafe of the autopilot, not to a person."""
    returns: bool = False
    """The autopilot's mode is one in which it comes home by itself."""
    lands: bool = False
    """The autopilot's mode is one in which it lands where it is by itself."""
    crash: str = ""
    """How and where it crashed since it was armed; empty if it did not."""


class SwarmFacts(msgspec.Struct, frozen=True):
    """What the phase needs to know of the swarm and of the drone's own place in it."""

    order: Order | None
    member: bool
    """It holds a slot."""
    formed_up: bool
    """In its slot, or as near to it as it gets."""
    over_home: bool
    """Above its own home and low enough for the autopilot's landing."""
    stuck: bool
    """Returning, and no nearer to home for long: something is in the way that does not move."""
    must_return: str
    """Why this drone cannot go on (battery, sensor, ground station lost), empty if it can."""
    overdue: str = ""
    """Why the way home must end where the drone is, empty if it need not."""
    parted: bool = False
    """It must return because the swarm has come apart, and this is the smaller part."""
    handed_over: bool = False
    """It has announced that it leaves, and its heir has claimed its slot."""
    in_haste: bool = False
    """What is left in its battery does not let it wait for its heir."""
    flies_on: bool = False
    """Others that take part in the survey are heard steadily."""
    has_twin: bool = False
    """Another agent says, now, that it is this drone."""
