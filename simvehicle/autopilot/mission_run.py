"""Flying the uploaded mission, item by item."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.maneuvers import FlyTo, HoldPosition, Land, Maneuver, Navigation, Return, TakeOff
from simvehicle.autopilot.missions import StoredItem
from simvehicle.vehicle.controller import Motion

_WAYPOINTS = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT)
_LOITERS = (
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LOITER_TURNS,
)
_DELAYS = (mavlink.MAV_CMD_NAV_DELAY, mavlink.MAV_CMD_CONDITION_DELAY)
NAVIGATION = frozenset(
    (
        *_WAYPOINTS,
        *_LOITERS,
        *_DELAYS,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    )
)
"""What takes time; every other item is done at once."""
ACTIONS = frozenset(
    (
        mavlink.MAV_CMD_DO_JUMP,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_SET_HOME,
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_SET_RELAY,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_MOUNT_CONFIGURE,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_LAND_START,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
    )
)
_RELATIVE_FRAMES = (
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)
NAMES = {16: "WP", 17: "LoitUnlim", 18: "LoitTurns", 19: "LoitTime", 20: "RTL", 21: "Land", 22: "Takeoff"}
NAMES |= {82: "SplineWP", 93: "Delay", 112: "ConditionDelay"}


class Told(enum.Enum):
    STARTED = "started"
    REACHED = "reached"
    COMPLETE = "complete"


@dataclasses.dataclass(frozen=True, slots=True)
class Surroundings:
    """What the autopilot gives a mission."""

    local: Callable[[Geodetic], Vector3]
    home_amsl_m: float
    arrival_m: float
    back: Callable[[], Return]
    """A new return-to-launch."""
    first: int
    """Sequence number of the first item to fly: ArduPilot's item 0 is home."""


class MissionRun:
    """A manoeuvre made of manoeuvres. `told` collects what happened; the autopilot empties it."""

    def __init__(self, items: Sequence[StoredItem], around: Surroundings, current: int) -> None:
        self._items = items
        self._around = around
        self.current = max(current, around.first)
        self.told: list[tuple[Told, int]] = []
        self.finished = False
        self._maneuver: Maneuver | None = None
        self._arrived_s: float | None = None
        self._speed_mps: float | None = None
        self._jumps: dict[int, int] = {}
        self._last_m: Vector3 | None = None

    @property
    def command(self) -> int | None:
        """The navigation command being flown."""
        return self._items[self.current].command if self.current < len(self._items) else None

    @property
    def maneuver(self) -> Maneuver | None:
        return self._maneuver

    def go_to(self, sequence: int) -> bool:
        if not self._around.first <= sequence < len(self._items):
            return False
        self.current = sequence
        self._maneuver = None
        self.finished = False
        return True

    def step(self, nav: Navigation) -> Motion:
        if self.finished and self._maneuver is not None:
            return self._maneuver.step(nav)
        for _ in range(len(self._items) + 1):  # a mission of jumps only must not hang the simulation
            if self._maneuver is None and not self._begin(nav):
                break
            if self._maneuver is None:
                continue
            motion = self._maneuver.step(nav)
            if not self._done(nav, self._maneuver):
                return motion
            self.told.append((Told.REACHED, self.current))
            self._maneuver = None
            self.current += 1
        self.finished = True
        self.told.append((Told.COMPLETE, len(self._items) - 1))
        self._maneuver = HoldPosition(self._last_m if nav.airborne else None)
        return self._maneuver.step(nav)

    def _begin(self, nav: Navigation) -> bool:
        """Start the current item. False at the end of the mission; an action leaves `_maneuver` None."""
        if self.current >= len(self._items):
            return False
        item = self._items[self.current]
        if item.command not in NAVIGATION:
            self._act(item)
            return True
        self._arrived_s = None
        self._maneuver = self._maneuver_for(item, nav)
        self.told.append((Told.STARTED, self.current))
        return True

    def _act(self, item: StoredItem) -> None:
        if item.command == mavlink.MAV_CMD_DO_CHANGE_SPEED and item.p2 > 0.0:
            self._speed_mps = item.p2
        if item.command == mavlink.MAV_CMD_DO_JUMP:
            made = self._jumps.get(self.current, 0)
            # a comparison with NaN is false: such a jump is passed over
            if (item.p2 < 0 or made < item.p2) and self._around.first <= item.p1 < len(self._items):
                self._jumps[self.current] = made + 1
                self.current = int(item.p1)
                return
        self.current += 1

    def _maneuver_for(self, item: StoredItem, nav: Navigation) -> Maneuver:
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            above_m = -self._down_m(item, nav) + nav.home_m[2]
            if nav.airborne and nav.above_home_m > above_m - 0.5:
                return _Done()
            return TakeOff(above_m)
        if item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return self._around.back()
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            if item.x == 0 and item.y == 0:
                return Land()
            return _GoAndLand(self._place(item, nav, nav.position_m[2]))
        if item.command in _DELAYS:
            return HoldPosition(self._last_m)
        place = self._place(item, nav, self._down_m(item, nav))
        self._last_m = place
        return FlyTo(place, speed_mps=self._speed_mps, arrival_m=self._around.arrival_m)

    def _place(self, item: StoredItem, nav: Navigation, down_m: float) -> Vector3:
        if item.x == 0 and item.y == 0:  # both autopilots: where it is
            return nav.position_m[0], nav.position_m[1], down_m
        north, east, _ = self._around.local(Geodetic(item.x / 1e7, item.y / 1e7))
        return north, east, down_m

    def _down_m(self, item: StoredItem, nav: Navigation) -> float:
        above_home_m = item.z if item.frame in _RELATIVE_FRAMES else item.z - self._around.home_amsl_m
        return nav.home_m[2] - above_home_m

    def _done(self, nav: Navigation, maneuver: Maneuver) -> bool:
        item = self._items[self.current]
        if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            return False
        if item.command in _DELAYS:
            self._arrived_s = nav.now_s if self._arrived_s is None else self._arrived_s
        elif not maneuver.finished:
            return False
        elif self._arrived_s is None:
            self._arrived_s = nav.now_s
        waits = item.command in _WAYPOINTS or item.command in _DELAYS or item.command in _LOITERS
        wait_s = item.p1 if waits and math.isfinite(item.p1) else 0.0
        return nav.now_s - self._arrived_s >= wait_s


class _Done:
    """Nothing left to do: a take-off at height already."""

    finished = True

    def step(self, nav: Navigation) -> Motion:
        return Motion(horizontal_mps=(0.0, 0.0), down_m=nav.position_m[2])


class _GoAndLand:
    """To a place at the present height, then down."""

    def __init__(self, place_m: Vector3) -> None:
        self._go = FlyTo(place_m, arrival_m=1.0)
        self.land = Land(at_m=(place_m[0], place_m[1]))
        self.finished = False

    def step(self, nav: Navigation) -> Motion:
        if not self._go.finished and nav.airborne:
            return self._go.step(nav)
        motion = self.land.step(nav)
        self.finished = self.land.finished
        return motion
