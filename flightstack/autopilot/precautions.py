"""What a PX4 would do without us, looked at before its motors start.

As it comes a PX4 whose companion computer dies goes into its Position mode, which without a remote control sinks at
1 m/s to the ground wherever it is. Nobody would notice that before it happens.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from flightstack.autopilot.telemetry import Telemetry
from flightstack.mavlink.exchanges import Answer, ParameterQuery
from flightstack.mavlink.modes import Flavour

_LOSS = "COM_OBL_RC_ACT"
_RETURN = 3
_LOSS_ACTIONS = {
    0: "Position: without a remote control it sinks to the ground where it is",
    1: "Altitude: without a remote control it drifts with the wind",
    2: "Manual: without a remote control it falls",
    4: "Land: where it is",
    5: "Hold: where it is, until its battery is empty",
    6: "Terminate: it falls",
    7: "Disarm: it falls",
}
_CONE = "RTL_CONE_ANG"


class Precautions:
    """Reads the parameters that nobody has decided about. An ArduPilot needs none of it."""

    def __init__(self, decided: Collection[str]) -> None:
        """`decided`: the parameters that the drone's own file sets: whatever their value is, somebody wanted it."""
        self._left = [ParameterQuery(name) for name in (_LOSS, _CONE) if name not in decided]
        self.refusal = ""
        """Why it must not be armed, and how to mend it."""
        self.warning = ""
        """What the operator should know."""

    def step(self, now_s: float, vehicle: Telemetry) -> list[Any]:
        while not self.is_done(vehicle):
            query = self._left[0]
            sent = query.step(now_s, vehicle)
            if query.answer is Answer.PENDING:
                return sent
            self._left.pop(0)
            self._judge(query)
        return []

    def is_done(self, vehicle: Telemetry) -> bool:
        return not self._left or bool(self.refusal) or vehicle.flavour is not Flavour.PX4

    def parameter(self, vehicle: Telemetry, fields: Any) -> None:
        """A PARAM_VALUE with these fields has come."""
        if self._left:
            self._left[0].value(vehicle.flavour, fields)

    def parameter_error(self, fields: Any) -> None:
        """A PARAM_ERROR with these fields has come."""
        if self._left:
            self._left[0].error(fields)

    def _judge(self, query: ParameterQuery) -> None:
        if query.name == _CONE:
            if query.answer is Answer.ACCEPTED and query.found != 0:
                self.warning = (
                    f"{_CONE} is {query.found:g}: near home it returns below RTL_RETURN_ALT, so that drones which "
                    f"come home by themselves are not kept apart: set it to 0 under autopilot.parameters"
                )
        elif query.answer is not Answer.ACCEPTED:
            self.warning = (
                f"{_LOSS} does not answer: what this PX4 does when this computer fails is not known"
            )
        elif query.found != _RETURN:
            does = _LOSS_ACTIONS.get(int(query.found), "unknown")
            self.refusal = (
                f"{_LOSS} is {query.found:g} ({does}) if this computer fails: set it under autopilot.parameters, "
                f"to 3 (Return) or to what you want"
            )
