"""The same conditions on every machine, and who else is on a vehicle's link.

Property tests take the same examples everywhere; HYPOTHESIS_PROFILE=explore looks for new ones. Ctrl-C works in the
processes that tests start, also where the tests themselves run in the background of a shell, which ignores it.
"""

from __future__ import annotations

import os
import signal
from typing import Any, Final

import pytest
from hypothesis import settings
from pymavlink.dialects.v20 import ardupilotmega as mavlink

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # children would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


class Neighbours:
    """Other MAVLink components on a vehicle's link, as the bytes of their messages."""

    KINDS: Final = {
        "ping0": (1, 156, (27, 0, 0, 0)),
        "ping8": (1, 156, (27, 8, 0, 0)),
        "gimbal0": (1, 154, (26, 0, 0, 0)),
        "gimbal3": (1, 154, (26, 3, 0, 0)),
        "camera": (1, 100, (30, 8, 0, 0)),
        "companion": (1, 191, (18, 8, 0, 0)),
        "copter154": (1, 154, (2, 3, 209, 4)),
        "generic1": (1, 1, (0, 0, 0, 0)),
        "rover1": (1, 1, (10, 3, 209, 4)),
        "gcs1": (1, 1, (6, 8, 0, 0)),
        "qgc": (255, 190, (6, 8, 0, 0)),
        "other2": (2, 1, (2, 3, 81, 0)),
        "veh251": (251, 1, (2, 3, 209, 4)),
        "veh255": (255, 1, (2, 3, 209, 4)),
        "sys0": (0, 1, (2, 3, 209, 4)),
    }
    """(system, component, (type, autopilot, base mode, custom mode))."""

    def __init__(self) -> None:
        self._senders: dict[tuple[int, int], mavlink.MAVLink] = {}

    def say(self, system: int, component: int, message: Any) -> bytes:
        sender = self._senders.setdefault((system, component), mavlink.MAVLink(None, system, component))
        data = bytes(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
        return data

    def heartbeat(self, kind: str) -> bytes:
        system, component, (vehicle, autopilot, base, mode) = self.KINDS[kind]
        beat = mavlink.MAVLink_heartbeat_message(vehicle, autopilot, base, mode, 4, 3)
        return self.say(system, component, beat)

    def text(self, part: bytes, identity: int = 0, number: int = 0, *, component: int = 1) -> bytes:
        return self.say(1, component, mavlink.MAVLink_statustext_message(4, part, identity, number))

    def talkative(self, kind: str) -> bytes:
        """A heartbeat, and all that would change the state of a vehicle, if it came from one."""
        system, component, _ = self.KINDS[kind]
        return self.heartbeat(kind) + b"".join(
            self.say(system, component, message)
            for message in (
                mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND),
                mavlink.MAVLink_global_position_int_message(1, 10, 10, 10, 10, 0, 0, 0, 0),
                mavlink.MAVLink_home_position_message(10, 10, 10, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
                mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 9000, 0, 1, 0, 0, 0, 0, 0, 0),
                mavlink.MAVLink_ekf_status_report_message(0, 0.0, 0.0, 0.0, 0.0, 0.0),
                mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 4),
                mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_DO_SET_MODE, 4),
                mavlink.MAVLink_param_value_message(b"RTL_ALT", 1.0, 9, 1, 0),
                mavlink.MAVLink_statustext_message(2, b"Crash: Disarming", 0, 0),
            )
        )


@pytest.fixture
def neighbours() -> Neighbours:
    return Neighbours()
