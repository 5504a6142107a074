"""PX4 for multicopters: its modes, its rules for Offboard, its failsafes, its words.

After the PX4 user guide v1.15 (https://docs.px4.io/v1.15/en/: flight modes, safety configuration, Offboard). There
is no recording of one to compare with: its texts are near in meaning, not in words. Failsafes are in `px4_safety`.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import ACCEPTED, REJECTED, ReceivedCommand
from simvehicle.autopilot.core import Autopilot
from simvehicle.autopilot.maneuvers import Follow, HoldPosition, Idle, Land, Maneuver, Return, Sticks, TakeOff
from simvehicle.autopilot.mission_run import Told
from simvehicle.autopilot.missions import MISSION, StoredItem
from simvehicle.autopilot.px4_commands import COMMANDS
from simvehicle.autopilot.px4_modes import NEED_POSITION, STICKS, Px4Mode
from simvehicle.autopilot.px4_safety import Px4Safety
from simvehicle.autopilot.setpoints import motion_of
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.vehicle.controller import Limits, Motion
from simvehicle.vehicle.dynamics import Battery
from simvehicle.world.air import World

_INFO, _WARNING, _CRITICAL = (
    mavlink.MAV_SEVERITY_INFO,
    mavlink.MAV_SEVERITY_WARNING,
    mavlink.MAV_SEVERITY_CRITICAL,
)
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_VERSION = 1 << 24 | 15 << 16 | 4 << 8 | 255
_PILOT_S = 0.5
"""COM_RC_LOSS_T: sticks older than this are no sticks."""


class Px4(Autopilot):
    flavour: ClassVar[Literal["ardupilot", "px4"]] = "px4"
    mav_autopilot = mavlink.MAV_AUTOPILOT_PX4
    gps_fix_type = mavlink.GPS_FIX_TYPE_3D_FIX
    vtol_state = mavlink.MAV_VTOL_STATE_UNDEFINED

    _speed_mps: float | None = None

    def __init__(self, spec: VehicleSpec, ready_after_s: float, world: World, seed: int) -> None:
        self.mode = Px4Mode.HOLD
        super().__init__(spec, ready_after_s, world, seed)
        self.safety = Px4Safety(self)
        self.offboard_motion: Motion | None = None
        self.offboard_s = -math.inf
        self._offboard_gap_s = math.inf
        self.sticks_s = -math.inf
        self.take_off_above_m: float | None = None
        self.has_flown = False
        """Since it was armed."""

    @property
    def system_parameter(self) -> str:
        return "MAV_SYS_ID"

    @property
    def custom_mode(self) -> int:
        return int(self.mode)

    def base_mode(self) -> int:
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if self.mode in STICKS:
            flags |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        else:
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
        if self.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return int(flags)

    def new_limits(self) -> Limits:
        p = self.parameters
        speed_mps = self._speed_mps or p["MPC_XY_CRUISE"]
        return Limits(
            speed_mps=speed_mps,
            most_mps=p["MPC_XY_VEL_MAX"],
            climb_mps=p["MPC_Z_VEL_MAX_UP"],
            descent_mps=p["MPC_Z_VEL_MAX_DN"],
            acceleration_mps2=max(0.5, p["MPC_ACC_HOR"]),
            climb_acceleration_mps2=max(0.5, min(p["MPC_ACC_UP_MAX"], p["MPC_ACC_DOWN_MAX"])),
            tilt_rad=math.radians(p["MPC_TILTMAX_AIR"]),
            land_mps=p["MPC_LAND_SPEED"],
            land_slow_below_m=p["MPC_LAND_ALT2"],
            return_speed_mps=speed_mps,
        )

    def new_battery(self) -> Battery:
        p = self.parameters
        return Battery(p["BAT1_CAPACITY"], p["BAT1_N_CELLS"] * p["BAT1_V_CHARGED"])

    # -- state that messages tell ---------------------------------------------------------------------------

    @property
    def ready(self) -> bool:
        return self.time_s >= self.ready_after_s

    @property
    def estimator_lost(self) -> bool:
        return self.safety.position_lost

    @property
    def position_ok(self) -> bool:
        return self.ready and not self.estimator_lost

    @property
    def estimates_wind(self) -> bool:
        return bool(self.parameters["EKF2_DRAG_CTRL"])

    @property
    def gps_detected(self) -> bool:
        return self.time_s >= 0.25 * self.ready_after_s

    @property
    def idle_status(self) -> bool:
        return not self.armed

    def estimator_flags(self) -> int:
        if self.estimator_lost:
            return 1 | 4 | 32 | 128
        return 831 if self.ready else 1 | 4 | 32 | 128

    def landed_state(self) -> int:
        if self.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.mode is Px4Mode.TAKEOFF:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_LANDING if self.is_landing else mavlink.MAV_LANDED_STATE_IN_AIR)

    def mission_idle_state(self) -> int:
        started = self.mission_next > 0
        return int(mavlink.MISSION_STATE_PAUSED if started else mavlink.MISSION_STATE_NOT_STARTED)

    def version(self) -> Any:
        return mavlink.MAVLink_autopilot_version_message(
            int(_CAPABILITIES),
            _VERSION,
            _VERSION,
            0,
            0,
            list(b"simvehic"),
            [0] * 8,
            [0] * 8,
            0,
            0,
            self.system,
            [self.system] + [0] * 17,
        )

    def health(self) -> tuple[int, int, int]:
        return self.safety.health()

    def fence_status(self) -> Any | None:
        return None

    def first_streams(self) -> dict[int, float]:
        """PX4's "normal" profile, as far as we have the messages (mavlink_main.cpp)."""
        return {
            mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: 1 / 15,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 2.0,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.2,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: 2.0,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.0,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: 0.25,
            mavlink.MAVLINK_MSG_ID_VIBRATION: 10.0,
            mavlink.MAVLINK_MSG_ID_WIND_COV: 2.0,
        }

    # -- mode -----------------------------------------------------------------------------------------------

    @property
    def offboard_alive(self) -> bool:
        """Setpoints come often enough."""
        age_s = (self.now_s or 0.0) - self.offboard_s
        return (
            age_s <= self.parameters["COM_OF_LOSS_T"]
            and self._offboard_gap_s <= self.parameters["COM_OF_LOSS_T"]
        )

    @property
    def sticks_alive(self) -> bool:
        return (self.now_s or 0.0) - self.sticks_s <= _PILOT_S

    def why_not(self, mode: Px4Mode) -> str | None:
        """What keeps an armed vehicle from a mode."""
        if mode in NEED_POSITION and not self.position_ok:
            return "no valid position estimate"
        if mode is Px4Mode.OFFBOARD and not self.offboard_alive:
            return "no offboard signal"
        if mode in STICKS and not self.sticks_alive:
            return "no manual control input"
        if mode is Px4Mode.MISSION and not self.missions.lists[MISSION]:
            return "no valid mission available"
        return None

    def user_mode(self, mode: Px4Mode) -> int:
        """A mode that somebody commands: MAV_RESULT."""
        reason = self.why_not(mode)
        strict = self.armed or mode in (Px4Mode.OFFBOARD, Px4Mode.MISSION)
        if reason is not None and strict:
            self.say(_CRITICAL, f"Switching to {mode.name.title()} not possible")
            self.say(_CRITICAL, reason)
            return REJECTED
        self.safety.user_chose()
        self.enter(mode)
        return ACCEPTED

    def enter(self, mode: Px4Mode) -> None:
        """Switch to a mode and begin what it does."""
        if mode is not self.mode:
            self.set_speed(None)
        again = mode is self.mode and mode not in (Px4Mode.TAKEOFF, Px4Mode.MISSION)
        self.mode = mode
        if again and not isinstance(self.maneuver, Idle):
            return
        self.maneuver = self._maneuver_of(mode) if self.armed else Idle()

    def _maneuver_of(self, mode: Px4Mode) -> Maneuver:
        if mode in STICKS:
            return Sticks(level=mode is not Px4Mode.POSITION)
        if mode is Px4Mode.OFFBOARD and self.offboard_motion is not None:
            return Follow(self.offboard_motion, self.offboard_s, face_travel=False, lifts_off=True)
        if mode is Px4Mode.LAND:
            return Land(with_position=self.position_ok)
        if mode is Px4Mode.RETURN:
            return self.back()
        if mode is Px4Mode.MISSION:
            if self.mission_complete:
                self.mission_next = 0
                self.mission_complete = False
            return self.new_mission(*self.mission_rules())
        if mode is Px4Mode.TAKEOFF:
            above_m = self.take_off_above_m or self.parameters["MIS_TAKEOFF_ALT"]
            return TakeOff(max(above_m, self.above_home_m), within_m=0.3)
        return HoldPosition()

    def land_without_position(self) -> Land:
        return Land(with_position=False)

    def mission_rules(self) -> tuple[int, float]:
        return 0, self.parameters["NAV_ACC_RAD"]

    def back(self) -> Return:
        p, nav = self.parameters, self.nav
        away_m = math.dist(nav.position_m[:2], nav.home_m[:2])
        cone_rad = math.radians(p["RTL_CONE_ANG"])
        highest_m = p["RTL_RETURN_ALT"]
        if away_m < p["RTL_MIN_DIST"]:
            highest_m = p["RTL_DESCEND_ALT"]
        elif 0.0 < cone_rad < math.radians(85.0):
            highest_m = max(p["RTL_DESCEND_ALT"], min(highest_m, away_m / math.tan(cone_rad)))
        highest_m = min(highest_m, p["RTL_RETURN_ALT"])
        travel_m = max(nav.above_home_m, highest_m)
        return Return(
            nav.home_m,
            travel_down_m=nav.home_m[2] - travel_m,
            loiter_s=max(0.0, p["RTL_LAND_DELAY"]),
            loiter_down_m=nav.home_m[2] - min(travel_m, p["RTL_DESCEND_ALT"]),
        )

    def set_speed(self, speed_mps: float | None) -> None:
        """Fly at this speed until the mode changes; None: at the parameter's."""
        self._speed_mps = speed_mps
        self.limits = self.nav.limits = self.new_limits()

    # -- what happens ---------------------------------------------------------------------------------------

    def arm(self) -> None:
        super().arm()
        self.has_flown = False
        self.nav.spool_s = self.armed_s + self.parameters["COM_SPOOLUP_TIME"]
        self.maneuver = self._maneuver_of(self.mode)

    def slow_step(self) -> None:
        self.safety.step(self.now_s or 0.0)
        maneuver = self.maneuver
        self.has_flown = self.has_flown or not self.landed
        if self.mode is Px4Mode.TAKEOFF and maneuver.finished:
            self.take_off_above_m = None
            self.enter(Px4Mode.HOLD)
        elif self.mode is Px4Mode.MISSION and maneuver.finished:
            self.enter(Px4Mode.HOLD)
        if isinstance(maneuver, Sticks) and not self.sticks_alive:
            maneuver.forward = maneuver.right = maneuver.up = maneuver.clockwise = 0.0

    def on_touch(self, impact_mps: float) -> None:
        """PX4 speaks up once it is sure that it has landed."""

    def on_landed(self) -> None:
        self.say(_INFO, "Landing detected")

    def on_told(self, told: Told, sequence: int) -> None:  # noqa: ARG002 - as ArduPilot's
        if told is Told.COMPLETE:
            self.say(_INFO, "Mission finished, loitering")

    def setpoint(self, message: Any) -> None:
        motion = motion_of(message, self.nav, self.estimator, per_axis=True)
        if motion is None or message.type_mask & 0x3F == 0x3F:
            return
        now_s = self.now_s or 0.0
        self._offboard_gap_s = now_s - self.offboard_s
        self.offboard_s, self.offboard_motion = now_s, motion
        motion.speed_mps = self.parameters["MPC_XY_VEL_MAX"]
        if self.mode is Px4Mode.OFFBOARD and self.armed:
            if isinstance(self.maneuver, Follow):
                self.maneuver.renewed(motion, now_s, face_travel=False)
            else:
                self.maneuver = self._maneuver_of(Px4Mode.OFFBOARD)

    def takes_pilot(self, system: int) -> bool:
        return system != self.system

    def pilot(self, channels: list[int]) -> None:
        for index, pulse_us in enumerate(channels):
            if pulse_us not in (0, 65535):
                self.rc_us[index] = pulse_us
        self.sticks_s = self.now_s or 0.0
        sticks = self.maneuver
        if isinstance(sticks, Sticks):
            sticks.right = (self.rc_us[0] - 1500) / 500
            sticks.forward = (1500 - self.rc_us[1]) / 500
            sticks.up = (self.rc_us[2] - 1500) / 500
            sticks.clockwise = (self.rc_us[3] - 1500) / 500

    def command(self, command: ReceivedCommand) -> int | None:
        handler = COMMANDS.get(command.number)
        return None if handler is None else handler(self, command)

    # -- lists and parameters -------------------------------------------------------------------------------

    def stored_item(self, kind: int, item: StoredItem) -> StoredItem:  # noqa: ARG002 - ArduPilot's differ by list
        frame = {5: 0, 6: 3}.get(item.frame, item.frame)
        return dataclasses.replace(item, frame=frame)

    def read_item(self, kind: int, sequence: int, item: StoredItem) -> StoredItem:  # noqa: ARG002 - as ArduPilot's
        return item

    def on_list_progress(self, kind: int, count: int) -> None:
        """PX4 keeps no totals as parameters."""

    def on_list(self, kind: int, items: list[StoredItem]) -> None:
        """PX4 says nothing about a list that is in order."""

    def parameter_changed(self, name: str) -> None:
        """Parameters are read where they are used."""

    def unknown_parameter(self, channel: Channel, peer: ChannelPeer, name: str) -> None:
        channel.send(
            mavlink.MAVLink_statustext_message(_WARNING, f"[pm] unknown param: {name}".encode()[:50])
        )
        if not name.startswith("#"):
            channel.send(
                mavlink.MAVLink_param_error_message(
                    peer.system, peer.component, name.encode(), -1, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
                )
            )

    def on_parameter_list(self) -> None:
        """Nothing but the list."""
