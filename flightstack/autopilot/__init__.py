"""The session with the agent's autopilot: ArduPilot and PX4 behind one report and one set of requests."""

from __future__ import annotations

from flightstack.autopilot.own_fence import OwnFence
from flightstack.autopilot.report import TakenBy, VehicleReport
from flightstack.autopilot.requests import RequestKind, RequestOutcome, RequestResult
from flightstack.autopilot.session import AutopilotSession
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.statustext import StatusText

__all__ = [
    "AutopilotSession",
    "Flavour",
    "OwnFence",
    "RequestKind",
    "RequestOutcome",
    "RequestResult",
    "StatusText",
    "TakenBy",
    "VehicleReport",
]
