"""Giving one vehicle's autopilot a signing key, or taking it away, and proof that it has obeyed.

SETUP_SIGNING is not answered, so it is sent again until the autopilot answers a question in the new way
(https://mavlink.io/en/guide/message_signing.html). The key goes over the link as it is: a cable is the place for it.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.exchanges import Answer, CommandExchange
from flightstack.mavlink.framing import is_signed
from flightstack.mavlink.link import ByteLink, open_link
from flightstack.mavlink.link.signed_link import SignedLink
from flightstack.mavlink.signing import KEY_BYTES
from flightstack.mavlink.signing_store import SigningStore
from gcs.plans.vehicle_link import VehicleError, VehicleLink, find_vehicle

_LINK_NUMBER: Final = 200
_TRIES: Final = 3
_HEARTBEAT_WITHIN_S: Final = 2.5
_QUESTION: Final = (float(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION), *(0.0,) * 6)


async def change_signing(
    link: str, drone: int, system: int, old: SigningStore | None, new: SigningStore | None
) -> None:
    """From the key `old` to `new`; None: nothing is signed. `VehicleError` if the vehicle does not obey."""
    cable = open_link(link)
    try:
        before = await find_vehicle([_signed(cable, old)], drone, system)
        if before.state.armed:
            raise VehicleError(f"drone {drone}: it is armed; its signing key was not changed")
        signs = before.heartbeat is not None and is_signed(before.heartbeat.data)
        for _ in range(_TRIES):
            before.send(_setup(before, new))
            after = before.over(_signed(cable, new))
            if await _answers(after) and (new is not None or await _is_unsigned(after)):
                return
        raise VehicleError(f"drone {drone}: {_why(is_locked=signs and old is None, takes=new is not None)}")
    finally:
        cable.close()
        for store in (old, new):
            if store is not None:
                store.release()


def _signed(cable: ByteLink, store: SigningStore | None) -> ByteLink:
    return cable if store is None else SignedLink(cable, store, _LINK_NUMBER, tells=False)


def _setup(vehicle: VehicleLink, new: SigningStore | None) -> Any:
    """All zeros take the key away."""
    key, stamp = (bytes(KEY_BYTES), 0) if new is None else (new.signing.key, new.signing.stamp)
    state = vehicle.state
    return mavlink.MAVLink_setup_signing_message(state.system, state.component, list(key), stamp)


async def _answers(vehicle: VehicleLink) -> bool:
    """Whether it hears us and we hear it: any answer will do."""
    exchange = CommandExchange(mavlink.MAV_CMD_REQUEST_MESSAGE, _QUESTION)

    def hears(now_s: float, message: MavlinkMessage) -> None:
        if message.kind == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            exchange.acknowledge(now_s, message.fields.command, message.fields.result)

    await vehicle.ask(exchange, hears)
    return exchange.answer is not Answer.SILENCE


async def _is_unsigned(vehicle: VehicleLink) -> bool:
    """Whether its next heartbeat is: at its USB port it answers to what is unsigned in any case."""
    end_s = time.monotonic() + _HEARTBEAT_WITHIN_S
    while vehicle.heartbeat is None and time.monotonic() < end_s:
        await vehicle.during(asyncio.sleep(0.05))
    return vehicle.heartbeat is not None and not is_signed(vehicle.heartbeat.data)


def _why(*, is_locked: bool, takes: bool) -> str:
    if is_locked:
        return (
            "it has a signing key, and nothing was changed: give the file of that key with --old-key, or use the "
            "autopilot's USB port, where ArduPilot takes what is not signed"
        )
    way = "sign with the new key" if takes else "stop signing"
    return f"it does not {way}; ArduPilot can, and of PX4 the versions that have the parameter MAV_SIGN_CFG"
