"""The commands about a flight that both flavours carry out alike."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.commands import ACCEPTED, DENIED, FAILED, REJECTED, Execute, ReceivedCommand
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.setpoints import global_position


class FlightCommands:
    def __init__(self, flight: Flight, progress: MissionProgress) -> None:
        self._flight = flight
        self._progress = progress

    def table(self) -> dict[int, Execute]:
        return {
            mavlink.MAV_CMD_DO_SET_HOME: self._set_home,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._grounded_only,
            mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: self._grounded_only,
            mavlink.MAV_CMD_PREFLIGHT_STORAGE: self._grounded_only,
        }

    def _set_home(self, command: ReceivedCommand) -> int:
        flight = self._flight
        if not flight.origin_is_set:
            return FAILED
        if command.params[0] == 1.0:
            flight.set_home(flight.nav.position_m)
            return ACCEPTED
        if not (abs(command.x) <= 90.0 and abs(command.y) <= 180.0 and math.isfinite(command.z)):
            return DENIED
        flight.set_home(flight.vehicle.estimator.local(Geodetic(command.x, command.y, command.z)))
        return ACCEPTED

    def _set_mission_current(self, command: ReceivedCommand) -> int:
        return ACCEPTED if self._progress.set_current(command.whole(0)) else DENIED

    def _grounded_only(self, _command: ReceivedCommand) -> int:
        """Reboot, calibration, storage: nothing to do in a simulation, but never in flight."""
        return REJECTED if self._flight.armed else ACCEPTED


def reposition_target(command: ReceivedCommand, flight: Flight) -> Vector3 | None:
    """The place that a DO_REPOSITION means, in the local frame; NaN or 0, 0 keep what is."""
    here = flight.here
    frame = mavlink.MAV_FRAME_GLOBAL if command.frame is None else command.frame
    keeps = command.x == 0.0 and command.y == 0.0
    latitude_deg = here.latitude_deg if keeps or math.isnan(command.x) else command.x
    longitude_deg = here.longitude_deg if keeps or math.isnan(command.y) else command.y
    if math.isnan(command.z):
        frame, altitude_m = mavlink.MAV_FRAME_GLOBAL, here.amsl_m
    else:
        altitude_m = command.z
    estimator = flight.vehicle.estimator
    return global_position(frame, latitude_deg, longitude_deg, altitude_m, flight.nav, estimator)
