"""Vehicles as their autopilots describe them over MAVLink, on any of the station's links.

All state is kept by (link, system, component): two links of one vehicle may say different things, and the fresher
one speaks. What a component is, its ids and its own heartbeat say.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.statustext import StatusText
from flightstack.mavlink.vehicle_state import Role, VehicleState
from mission.geometry.frames import LocalFrame

_TEXTS_KEPT: Final = 100
_COMPONENTS_KEPT: Final = 512
"""More than any radio carries: a fault that makes up sources must not fill the memory."""
_AGENT: Final = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
"""The component that agents are (`flightstack.autopilot.session`)."""


class Source(NamedTuple):
    """Where a MAVLink message came from."""

    link: int
    """Index of the link in the configuration."""
    system: int
    component: int


class Acknowledgement(NamedTuple):
    command: int
    result: int
    """MAV_RESULT."""
    time_s: float


class Component(VehicleState):
    """One MAVLink component on one link. Times are the receiver's, seconds on its own clock."""

    def __init__(self, source: Source, frame: LocalFrame | None) -> None:
        super().__init__(source.system, source.component, frame)
        self.source = source
        self.acknowledgement: Acknowledgement | None = None
        """The newest COMMAND_ACK."""
        self._handlers[mavlink.MAVLINK_MSG_ID_COMMAND_ACK] = self._command_ack

    def airborne(self, now_s: float) -> bool:
        """Whether it flies. An armed vehicle of which nothing tells is taken to: it may have to be brought home."""
        return self.flies(now_s) is not False

    def take_texts(self) -> list[StatusText]:
        """The newest status texts since the last call."""
        taken = self.new_texts[-_TEXTS_KEPT:]
        self.new_texts.clear()
        return taken

    def _command_ack(self, now_s: float, fields: Any) -> None:
        self.acknowledgement = Acknowledgement(fields.command, fields.result, now_s)


class Vehicles:
    """Every MAVLink component heard on any link."""

    def __init__(self, frame: LocalFrame | None) -> None:
        self._frame = frame
        self.components: dict[Source, Component] = {}

    def receive(self, now_s: float, link: int, message: MavlinkMessage) -> Component:
        """Take one message that came over `link`; returns the component that sent it."""
        source = Source(link, message.system, message.component)
        component = self.components.get(source)
        if component is None:
            component = self.components[source] = Component(source, self._frame)
            while len(self.components) > _COMPONENTS_KEPT:
                self._forget_one(component)
        component.accept(now_s, message)
        return component

    def _forget_one(self, newest: Component) -> None:
        """Of those that are no autopilots, else of all, the one whose heartbeat came longest ago."""
        others = (c for c in self.components.values() if c is not newest)
        victim = min(others, key=lambda c: (c.role is Role.AUTOPILOT, c.heartbeat_s or -math.inf))
        del self.components[victim.source]

    def autopilots(self) -> list[Component]:
        return [c for c in self.components.values() if c.role is Role.AUTOPILOT]

    def systems(self) -> set[int]:
        """System ids of all vehicles heard so far."""
        return {c.source.system for c in self.autopilots()}

    def autopilot(self, system: int) -> Component | None:
        """The autopilot of a vehicle, on the link that it was last heard on."""
        heard = [c for c in self.autopilots() if c.source.system == system]
        return max(heard, key=lambda c: c.heartbeat_s or 0.0, default=None)

    def companion_age_s(self, system: int, now_s: float) -> float:
        """Since the agent of this vehicle was heard over MAVLink (autopilots forward it). Other programs on its
        companion say nothing about the agent's life."""
        ages = [
            c.age_s(now_s)
            for c in self.components.values()
            if c.source.system == system and c.source.component == _AGENT and c.role is Role.COMPANION
        ]
        return min(ages, default=math.inf)
