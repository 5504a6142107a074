"""ArduCopter's modes: which may be entered when, and what each of them does."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot import ardupilot_parameters
from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.ardupilot_estimate import ArduPilotEstimate
from simvehicle.autopilot.ardupilot_modes import NEED_POSITION, RETURNS, STICKS, ArduPilotMode
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.maneuvers import HoldPosition, Idle, Land, Maneuver, Return, Sticks, TakeOff
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.mission_run import MissionRun
from simvehicle.autopilot.parameters import Parameters

_WARNING, _CRITICAL = mavlink.MAV_SEVERITY_WARNING, mavlink.MAV_SEVERITY_CRITICAL


class ArduPilotModeControl:
    """A `ModeReport`."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        estimate: ArduPilotEstimate,
        progress: MissionProgress,
        back: Callable[[], Return],
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._estimate = estimate
        self._progress = progress
        self._back = back
        self._speed_mps: float | None = None
        self.mode = ArduPilotMode.STABILIZE
        self.mission_started = False
        flight.after_disarming.append(self._disarmed)

    # -- what messages tell ---------------------------------------------------------------------------------

    @property
    def custom_mode(self) -> int:
        return int(self.mode)

    def base_mode(self) -> int:
        flags = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        if self.mode in NEED_POSITION or (self.mode is ArduPilotMode.LAND and not self._estimate.lost):
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if self._flight.armed:
            flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return int(flags)

    @property
    def is_idle(self) -> bool:
        return True

    def landed_state(self) -> int:
        flight = self._flight
        if flight.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if isinstance(flight.inner_maneuver, TakeOff):
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_LANDING if flight.is_landing else mavlink.MAV_LANDED_STATE_IN_AIR)

    def mission_idle_state(self) -> int:
        return int(mavlink.MISSION_STATE_NOT_STARTED)

    # -- changing it ----------------------------------------------------------------------------------------

    def set_mode(self, number: int) -> bool:
        """Enter a mode, as a command, a failsafe or the pilot's switch wants it; False where it is refused."""
        try:
            mode = ArduPilotMode(number)
        except ValueError:
            self._announcer.say(_WARNING, f"No such mode {number}")
            return False
        if mode is self.mode:
            return True
        if self._flight.armed and mode in NEED_POSITION and not self._estimate.position_ok:
            self._announcer.say(_WARNING, f"Mode change to {mode.name} failed: requires position")
            return False
        if self._flight.armed and mode is ArduPilotMode.AUTO and not self.auto_allowed():
            return False
        self.mode = mode
        self._announcer.mode_changed()
        self.set_speed(None)
        self.enter()
        return True

    def auto_allowed(self) -> bool:
        items = self._progress.items
        if len(items) < 2:
            self._announcer.say(_WARNING, "Mode change to AUTO failed: init failed")
            return False
        if self._flight.landed and items[1].command != mavlink.MAV_CMD_NAV_TAKEOFF:
            self._announcer.say(_CRITICAL, "Auto: Missing Takeoff Cmd")
            return False
        return True

    def enter(self) -> None:
        """Begin what the present mode does."""
        self.mission_started = False
        self._flight.maneuver = self._maneuver_of(self.mode) if self._flight.armed else Idle()

    def _maneuver_of(self, mode: ArduPilotMode) -> Maneuver:
        if mode in STICKS:
            return Sticks(level=mode in (ArduPilotMode.STABILIZE, ArduPilotMode.ALT_HOLD))
        if mode is ArduPilotMode.LAND:
            return Land(with_position=self._estimate.position_ok)
        if mode in RETURNS:
            return self._back()
        if mode is ArduPilotMode.AUTO and not self._flight.landed:
            return self.start_mission()
        return HoldPosition()

    def start_mission(self) -> MissionRun:
        self.mission_started = True
        if self._progress.complete or self._parameters["MIS_RESTART"]:
            self._progress.from_the_start()
        return self._progress.start()

    def take_off(self, maneuver: Maneuver) -> None:
        """The motors spin up: as recorded, 3.7 s from arming to lift-off."""
        flight = self._flight
        flight.nav.spool_s = max(flight.armed_s + 2.0, flight.now_s) + 1.2
        flight.maneuver = maneuver

    def set_speed(self, speed_mps: float | None) -> None:
        """Fly at this speed until the mode changes; None: at the parameter's."""
        self._speed_mps = speed_mps
        self.renew_limits()

    def renew_limits(self) -> None:
        """Parameters have changed."""
        self._flight.set_limits(ardupilot_parameters.limits(self._parameters, self._speed_mps))

    def after_landing(self) -> None:
        """Where a mode ends on the ground the motors stop."""
        if (
            self.mode in RETURNS
            or self.mode is ArduPilotMode.LAND
            or (self.mode is ArduPilotMode.AUTO and self._flight.is_landing)
        ):
            self._flight.disarm("Disarming motors", mavlink.MAV_SEVERITY_INFO)

    def _disarmed(self) -> None:
        self.mission_started = False
        self._progress.next = 0
