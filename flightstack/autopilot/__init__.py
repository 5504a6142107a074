"""The session with the autopilot: ArduPilot and PX4 behind one report and one set of requests.

`framing` finds messages in bytes, `telemetry` keeps what they say, `authority` knows whose the vehicle is, `streams`
asks for messages, `exchanges` are single questions, `requests`, `arming` and `takeoff` what the agent can ask, and
`session` ties them to the tick.
"""

from __future__ import annotations

from flightstack.autopilot.report import TakenBy, VehicleReport
from flightstack.autopilot.requests import RequestKind, RequestOutcome, RequestResult
from flightstack.autopilot.session import AutopilotSession
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.statustext import StatusText

__all__ = [
    "AutopilotSession",
    "Flavour",
    "RequestKind",
    "RequestOutcome",
    "RequestResult",
    "StatusText",
    "TakenBy",
    "VehicleReport",
]
