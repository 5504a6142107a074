"""What PX4 makes of lists: it takes whatever comes, and says a moment later what is wrong with it."""

from __future__ import annotations

import dataclasses
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic
from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.mission_run import NAVIGATION
from simvehicle.autopilot.missions import FENCE, MISSION, StoredItem
from simvehicle.autopilot.px4_voice import Px4Voice
from simvehicle.autopilot.uploaded_lists import FenceAreas, ListStyle

_CRITICAL, _ERROR = mavlink.MAV_SEVERITY_CRITICAL, mavlink.MAV_SEVERITY_ERROR
_LOOKS_AFTER_S = 0.25
"""As recorded of a fence; of a mission it is at once."""
_NOWHERE = frozenset((mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, mavlink.MAV_CMD_NAV_DELAY))


class Px4Lists:
    def __init__(self, flight: Flight, fence: FenceAreas, voice: Px4Voice) -> None:
        self._flight = flight
        self._fence = fence
        self._voice = voice
        self._progress: MissionProgress | None = None
        self._mission_at_s: float | None = None
        self._fence_at_s: float | None = None
        self._has_fence = False

    def check_by(self, progress: MissionProgress) -> None:
        self._progress = progress

    def style(self) -> ListStyle:
        return ListStyle(
            legacy_requests=False,
            atomic=True,
            stored=_stored,
            read=lambda _kind, _sequence, item: item,
            accepted=self._accepted,
            progress=lambda _kind, _count: None,
            refuses_fences=False,
        )

    def step(self, now_s: float) -> None:
        if self._fence_at_s is not None and now_s >= self._fence_at_s:
            self._fence_at_s = None
            self._check_fence()
        if self._mission_at_s is not None and now_s >= self._mission_at_s:
            self._mission_at_s = None
            self._check_mission()

    def _accepted(self, kind: int, items: list[StoredItem]) -> None:
        now_s = self._flight.now_s
        if kind == FENCE:
            self._has_fence, self._fence_at_s = bool(items), now_s + _LOOKS_AFTER_S
            self._mission_at_s = now_s + _LOOKS_AFTER_S
        elif kind == MISSION:
            self._mission_at_s = now_s

    def _check_fence(self) -> None:
        nav = self._flight.nav
        if not self._has_fence:
            return
        for place, name, what in (
            (nav.home_m, "navigator_geofence_invalid_against_home", "Home position"),
            (nav.position_m, "navigator_geofence_invalid_against_cur_pos", "current vehicle position"),
        ):
            if not self._fence.areas or outside(self._fence.areas, place[0], place[1], any_inclusion=True):
                self._voice.tell(name, _CRITICAL, text=f"Geofence invalid, doesn't contain {what}")

    def _check_mission(self) -> None:
        """A waypoint out of the fence makes the whole mission one that is not flown."""
        progress, areas = self._progress, self._fence.areas
        if progress is None:
            return
        progress.rejected = False
        local = self._flight.vehicle.estimator.local
        for place, item in enumerate(progress.items):
            if item.command not in NAVIGATION or item.command in _NOWHERE or (item.x == 0 and item.y == 0):
                continue
            north_m, east_m, _ = local(Geodetic(item.x / 1e7, item.y / 1e7))
            if areas and outside(areas, north_m, east_m, any_inclusion=True):
                progress.rejected = True
                text = f"Geofence violation for waypoint {place + 1}"
                told = struct.pack("<h", place + 1)
                self._voice.tell(
                    "navigator_mis_geofence_violation", _ERROR, told, text=text, text_severity=_CRITICAL
                )
                return


def _stored(_kind: int, item: StoredItem) -> StoredItem:
    return dataclasses.replace(item, frame={5: 0, 6: 3}.get(item.frame, item.frame))
