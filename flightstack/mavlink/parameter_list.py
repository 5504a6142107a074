"""All parameters of an autopilot: asked for at once, what did not come one by one.

https://mavlink.io/en/services/parameter.html: PARAM_REQUEST_LIST is answered with one PARAM_VALUE for each index.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.exchanges import REPEATS, Answer
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_values import ParameterValue, decode
from flightstack.mavlink.vehicle_state import VehicleState

QUIET_S = 1.5
"""Nothing for so long: what has not come by now was lost."""
AT_ONCE = 20
"""Lost ones that are asked for together."""
_UNASKED = 65535
"""Index of a PARAM_VALUE that belongs to no list: a change, PX4's hash."""


class ParameterList:
    """Reads them all; `found` has what has come so far."""

    def __init__(self) -> None:
        self.answer = Answer.PENDING
        self.reason = ""
        self.found: dict[str, ParameterValue] = {}
        self._count: int | None = None
        self._indices: set[int] = set()
        self._tries = 0
        self._next_s = -math.inf

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]:
        if self.answer is not Answer.PENDING or now_s < self._next_s:
            return []
        if self._tries > REPEATS:
            self.answer = Answer.SILENCE
            came = f"{len(self._indices)} of {self._count}" if self._count is not None else "none"
            self.reason = f"the parameters did not come: {came}; ask again, nearer to the vehicle"
            return []
        self._tries += 1
        self._next_s = now_s + QUIET_S
        if self._count is None:
            return [mavlink.MAVLink_param_request_list_message(vehicle.system, vehicle.component)]
        missing = [index for index in range(self._count) if index not in self._indices]
        return [
            mavlink.MAVLink_param_request_read_message(vehicle.system, vehicle.component, b"", index)
            for index in missing[:AT_ONCE]
        ]

    def value(self, now_s: float, flavour: Flavour, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if self.answer is not Answer.PENDING:
            return
        value = ParameterValue(decode(flavour, fields.param_type, fields.param_value), fields.param_type)
        if fields.param_index == _UNASKED:
            if fields.param_id in self.found:
                self.found[fields.param_id] = value
            return
        self._count = fields.param_count
        self._next_s = now_s + QUIET_S
        if fields.param_index not in self._indices:
            self._indices.add(fields.param_index)
            self._tries = 0
        self.found[fields.param_id] = value
        if len(self._indices) >= fields.param_count:
            self.answer = Answer.ACCEPTED
