"""A vehicle whose autopilot is a real program with physics of its own: all that we know is what it reports."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.session import RATES_HZ
from flightstack.autopilot.telemetry import EVENTS, STATES, Telemetry
from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.message_rates import StreamRequests
from flightstack.mavlink.modes import Flavour
from mission.geometry.frames import LocalFrame, Vector3
from simvehicle.faults.fault_table import FaultKind, Unheard

REACHABLE: frozenset[FaultKind] = frozenset(("unplug", "stuck", "lying", "gps_loss", "battery_low"))
"""The faults that a simulated ArduCopter can be given: by its instruments' lines and by its SIM_ parameters."""
MONITOR = 250
"""Our MAVLink system id."""
_WEAK_BATTERY_V = 10.2
"""Below BATT_LOW_VOLT as it comes (10.5 V, three cells)."""
_AGAIN_S = 1.0


class UnreachableFaultError(ValueError):
    """A fault that is not in `REACHABLE`."""


class ReportedVehicle:
    """A `FlownVehicle` over one MAVLink port of an ArduCopter, its link 0, on which we ask for what agents ask for.

    Before its first report it is at home. Its wind is its own: that of our world is told to it at its start.
    """

    def __init__(self, system: int, frame: LocalFrame, home_ned_m: Vector3) -> None:
        self._home = home_ned_m
        self._vehicle = Telemetry(system, frame, Flavour.ARDUPILOT)
        self._codec = MavlinkCodec(
            MONITOR, mavlink.MAV_COMP_ID_MISSIONPLANNER, STATES, EVENTS, only_system=system
        )
        self._streams = StreamRequests(RATES_HZ)
        self._system = system
        self._now_s = 0.0
        self._boot_s: float | None = None
        self._said: list[tuple[int, bytes]] = []
        self._parameters: dict[str, float] = {}
        """Not yet confirmed."""
        self._asked_s = 0.0

    # -- bytes ----------------------------------------------------------------------------------------------

    def receive(self, link_index: int, data: bytes) -> None:  # noqa: ARG002 - there is one link
        for message in self._codec.receive(self._now_s, data):
            if not self._vehicle.hear(self._now_s, message):
                continue
            fields = message.fields
            if message.name == "COMMAND_ACK" and self._codec.is_answer_to_us(message):
                self._streams.acknowledge(self._now_s, fields.command, fields.result)
            elif message.name == "PARAM_VALUE":
                self._confirm(fields.param_id, fields.param_value)
        self._vehicle.clear_news()
        if self._boot_s is None and self._vehicle.boot_ms is not None:
            self._boot_s = self._now_s - self._vehicle.boot_ms * 1e-3

    def step(self, now_s: float) -> None:
        self._now_s = now_s
        for message in self._streams.step(now_s, self._vehicle):
            self._send(message)
        if self._parameters and now_s >= self._asked_s + _AGAIN_S:
            self._ask_for_parameters()

    def drain(self) -> list[tuple[int, bytes]]:
        said, self._said = self._said, []
        return said

    def _send(self, message: Any) -> None:
        self._said.append((0, self._codec.encode(message)))

    # -- what it reports ------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """How far the vehicle's own time has come, from the first look at it on; 0 before that."""
        boot_ms = self._vehicle.boot_ms
        return 0.0 if self._boot_s is None or boot_ms is None else self._boot_s + boot_ms * 1e-3

    @property
    def position_ned_m(self) -> Vector3:
        return self._vehicle.position_ned_m or self._home

    @property
    def velocity_ned_mps(self) -> Vector3:
        return self._vehicle.velocity_ned_mps or (0.0, 0.0, 0.0)

    @property
    def attitude_rad(self) -> Vector3:
        return self._vehicle.attitude_rad or (0.0, 0.0, 0.0)

    @property
    def airborne(self) -> bool:
        return self._vehicle.is_airborne(self._now_s)

    @property
    def armed(self) -> bool:
        return self._vehicle.armed

    @property
    def mode(self) -> str:
        return self._vehicle.mode

    @property
    def battery_fraction(self) -> float:
        fraction = self._vehicle.battery_fraction
        return 1.0 if fraction is None else fraction

    # -- what goes wrong ------------------------------------------------------------------------------------

    def set_gps(self, working: bool) -> None:
        self._set_parameter("SIM_GPS_DISABLE", 0.0 if working else 1.0)

    def weaken_battery(self) -> None:
        self._set_parameter("SIM_BATT_VOLTAGE", _WEAK_BATTERY_V)

    def set_motors(self, working: bool) -> None:
        raise UnreachableFaultError(
            f"motors to be working: {working}; not every ArduCopter can simulate that"
        )

    def set_turned_over(self, turned_over: bool) -> None:
        raise UnreachableFaultError(
            f"attitude to be turned over: {turned_over}; no ArduCopter simulates that"
        )

    def set_gps_error(self, north_m: float) -> None:
        raise UnreachableFaultError(f"GPS to be off by {north_m:g} m; every ArduCopter calls that otherwise")

    def set_heard(self, what: Unheard, heard: bool) -> None:
        raise UnreachableFaultError(f"{what} to be heard: {heard}; the vehicle's own do not go through us")

    def set_range_finder(self, *, silent: bool, lies_m: float) -> None:
        what = f"silent: {silent}, {lies_m:g} m wrong"
        raise UnreachableFaultError(f"range finder to be {what}; a real autopilot's vehicle has none")

    def set_silent(self, silent: bool) -> None:
        raise UnreachableFaultError(f"links to be silent: {silent}; the vehicle's own do not go through us")

    def _set_parameter(self, name: str, value: float) -> None:
        self._parameters[name] = value
        self._ask_for_parameters()

    def _ask_for_parameters(self) -> None:
        """Requests get lost: each is repeated until the vehicle says the value."""
        self._asked_s = self._now_s
        for name, value in self._parameters.items():
            self._send(
                mavlink.MAVLink_param_set_message(
                    self._system, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
                )
            )

    def _confirm(self, name: str, value: float) -> None:
        if name in self._parameters and abs(self._parameters[name] - value) < 1e-3:
            del self._parameters[name]
