"""What an autopilot makes of the lists that are uploaded to it: what it refuses, and what accepting one changes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.fences import Area, FenceError, areas_of
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.mission_run import ACTIONS, NAVIGATION
from simvehicle.autopilot.missions import FENCE, MISSION, RALLY, ListRules, StoredItem

_ITEM_FRAMES = frozenset(
    (
        mavlink.MAV_FRAME_MISSION,
        mavlink.MAV_FRAME_GLOBAL,
        mavlink.MAV_FRAME_GLOBAL_INT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    )
)


@dataclasses.dataclass(frozen=True, slots=True)
class ListStyle:
    """How an autopilot keeps its lists."""

    legacy_requests: bool
    """Ask for items with MISSION_REQUEST (ArduPilot) instead of MISSION_REQUEST_INT."""
    atomic: bool
    """PX4 keeps the old list until the new one is whole; ArduPilot writes item by item."""
    stored: Callable[[int, StoredItem], StoredItem]
    """(list, item) -> what is kept of an item that can be flown."""
    read: Callable[[int, int, StoredItem], StoredItem]
    """(list, sequence, item) -> what a download gets."""
    accepted: Callable[[int, list[StoredItem]], None]
    """A list was replaced."""
    progress: Callable[[int, int], None]
    """(list, items now stored)"""
    refuses_fences: bool = True
    """A fence that is none is refused; PX4 takes it, and says afterwards what is wrong with it."""


class FenceAreas:
    """The uploaded fence."""

    def __init__(self) -> None:
        self.areas: tuple[Area, ...] = ()


class UploadedLists:
    def __init__(
        self,
        style: ListStyle,
        progress: MissionProgress,
        fence: FenceAreas,
        local: Callable[[Geodetic], Vector3],
        say: Callable[[int, str], None],
    ) -> None:
        self._style = style
        self._progress = progress
        self._fence = fence
        self._local = local
        self._say = say

    def rules(self) -> ListRules:
        """For the protocol's side."""
        return ListRules(
            legacy_requests=self._style.legacy_requests,
            atomic=self._style.atomic,
            stored=self._stored,
            finished=self._finished,
            progress=self._style.progress,
            read=self._style.read,
            set_current=self._progress.set_current,
        )

    def _stored(self, kind: int, item: StoredItem) -> StoredItem | int:
        """Refuse what no autopilot can fly, keep the rest as the flavour stores it."""
        if kind == MISSION and item.command not in NAVIGATION | ACTIONS:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if kind == RALLY and item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if item.frame not in _ITEM_FRAMES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        is_place = kind != MISSION or item.command in NAVIGATION
        if is_place and not (abs(item.x) <= 900_000_000 and abs(item.y) <= 1_800_000_000):
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        if is_place and not math.isfinite(item.z):
            return int(mavlink.MAV_MISSION_INVALID_PARAM7)
        return self._style.stored(kind, item)

    def _finished(self, kind: int, items: list[StoredItem]) -> int:
        if kind == FENCE:
            try:
                self._fence.areas = areas_of(items, self._local)
            except FenceError as error:
                if self._style.refuses_fences:
                    self._say(mavlink.MAV_SEVERITY_WARNING, str(error))
                    return int(mavlink.MAV_MISSION_INVALID_PARAM1)
                self._fence.areas = ()
        if kind == MISSION:
            self._progress.replaced(items)
        self._style.accepted(kind, items)
        return int(mavlink.MAV_MISSION_ACCEPTED)
