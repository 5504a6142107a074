"""PX4's modes: which may be entered when, and what each of them does."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot import px4_parameters
from simvehicle.autopilot.commands import ACCEPTED, REJECTED
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import (
    Follow,
    HoldPosition,
    Idle,
    Land,
    Maneuver,
    Return,
    Sink,
    Sticks,
    TakeOff,
)
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_modes import CANNOT_ARM, NEED_POSITION, STICKS, Px4Mode
from simvehicle.autopilot.px4_voice import Px4Voice
from simvehicle.vehicle.controller import Motion

_INFO = mavlink.MAV_SEVERITY_INFO
_SINK_MPS = 1.0
"""How a pilot's mode goes down, as recorded, when a failsafe chose it and nobody is at the sticks."""
_TAKE_OFF_SHARE = 0.75
"""Of MPC_TKO_SPEED: how fast the recorded one climbed on the whole."""
_PILOT_S = 0.5
"""COM_RC_LOSS_T: sticks older than this are no sticks."""


class OffboardSetpoints:
    """The newest motion that somebody wants in Offboard, and whether they come often enough."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.motion: Motion | None = None
        self.given_s = -math.inf
        self._gap_s = math.inf

    def take(self, motion: Motion, now_s: float) -> None:
        self._gap_s = now_s - self.given_s
        self.given_s, self.motion = now_s, motion

    def are_lost(self, now_s: float) -> bool:
        return now_s - self.given_s > self._parameters["COM_OF_LOSS_T"]

    def are_alive(self, now_s: float) -> bool:
        return not self.are_lost(now_s) and self._gap_s <= self._parameters["COM_OF_LOSS_T"]


class Px4ModeControl:
    """A `ModeReport`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        voice: Px4Voice,
        estimate: Px4Estimate,
        progress: MissionProgress,
        offboard: OffboardSetpoints,
        back: Callable[[], Return],
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._voice = voice
        self._estimate = estimate
        self._progress = progress
        self._offboard = offboard
        self._back = back
        self._speed_mps: float | None = None
        self.mode = Px4Mode.HOLD
        self._after_disarming = Px4Mode.HOLD
        """The mode to show when it has landed: the last one that one may take off in."""
        self._tells_landing = False
        flight.after_disarming.append(self._disarmed)
        self.sticks_s = -math.inf
        """When a pilot's sticks came last."""
        self.take_off_above_m: float | None = None
        self.has_flown = False
        """Since it was armed."""

    # -- what messages tell ---------------------------------------------------------------------------------

    @property
    def custom_mode(self) -> int:
        return int(self.mode)

    def base_mode(self) -> int:
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.mode is not Px4Mode.OFFBOARD or self._offboard.are_alive(self._flight.now_s):
            flags |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if self.mode in STICKS:
            flags |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        elif self.mode is not Px4Mode.OFFBOARD:
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
        if self._flight.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return int(flags)

    @property
    def is_idle(self) -> bool:
        return not self._flight.armed

    def landed_state(self) -> int:
        flight = self._flight
        if flight.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.mode is Px4Mode.TAKEOFF:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_LANDING if flight.is_landing else mavlink.MAV_LANDED_STATE_IN_AIR)

    def mission_idle_state(self) -> int:
        started = self._progress.next > 0
        return int(mavlink.MISSION_STATE_PAUSED if started else mavlink.MISSION_STATE_NOT_STARTED)

    # -- changing it ----------------------------------------------------------------------------------------

    @property
    def sticks_alive(self) -> bool:
        return self._flight.now_s - self.sticks_s <= _PILOT_S

    def why_not(self, mode: Px4Mode) -> str | None:
        """What keeps an armed vehicle from a mode."""
        if mode in NEED_POSITION and not self._estimate.position_ok:
            return "no valid position estimate"
        if mode is Px4Mode.OFFBOARD and not self._offboard.are_alive(self._flight.now_s):
            return "no offboard signal"
        if mode in STICKS and not self.sticks_alive:
            return "no manual control input"
        if mode is Px4Mode.MISSION and not self._progress.can_fly:
            return "no valid mission available"
        return None

    def user_mode(self, mode: Px4Mode, user_chose: Callable[[], None]) -> int:
        """A mode that somebody commands: MAV_RESULT. `user_chose`: called before it is entered. On the ground every
        mode may be chosen; whether it can be armed in it is another question."""
        if self._flight.armed and self.why_not(mode) is not None:
            return REJECTED
        user_chose()
        self.enter(mode)
        return ACCEPTED

    def enter(self, mode: Px4Mode) -> None:
        """Switch to a mode and begin what it does."""
        if mode is not self.mode:
            self.set_speed(None)
        if mode not in CANNOT_ARM:
            self._after_disarming = mode
        again = mode is self.mode and mode not in (Px4Mode.TAKEOFF, Px4Mode.MISSION)
        self.mode = mode
        if again and not isinstance(self._flight.maneuver, Idle):
            return
        self.begin()

    def begin(self) -> None:
        """Do what the present mode does."""
        self._flight.maneuver = self._maneuver_of(self.mode) if self._flight.armed else Idle()

    def fall_back(self, mode: Px4Mode) -> None:
        """A failsafe's mode: what is gone back to after the landing stays what somebody wanted."""
        wanted = self._after_disarming
        self.enter(mode)
        self._after_disarming = wanted

    def _disarmed(self) -> None:
        self.mode = self._after_disarming

    def _maneuver_of(self, mode: Px4Mode) -> Maneuver:
        offboard = self._offboard
        if mode in STICKS:
            level = mode is not Px4Mode.POSITION
            return Sticks(level=level) if self.sticks_alive else Sink(_SINK_MPS, level=level)
        if mode is Px4Mode.OFFBOARD and offboard.motion is not None:
            return Follow(offboard.motion, offboard.given_s, face_travel=False, lifts_off=True)
        if mode is Px4Mode.LAND:
            return Land(with_position=self._estimate.position_ok)
        if mode is Px4Mode.RETURN:
            return self._return()
        if mode is Px4Mode.MISSION:
            if self._progress.complete:
                self._progress.from_the_start()
            return self._progress.start()
        if mode is Px4Mode.TAKEOFF:
            above_m = self.take_off_above_m or self._parameters["MIS_TAKEOFF_ALT"]
            p = self._parameters
            return TakeOff(
                max(above_m, self._flight.above_home_m),
                within_m=p["NAV_MC_ALT_RAD"],
                climb_mps=_TAKE_OFF_SHARE * p["MPC_TKO_SPEED"],
            )
        return HoldPosition()

    def _return(self) -> Return:
        back, nav = self._back(), self._flight.nav
        home = self._flight.home
        if home is not None and nav.airborne:
            above_m = nav.home_m[2] - back.travel_down_m
            told = struct.pack("<ii", math.ceil(home.amsl_m + above_m), math.ceil(above_m))
            amsl_m, over_m = struct.unpack("<ii", told)
            text = f"RTL: start return at {amsl_m} m ({over_m} m above destination)"
            self._voice.tell("vrtl_return_at", _INFO, told, text=text)
            self._tells_landing = True
        return back

    def arm(self) -> None:
        flight = self._flight
        flight.arm()
        self.has_flown = False
        flight.nav.spool_s = flight.armed_s + self._parameters["COM_SPOOLUP_TIME"]
        self.begin()

    def set_speed(self, speed_mps: float | None) -> None:
        """Fly at this speed until the mode changes; None: at the parameter's."""
        self._speed_mps = speed_mps
        self.renew_limits()

    def renew_limits(self) -> None:
        """Parameters have changed."""
        self._flight.set_limits(px4_parameters.limits(self._parameters, self._speed_mps))

    def step(self) -> None:
        """Modes that end by themselves end in Hold; sticks that nobody holds are centred."""
        maneuver = self._flight.maneuver
        if not self.has_flown and not self._flight.landed:
            self.has_flown = True
            self._voice.tell("commander_takeoff_detected", _INFO, text="Takeoff detected")
        if self._tells_landing and isinstance(maneuver, Return) and maneuver.landing:
            self._tells_landing = False
            self._voice.tell("rtl_land_at_destination", _INFO, text="RTL: land at destination")
        if self.mode is Px4Mode.TAKEOFF and maneuver.finished:
            self.take_off_above_m = None
            self.enter(Px4Mode.HOLD)
        elif self.mode is Px4Mode.MISSION and maneuver.finished:
            self.enter(Px4Mode.HOLD)
        if isinstance(maneuver, Sticks) and not self.sticks_alive:
            maneuver.forward = maneuver.right = maneuver.up = maneuver.clockwise = 0.0
