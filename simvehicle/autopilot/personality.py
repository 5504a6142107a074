"""What makes an autopilot an ArduPilot or a PX4: the parts that differ, and what they are given to work on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from simvehicle.autopilot.announcer import Announcer, TextStyle
from simvehicle.autopilot.channel import Handler
from simvehicle.autopilot.commands import AnswerStyle, Execute
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.message_streams import Build, StreamStyle
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.mission_run import Told
from simvehicle.autopilot.missions import StoredItem
from simvehicle.autopilot.parameters import Parameters, ParameterStyle
from simvehicle.autopilot.pilot import PilotInputs, RemoteControl
from simvehicle.autopilot.reports import EstimatorReport, HealthReport, ModeReport
from simvehicle.autopilot.uploaded_lists import FenceAreas, ListStyle
from simvehicle.vehicle.controller import Limits
from simvehicle.vehicle.dynamics import Battery


@dataclasses.dataclass(frozen=True, slots=True)
class SharedParts:
    """What both flavours build upon; each of their services takes of it what it needs."""

    system: int
    flight: Flight
    parameters: Parameters
    announcer: Announcer
    lists: Mapping[int, list[StoredItem]]
    """The uploaded lists as they are now."""
    fence: FenceAreas
    remote: RemoteControl
    ground_heard_s: Mapping[int, float]
    """When every ground station was last heard, by system."""
    set_parameter: Callable[[str, float], None]
    quiet: bool
    """Its companion's link carries no more than the others: so many simulated vehicles fit into one computer."""


class FlightEvents(Protocol):
    """What a flavour does when something happens."""

    def slow_step(self, now_s: float) -> None:
        """Boot, failsafes, arming and mode logic; ten times a second."""
        ...

    def touched(self, impact_mps: float) -> None:
        """The vehicle touched the ground at this speed."""
        ...

    def crashed(self, impact_mps: float) -> None:
        """It touched the ground too fast to fly again."""
        ...

    def landed(self) -> None: ...

    def mission(self, told: Told, sequence: int) -> None:
        """The mission started, reached or finished an item."""
        ...

    def parameter_changed(self, name: str) -> None: ...

    def setpoint(self, message: Any) -> None:
        """SET_POSITION_TARGET_LOCAL_NED or _GLOBAL_INT"""
        ...


@dataclasses.dataclass(frozen=True, slots=True)
class Identity:
    """What a flavour calls itself in messages."""

    mav_autopilot: int
    gps_fix_type: int
    vtol_state: int
    no_mission_total: int
    """MISSION_CURRENT.total where there is no mission."""


@dataclasses.dataclass(frozen=True, slots=True)
class Personality:
    identity: Identity
    modes: ModeReport
    estimate: EstimatorReport
    health: HealthReport
    progress: MissionProgress
    lists: ListStyle
    parameters: ParameterStyle
    streams: StreamStyle
    messages: Mapping[int, Build]
    """Those that the flavours make differently."""
    commands: Mapping[int, Execute]
    handlers: Mapping[str, Handler]
    """What it takes besides, by message type."""
    split_mode: Callable[[int], tuple[int, int]]
    """SET_MODE's custom mode as main and sub mode."""
    answers: AnswerStyle
    pilot: PilotInputs
    events: FlightEvents
    switch_mode: Callable[[int], object]
    """To a custom mode, as the pilot's switch does."""
    unheard: set[str]
    """What a failsafe misses on purpose: "remote_control", "ground_link"."""


class FlavourRecipe(NamedTuple):
    """How to build a flavour."""

    system_parameter: str
    """The parameter that holds the system id."""
    limits: Callable[[Parameters], Limits]
    battery: Callable[[Parameters], Battery]
    texts: TextStyle
    weak_battery_fraction: float
    """Of charge: there the battery failsafe acts with the parameters as they come."""
    build: Callable[[SharedParts], Personality]
