"""How ArduCopter keeps missions, fences and rally points."""

from __future__ import annotations

import dataclasses
import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.missions import FENCE, MISSION, RALLY, StoredItem
from simvehicle.autopilot.parameters import UNASKED, Parameters
from simvehicle.autopilot.uploaded_lists import ListStyle

_TOTALS = {MISSION: "MIS_TOTAL", FENCE: "FENCE_TOTAL", RALLY: "RALLY_TOTAL"}


class ArduPilotLists:
    def __init__(self, flight: Flight, parameters: Parameters, announcer: Announcer) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer

    def style(self) -> ListStyle:
        return ListStyle(
            legacy_requests=True,
            atomic=False,
            stored=_stored,
            read=self._read,
            accepted=self._accepted,
            progress=self._progress,
        )

    def _read(self, kind: int, sequence: int, item: StoredItem) -> StoredItem:
        """Item 0 of a mission is home."""
        if kind != MISSION or sequence != 0:
            return item
        home = self._flight.home
        command = mavlink.MAV_CMD_NAV_WAYPOINT
        if home is None:
            return StoredItem(mavlink.MAV_FRAME_GLOBAL, command, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
        x, y = round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7)
        return StoredItem(mavlink.MAV_FRAME_GLOBAL, command, 0.0, 0.0, 0.0, 0.0, x, y, round(home.amsl_m, 2))

    def _progress(self, kind: int, count: int) -> None:
        self._parameters.set(_TOTALS[kind], count)
        if kind == MISSION:
            self._announcer.broadcast(self._parameters.message(_TOTALS[kind], UNASKED))

    def _accepted(self, kind: int, items: list[StoredItem]) -> None:
        if kind == MISSION and items:
            self._announcer.say(mavlink.MAV_SEVERITY_INFO, "Flight plan received")
        elif kind == FENCE and items:
            self._announcer.say(mavlink.MAV_SEVERITY_DEBUG, "Fence Indexed OK")


def _stored(kind: int, item: StoredItem) -> StoredItem:
    """Packed: a waypoint's delay is whole seconds, altitudes are centimetres."""
    z = round(item.z, 2) if math.isfinite(item.z) else 0.0
    if kind == FENCE:
        return dataclasses.replace(item, frame=mavlink.MAV_FRAME_GLOBAL, autocontinue=0)
    if kind == RALLY:
        return dataclasses.replace(item, z=float(round(z)), autocontinue=0)
    frame = item.frame if item.x or item.y or item.z else mavlink.MAV_FRAME_GLOBAL
    frame = {5: 0, 6: 3, 11: 10}.get(frame, frame)
    p1 = item.p1
    if item.command == mavlink.MAV_CMD_NAV_WAYPOINT and math.isfinite(p1):
        p1 = float(max(0, min(65535, int(p1))))
    numbers = (0.0 if math.isnan(v) else v for v in (p1, item.p2, item.p3, item.p4))
    p1, p2, p3, p4 = numbers
    return dataclasses.replace(item, frame=frame, p1=p1, p2=p2, p3=p3, p4=p4, z=z)
