"""ArduCopter: its modes, its rules for taking off and for what is refused, its words.

The yardstick is a recorded flight of ArduCopter 4.6.3; where that is silent, https://ardupilot.org/copter/. Arming
and failsafes are in `ardupilot_safety`.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.ardupilot_commands import COMMANDS
from simvehicle.autopilot.ardupilot_modes import NEED_POSITION, RETURNS, STICKS, ArduPilotMode
from simvehicle.autopilot.ardupilot_safety import ArduPilotSafety
from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import ReceivedCommand
from simvehicle.autopilot.core import RC_AT_REST_US, Autopilot
from simvehicle.autopilot.fences import outside
from simvehicle.autopilot.maneuvers import Follow, HoldPosition, Idle, Land, Maneuver, Return, Sticks, TakeOff
from simvehicle.autopilot.mission_run import NAMES, MissionRun, Told
from simvehicle.autopilot.missions import FENCE, MISSION, RALLY, StoredItem
from simvehicle.autopilot.setpoints import motion_of
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.vehicle.controller import Limits
from simvehicle.vehicle.dynamics import Battery
from simvehicle.world.air import World

_INFO, _WARNING, _CRITICAL = (
    mavlink.MAV_SEVERITY_INFO,
    mavlink.MAV_SEVERITY_WARNING,
    mavlink.MAV_SEVERITY_CRITICAL,
)
_CAPABILITIES = 64495
"""As recorded."""
_VERSION = 4 << 24 | 6 << 16 | 3 << 8 | 255


class ArduPilot(Autopilot):
    flavour: ClassVar[Literal["ardupilot", "px4"]] = "ardupilot"
    mav_autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    gps_fix_type = mavlink.GPS_FIX_TYPE_RTK_FIXED
    vtol_state = mavlink.MAV_VTOL_STATE_MC

    _speed_mps: float | None = None

    def __init__(self, spec: VehicleSpec, ready_after_s: float, world: World, seed: int) -> None:
        self.mode = ArduPilotMode.STABILIZE
        super().__init__(spec, ready_after_s, world, seed)
        self.safety = ArduPilotSafety(self)
        self._override_s: float | None = None
        self.mission_started = False

    @property
    def system_parameter(self) -> str:
        return "SYSID_THISMAV"

    @property
    def custom_mode(self) -> int:
        return int(self.mode)

    def base_mode(self) -> int:
        flags = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        if self.mode in NEED_POSITION or (self.mode is ArduPilotMode.LAND and not self.estimator_lost):
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if self.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return int(flags)

    def new_limits(self) -> Limits:
        p = self.parameters
        speed_mps = self._speed_mps or p["WPNAV_SPEED"] / 100.0
        return Limits(
            speed_mps=speed_mps,
            most_mps=30.0,
            climb_mps=p["WPNAV_SPEED_UP"] / 100.0,
            descent_mps=p["WPNAV_SPEED_DN"] / 100.0,
            acceleration_mps2=max(0.5, p["WPNAV_ACCEL"] / 100.0),
            climb_acceleration_mps2=max(0.5, p["WPNAV_ACCEL_Z"] / 100.0),
            tilt_rad=math.radians(p["ANGLE_MAX"] / 100.0),
            land_mps=p["LAND_SPEED"] / 100.0,
            land_slow_below_m=p["LAND_ALT_LOW"] / 100.0,
            return_speed_mps=p["RTL_SPEED"] / 100.0 or speed_mps,
        )

    def new_battery(self) -> Battery:
        return Battery(self.parameters["BATT_CAPACITY"], self.parameters["SIM_BATT_VOLTAGE"])

    # -- state that messages tell ---------------------------------------------------------------------------

    @property
    def ready(self) -> bool:
        return self.safety.booted and self.safety.time_left_s <= 0.0

    @property
    def estimator_lost(self) -> bool:
        return self.safety.ekf_failed

    @property
    def position_ok(self) -> bool:
        return self.ready and not self.estimator_lost

    @property
    def estimates_wind(self) -> bool:
        p = self.parameters
        drag = p["EK3_DRAG_MCOEF"] or (p["EK3_DRAG_BCOEF_X"] and p["EK3_DRAG_BCOEF_Y"])
        return bool(drag) and not self.landed

    @property
    def gps_detected(self) -> bool:
        return self.safety.gps_detected

    @property
    def idle_status(self) -> bool:
        return True

    def estimator_flags(self) -> int:
        return self.safety.estimator_flags()

    def landed_state(self) -> int:
        if self.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        run = self.maneuver
        maneuver = run.maneuver if isinstance(run, MissionRun) else run
        if isinstance(maneuver, TakeOff):
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_LANDING if self.is_landing else mavlink.MAV_LANDED_STATE_IN_AIR)

    def mission_idle_state(self) -> int:
        return int(mavlink.MISSION_STATE_NOT_STARTED)

    def version(self) -> Any:
        return mavlink.MAVLink_autopilot_version_message(
            _CAPABILITIES,
            _VERSION,
            0,
            0,
            0,
            list(b"simvehic"),
            [0] * 8,
            [0] * 8,
            0,
            0,
            0,
            [self.system] + [0] * 17,
        )

    def health(self) -> tuple[int, int, int]:
        return self.safety.health()

    def fence_status(self) -> Any | None:
        return self.safety.fence_status()

    def first_streams(self) -> dict[int, float]:
        return {}

    # -- mode -----------------------------------------------------------------------------------------------

    def set_mode(self, number: int) -> bool:
        """Enter a mode, as a command, a failsafe or the pilot's switch wants it; False where it is refused."""
        try:
            mode = ArduPilotMode(number)
        except ValueError:
            self.say(_WARNING, f"No such mode {number}")
            return False
        if mode is self.mode:
            return True
        if self.armed and mode in NEED_POSITION and not self.position_ok:
            self.say(_WARNING, f"Mode change to {mode.name} failed: requires position")
            return False
        if self.armed and mode is ArduPilotMode.AUTO and not self.auto_allowed():
            return False
        self.mode = mode
        self.mode_is_news = True
        self.set_speed(None)
        self.enter()
        return True

    def auto_allowed(self) -> bool:
        items = self.missions.lists[MISSION]
        if len(items) < 2:
            self.say(_WARNING, "Mode change to AUTO failed: init failed")
            return False
        if self.landed and items[1].command != mavlink.MAV_CMD_NAV_TAKEOFF:
            self.say(_CRITICAL, "Auto: Missing Takeoff Cmd")
            return False
        return True

    def enter(self) -> None:
        """Begin what the present mode does."""
        self.mission_started = False
        self.maneuver = self._maneuver_of(self.mode) if self.armed else Idle()

    def _maneuver_of(self, mode: ArduPilotMode) -> Maneuver:
        if mode in STICKS:
            return Sticks(level=mode in (ArduPilotMode.STABILIZE, ArduPilotMode.ALT_HOLD))
        if mode is ArduPilotMode.LAND:
            return Land(with_position=self.position_ok)
        if mode in RETURNS:
            return self.back()
        if mode is ArduPilotMode.AUTO and not self.landed:
            return self.start_mission()
        return HoldPosition()

    def start_mission(self) -> MissionRun:
        self.mission_started = True
        if self.mission_complete or self.parameters["MIS_RESTART"]:
            self.mission_next = 0
            self.mission_complete = False
        return self.new_mission(*self.mission_rules())

    def mission_rules(self) -> tuple[int, float]:
        return 1, max(0.5, self.parameters["WPNAV_RADIUS"] / 100.0)

    def back(self) -> Return:
        to_m, down_m = self._return_point()
        return Return(to_m, travel_down_m=down_m, loiter_s=self.parameters["RTL_LOIT_TIME"] / 1000.0)

    def _return_point(self) -> tuple[Vector3, float]:
        """Home or the nearest rally point, and the altitude (local down, m) to go there at."""
        p, nav = self.parameters, self.nav
        here = nav.position_m[:2]
        best, above_m = nav.home_m, p["RTL_ALT"] / 100.0
        nearest_m = math.dist(here, best[:2]) if p["RALLY_INCL_HOME"] else math.inf
        for item in self.missions.lists[RALLY]:
            north, east, _ = self.estimator.local(Geodetic(item.x / 1e7, item.y / 1e7))
            away_m = math.dist(here, (north, east))
            if away_m < nearest_m and away_m <= 1000.0 * p["RALLY_LIMIT_KM"]:
                nearest_m, best, above_m = away_m, (north, east, nav.home_m[2]), item.z
        away_m = math.dist(here, best[:2])
        cone_m = max(2.0, away_m * p["RTL_CONE_SLOPE"]) if p["RTL_CONE_SLOPE"] >= 0.5 else math.inf
        climb_m = nav.above_home_m + p["RTL_CLIMB_MIN"] / 100.0
        return best, nav.home_m[2] - max(climb_m, min(above_m, cone_m))

    def set_speed(self, speed_mps: float | None) -> None:
        """Fly at this speed until the mode changes; None: at the parameter's."""
        self._speed_mps = speed_mps
        self.limits = self.nav.limits = self.new_limits()

    # -- what happens ---------------------------------------------------------------------------------------

    def slow_step(self) -> None:
        now_s = self.now_s or 0.0
        self.safety.step(now_s)
        if self._override_s is not None and now_s - self._override_s > self.parameters["RC_OVERRIDE_TIME"]:
            self._override_s = None
            self.rc_us = list(RC_AT_REST_US)
            self._move_sticks(0.0)
        maneuver = self.maneuver
        if isinstance(maneuver, TakeOff) and maneuver.finished:
            north, east, _ = self.nav.position_m
            self.maneuver = HoldPosition((north, east, self.nav.home_m[2] - maneuver.above_home_m))
        late = isinstance(maneuver, Follow) and now_s - maneuver.given_s > self.parameters["GUID_TIMEOUT"]
        if late and isinstance(maneuver, Follow) and maneuver.motion.horizontal_m is None:
            self.maneuver = HoldPosition()

    def on_touch(self, impact_mps: float) -> None:
        self.say(_INFO, f"SIM Hit ground at {impact_mps:.6f} m/s")

    def on_landed(self) -> None:
        if (
            self.mode in RETURNS
            or self.mode is ArduPilotMode.LAND
            or (self.mode is ArduPilotMode.AUTO and self.is_landing)
        ):
            self.disarm("Disarming motors")

    def disarm(self, text: str, severity: int = mavlink.MAV_SEVERITY_INFO) -> None:
        if self.armed:
            super().disarm(text, severity)
            self.mission_started = False
            self.mission_next = 0
            self.safety.disarmed()

    def on_told(self, told: Told, sequence: int) -> None:
        command = self.missions.lists[MISSION][sequence].command
        if told is Told.STARTED:
            self.say(_INFO, f"Mission: {sequence} {NAMES.get(command, str(command))}")
        elif told is Told.REACHED and command != mavlink.MAV_CMD_NAV_TAKEOFF:
            self.say(_INFO, f"Reached command #{sequence}")

    def setpoint(self, message: Any) -> None:
        if self.mode is not ArduPilotMode.GUIDED or not self.armed:
            return
        now_s = self.now_s or 0.0
        motion = motion_of(message, self.nav, self.estimator, per_axis=False)
        if motion is None:
            return
        no_yaw = motion.yaw_rad is None and motion.yaw_rate_radps is None
        if motion.horizontal_m is not None:
            if not self.allows(*motion.horizontal_m):
                return  # a destination outside the fence is refused, without a word on the link
        elif message.type_mask & 0x38:
            self.maneuver = HoldPosition()
            return
        if isinstance(self.maneuver, Follow):
            self.maneuver.renewed(motion, now_s, face_travel=no_yaw)
        else:
            self.maneuver = Follow(motion, now_s, face_travel=no_yaw, lifts_off=False)

    def allows(self, north_m: float, east_m: float) -> bool:
        """Whether the enabled fence contains a destination."""
        p = self.parameters
        if not p["FENCE_ENABLE"]:
            return True
        kinds = int(p["FENCE_TYPE"])
        if kinds & 2 and math.dist((north_m, east_m), self.nav.home_m[:2]) > p["FENCE_RADIUS"]:
            return False
        union = bool(int(p["FENCE_OPTIONS"]) & 2)
        return not (kinds & 4 and outside(self.fence, north_m, east_m, any_inclusion=union))

    # -- the pilot ------------------------------------------------------------------------------------------

    def takes_pilot(self, system: int) -> bool:
        return system == int(self.parameters["SYSID_MYGCS"])

    def pilot(self, channels: list[int]) -> None:
        before = self._switch_position()
        for index, pulse_us in enumerate(channels):
            if pulse_us not in (0, 65535):
                self.rc_us[index] = pulse_us
        self._override_s = self.now_s
        after = self._switch_position()
        if after != before:
            self.set_mode(int(self.parameters[f"FLTMODE{after}"]))
        throttle_given = channels[2] not in (0, 65535)
        self._move_sticks((self.rc_us[2] - 1500) / 500 if throttle_given else 0.0)

    def _move_sticks(self, up: float) -> None:
        sticks = self.maneuver
        if isinstance(sticks, Sticks):
            sticks.right = (self.rc_us[0] - 1500) / 500
            sticks.forward = (1500 - self.rc_us[1]) / 500
            sticks.clockwise = (self.rc_us[3] - 1500) / 500
            sticks.up = up

    def _switch_position(self) -> int:
        pulse_us = self.rc_us[int(self.parameters["FLTMODE_CH"]) - 1]
        return 1 + sum(pulse_us > bound for bound in (1230, 1360, 1490, 1620, 1749))

    def command(self, command: ReceivedCommand) -> int | None:
        handler = COMMANDS.get(command.number)
        return None if handler is None else handler(self, command)

    # -- lists and parameters -------------------------------------------------------------------------------

    def stored_item(self, kind: int, item: StoredItem) -> StoredItem:
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

    def read_item(self, kind: int, sequence: int, item: StoredItem) -> StoredItem:
        if kind != MISSION or sequence != 0:
            return item
        home = self.home
        command = mavlink.MAV_CMD_NAV_WAYPOINT
        if home is None:
            return StoredItem(mavlink.MAV_FRAME_GLOBAL, command, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
        x, y = round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7)
        return StoredItem(mavlink.MAV_FRAME_GLOBAL, command, 0.0, 0.0, 0.0, 0.0, x, y, round(home.amsl_m, 2))

    def on_list_progress(self, kind: int, count: int) -> None:
        name = {MISSION: "MIS_TOTAL", FENCE: "FENCE_TOTAL", RALLY: "RALLY_TOTAL"}[kind]
        self.parameters.set(name, count)
        if kind == MISSION:
            self.broadcast(self.parameters.message(name, 65535))

    def on_list(self, kind: int, items: list[StoredItem]) -> None:
        if kind == MISSION and items:
            self.say(_INFO, "Flight plan received")
        elif kind == FENCE and items:
            self.say(mavlink.MAV_SEVERITY_DEBUG, "Fence Indexed OK")

    def parameter_changed(self, name: str) -> None:
        if name == "SIM_BATT_VOLTAGE":
            self.battery.full_volts = self.parameters[name]
        elif name == "SIM_GPS_DISABLE":
            self.estimator.gps = not self.parameters[name]

    def unknown_parameter(self, channel: Channel, peer: ChannelPeer, name: str) -> None:
        """ArduPilot 4.6 says nothing, as recorded."""

    def on_parameter_list(self) -> None:
        for text in ("ArduCopter V4.6.3 (simvehicle)", "Frame: QUAD/PLUS"):
            self.say(_INFO, text)
