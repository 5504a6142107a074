"""Removes a list from an autopilot: MISSION_CLEAR_ALL and its MISSION_ACK.

https://mavlink.io/en/services/mission.html#clear_missions
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.exchanges import REPEAT_S, REPEATS, Answer
from flightstack.mavlink.vehicle_state import VehicleState


class ClearExchange:
    def __init__(self, kind: int) -> None:
        """`kind` is the list's MAV_MISSION_TYPE."""
        self.answer = Answer.PENDING
        self.result: int | None = None
        """MAV_MISSION_RESULT, once it is told."""
        self._kind = kind
        self._sent = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
        if self.answer is not Answer.PENDING or now_s < self._next_s:
            return []
        if self._sent > REPEATS:
            self.answer = Answer.SILENCE
            return []
        self._sent += 1
        self._next_s = now_s + REPEAT_S
        return [mavlink.MAVLink_mission_clear_all_message(vehicle.system, vehicle.component, self._kind)]

    def hears(self, _now_s: float, message: MavlinkMessage) -> None:
        """Something that the autopilot says."""
        if message.kind != mavlink.MAVLINK_MSG_ID_MISSION_ACK or message.fields.mission_type != self._kind:
            return
        if self._sent and self.answer is Answer.PENDING:
            self.result = message.fields.type
            accepted = self.result == mavlink.MAV_MISSION_ACCEPTED
            self.answer = Answer.ACCEPTED if accepted else Answer.REFUSED
