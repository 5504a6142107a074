"""The messages that agent and ground station send alike: their heartbeats, and commands to an autopilot."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour, set_mode_parameters
from flightstack.mavlink.vehicle_state import VehicleState

_RESULT_NAMES: dict[int, str] = {
    value: entry.name.removeprefix("MAV_RESULT_").lower().replace("_", " ")
    for value, entry in mavlink.enums["MAV_RESULT"].items()
}


def result_name(result: int) -> str:
    """A COMMAND_ACK's MAV_RESULT for a person: "temporarily rejected"."""
    return _RESULT_NAMES.get(result, f"result {result}")


def heartbeat(kind: int, mark: int = 0) -> Any:
    """HEARTBEAT of what is no vehicle; `kind` is its MAV_TYPE. `mark` goes where a vehicle has its mode: by it the
    sender tells its own echo from another's heartbeat."""
    return mavlink.MAVLink_heartbeat_message(
        kind, mavlink.MAV_AUTOPILOT_INVALID, 0, mark, mavlink.MAV_STATE_ACTIVE, 3
    )


def command_long(
    vehicle: VehicleState, command: int, parameters: tuple[float, ...], confirmation: int = 0
) -> Any:
    """COMMAND_LONG to the autopilot; parameters that are not given are NaN for PX4 and 0 for ArduPilot."""
    unset = math.nan if vehicle.flavour is Flavour.PX4 else 0.0
    filled = (*parameters, *(unset,) * (7 - len(parameters)))
    return mavlink.MAVLink_command_long_message(
        vehicle.system, vehicle.component, command, confirmation, *filled
    )


def set_mode(vehicle: VehicleState, custom_mode: int, confirmation: int = 0) -> Any:
    """DO_SET_MODE for a HEARTBEAT.custom_mode of the vehicle's flavour."""
    parameters = set_mode_parameters(vehicle.flavour, custom_mode)
    return command_long(vehicle, mavlink.MAV_CMD_DO_SET_MODE, parameters, confirmation)


def message_interval(vehicle: VehicleState, kind: int, rate_hz: float) -> Any:
    """SET_MESSAGE_INTERVAL: send messages of this kind at this rate on this link."""
    parameters = (float(kind), round(1e6 / rate_hz))
    return command_long(vehicle, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, parameters)


def message_once(vehicle: VehicleState, kind: int) -> Any:
    """REQUEST_MESSAGE: send one message of this kind now. Its other parameters have no NaN for "not set"."""
    return command_long(vehicle, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(kind), *(0.0,) * 6))
