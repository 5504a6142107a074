"""What the agent's tests are made of: an autopilot as a source of bytes that does at once what it is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import LocalFrame

RTL, LAND = 6, 9
READY = mavlink.MAV_SYS_STATUS_PREARM_CHECK
HAS_POSITION = mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_POS_HORIZ_REL


class ObedientAutopilot:
    """An ArduPilot that is ready at once. It moves when a test moves it, and to its take-off height at a command."""

    def __init__(self, system: int, frame: LocalFrame) -> None:
        self._frame = frame
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
        self._ears = mavlink.MAVLink(None)
        self._ears.robust_parsing = True
        self._answers = b""
        self.ready = True
        self.obeys = True
        self.armed = False
        self.mode = 0
        self.north_m, self.east_m, self.up_m = 0.0, 0.0, 0.0
        self.battery_percent = 90
        self.commands: list[int] = []
        """MAV_CMDs that came, oldest first."""

    def hear(self, data: bytes) -> list[Any]:
        """Take what the agent sent and do what it says; returns the setpoints in it."""
        setpoints = []
        for message in self._ears.parse_buffer(data) or []:
            if message.get_type() == "COMMAND_LONG":
                self._obey(message)
            elif message.get_type() == "PARAM_REQUEST_READ":
                off = mavlink.MAVLink_param_value_message(
                    message.param_id.encode(), 0.0, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0
                )
                self._answers += self._packed(off)
            elif message.get_type().startswith("SET_POSITION_TARGET"):
                setpoints.append(message)
        return setpoints

    def _obey(self, message: Any) -> None:
        self.commands.append(message.command)
        result = mavlink.MAV_RESULT_ACCEPTED if self.obeys else mavlink.MAV_RESULT_DENIED
        self._answers += self._packed(mavlink.MAVLink_command_ack_message(message.command, result))
        if not self.obeys:
            return
        match message.command:
            case mavlink.MAV_CMD_DO_SET_MODE:
                self.mode = int(message.param2)
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = message.param1 == 1.0
            case mavlink.MAV_CMD_NAV_LAND:
                self.mode = LAND
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.mode = RTL
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                self.up_m = message.param7

    def say(self, now_s: float) -> bytes:
        """Everything that it reports, as of now."""
        boot_ms = round(now_s * 1000.0)
        here = self._frame.to_geodetic((self.north_m, self.east_m, -self.up_m))
        home = self._frame.to_geodetic((0.0, 0.0, 0.0))
        place = (round(here.latitude_deg * 1e7), round(here.longitude_deg * 1e7), round(here.amsl_m * 1e3))
        back = (round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), round(home.amsl_m * 1e3))
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        air = self.armed and self.up_m > 0.1
        landed = mavlink.MAV_LANDED_STATE_IN_AIR if air else mavlink.MAV_LANDED_STATE_ON_GROUND
        health = READY if self.ready else 0
        said = self._answers + b"".join(
            map(
                self._packed,
                (
                    mavlink.MAVLink_heartbeat_message(2, 3, base, self.mode, 4, 3),
                    mavlink.MAVLink_ekf_status_report_message(HAS_POSITION, 0.0, 0.0, 0.0, 0.0, 0.0),
                    mavlink.MAVLink_sys_status_message(
                        READY, READY, health, 0, 12000, 0, self.battery_percent, 0, 0, 0, 0, 0, 0
                    ),
                    mavlink.MAVLink_extended_sys_state_message(0, landed),
                    mavlink.MAVLink_home_position_message(*back, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
                    mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                    mavlink.MAVLink_global_position_int_message(
                        boot_ms, *place, round(self.up_m * 1e3), 0, 0, 0, 0
                    ),
                ),
            )
        )
        self._answers = b""
        return said

    def _packed(self, message: Any) -> bytes:
        data = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return data


@pytest.fixture
def obedient_autopilot() -> Callable[[int, LocalFrame], ObedientAutopilot]:
    return ObedientAutopilot
