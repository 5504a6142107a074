"""The link to one vehicle's autopilot, for as long as a command takes: found, listened to, asked.

It reads the link and answers it only while somebody waits for something, in `during`. All that comes can also be
heard by who transfers lists.
"""

from __future__ import annotations

import asyncio
import logging
import pathlib
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final, Protocol, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink import vehicle_state
from flightstack.mavlink.codec import MavlinkCodec, MavlinkMessage
from flightstack.mavlink.commands import heartbeat, message_once
from flightstack.mavlink.exchanges import Answer
from flightstack.mavlink.framing import MavlinkFrame, is_signed
from flightstack.mavlink.link import ByteLink, open_link
from flightstack.mavlink.link.signed_link import SignedLink
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.role import AUTOPILOT_COMPONENT, Role, why_not_flown
from flightstack.mavlink.signing_store import SigningStore
from flightstack.mavlink.statustext import StatusText
from flightstack.mavlink.vehicle_state import VehicleState
from gcs.errors import GroundError
from mission.geometry.frames import Geodetic

log = logging.getLogger("gcs")

COMPONENT: Final = mavlink.MAV_COMP_ID_MISSIONPLANNER
"""190: what ground stations use."""
DISCOVERY_S: Final = 8.0
SIGNED_LINKS: Final = 100
"""Numbers of signed links from here on are those of commands: the running station has the same ids."""
_TURN_S: Final = 0.01
_HEARTBEAT_S: Final = 1.0
_WHEREABOUTS_S: Final = 1.0
_ASKED_AGAIN_S: Final = 0.4
_EVENTS: Final = vehicle_state.EVENTS | {
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    mavlink.MAVLINK_MSG_ID_PARAM_ERROR,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK,
}
_T = TypeVar("_T")


class VehicleError(GroundError):
    """The autopilot did not answer, or would not."""


class VehicleExchange(Protocol):
    """A question to an autopilot, as `flightstack.mavlink.exchanges` has them."""

    @property
    def answer(self) -> Answer: ...

    def step(self, now_s: float, vehicle: VehicleState) -> list[Any]: ...


class LinkListener(Protocol):
    """Whoever else speaks to the vehicle over our link."""

    def frame(self, frame: MavlinkFrame) -> None:
        """A whole frame has come."""

    def waiting(self) -> bytes:
        """What is to be sent now."""
        ...


class VehicleLink:
    """One autopilot on the link on which it was heard."""

    def __init__(self, link: ByteLink, codec: MavlinkCodec, state: VehicleState) -> None:
        self.state = state
        self.drone = state.system
        self._ids = (state.system, state.component)
        self.heartbeat: MavlinkFrame | None = None
        """Its newest one."""
        self.listener: LinkListener | None = None
        """It sends our heartbeats too."""
        self.hears: Callable[[float, MavlinkMessage], None] | None = None
        """Told of everything that the autopilot says."""
        self._link = link
        self._codec = codec
        self._beat_s = 0.0

    @property
    def flavour(self) -> Flavour:
        return self.state.flavour

    def over(self, link: ByteLink) -> VehicleLink:
        """The same vehicle, spoken to over another link from now on."""
        return VehicleLink(link, self._codec, self.state)

    def send(self, message: Any) -> None:
        self._link.write(self._codec.encode(message))

    # -- what a command waits for --------------------------------------------------------------------------

    async def ask(self, exchange: VehicleExchange, hears: Callable[[float, MavlinkMessage], None]) -> None:
        """Carry an exchange out until it has an answer, whichever; `hears` is told of every message meanwhile."""
        self.hears = hears
        try:
            while exchange.answer is Answer.PENDING:
                for message in exchange.step(time.monotonic(), self.state):
                    self.send(message)
                await self._turn()
        finally:
            self.hears = None

    async def during(self, call: Awaitable[_T]) -> _T:
        """The result of something that needs the link to work meanwhile."""
        task = asyncio.ensure_future(call)
        while not task.done():
            await self._turn()
        return await task

    async def texts(self, seconds: float) -> list[StatusText]:
        """What the autopilot has said since the last call and says in the next `seconds`."""
        end_s = time.monotonic() + seconds
        while (now_s := time.monotonic()) < end_s:
            await self._turn()
        self.state.flush(now_s + vehicle_state.HEARTBEAT_LOST_S)
        found, self.state.new_texts = self.state.new_texts, []
        return found

    async def whereabouts(self) -> Geodetic | None:
        """Where the vehicle is, or its home if it does not say; None if it tells neither."""
        end_s, ask_s = time.monotonic() + _WHEREABOUTS_S, 0.0
        while self.state.geodetic is None and (now_s := time.monotonic()) < end_s:
            if now_s >= ask_s:
                ask_s = now_s + _ASKED_AGAIN_S
                for kind in (
                    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
                    mavlink.MAVLINK_MSG_ID_HOME_POSITION,
                ):
                    self.send(message_once(self.state, kind))
            await self._turn()
        return self.state.geodetic or self.state.home

    # -- the link --------------------------------------------------------------------------------------------

    async def _turn(self) -> None:
        now_s = time.monotonic()
        for frame, message in self._codec.receive_frames(now_s, self._link.read()):
            # Only what the autopilot itself says: MAVSDK takes a gimbal's answer for the vehicle's.
            if self.listener is not None and (frame.system, frame.component) == self._ids:
                self.listener.frame(frame)
            if message is None or (message.system, message.component) != self._ids:
                continue
            if message.kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self.heartbeat = frame
            self.state.accept(now_s, message)
            if self.hears is not None:
                self.hears(now_s, message)
        if self.listener is not None:
            self._write(self.listener.waiting())
        elif now_s >= self._beat_s:
            self._beat_s = now_s + _HEARTBEAT_S
            self._write(self._codec.encode(heartbeat(mavlink.MAV_TYPE_GCS)))
        await asyncio.sleep(_TURN_S)

    def _write(self, data: bytes) -> None:
        if data:
            self._link.write(data)


async def find_vehicle(links: Sequence[ByteLink], drone: int, system: int) -> VehicleLink:
    """The autopilot of `drone` on the link that it is heard on first; we are `system`. `VehicleError` if on none."""
    codecs = [
        MavlinkCodec(system, COMPONENT, vehicle_state.STATES, _EVENTS, only_system=drone) for _ in links
    ]
    end_s, beat_s = time.monotonic() + DISCOVERY_S, 0.0
    heard: dict[int, str] = {}
    while (now_s := time.monotonic()) < end_s:
        for link, codec in zip(links, codecs, strict=True):
            if now_s >= beat_s:  # where we send first, nobody knows of us before that
                link.write(codec.encode(heartbeat(mavlink.MAV_TYPE_GCS)))
            found = _heard(now_s, link, codec, drone, heard)
            if found is not None:
                return found
        beat_s = now_s + _HEARTBEAT_S if now_s >= beat_s else beat_s
        await asyncio.sleep(_TURN_S)
    if heard.get(drone):
        raise VehicleError(f"drone {drone}: {heard[drone]}")
    others = f"; heard there: {', '.join(map(str, sorted(heard)))}" if heard else "; nobody else either"
    problems = "".join(f"; {link.problem}" for link in links if link.problem and not heard)
    names = ", ".join(link.describe for link in links)
    raise VehicleError(f"drone {drone}: its autopilot is not heard on {names}{others}{problems}")


def _heard(
    now_s: float, link: ByteLink, codec: MavlinkCodec, drone: int, heard: dict[int, str]
) -> VehicleLink | None:
    """The autopilot of `drone`, once it is heard. `heard` takes the systems that are, and why one is none of ours."""
    for frame, message in codec.receive_frames(now_s, link.read()):
        if message is None or message.kind != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            continue
        state = VehicleState(message.system, message.component, None)
        state.accept(now_s, message)
        unfit = why_not_flown(message.fields)
        if unfit and state.role is Role.OTHER and message.component == AUTOPILOT_COMPONENT:
            heard.setdefault(message.system, unfit)
        if state.role is not Role.AUTOPILOT:
            continue
        heard[message.system] = ""
        if message.system == drone:
            if is_signed(frame.data) and not isinstance(link, SignedLink):
                log.warning(
                    "drone %d signs, and may obey nobody without its key: mavlink.signing_key in --config",
                    drone,
                )
            found = VehicleLink(link, codec, state)
            found.heartbeat = frame
            return found
    return None


def open_links(links: Sequence[str], signing_key: str | None = None) -> list[ByteLink]:
    """All of them, signed if a key's file is given; what cannot be opened raises with one line, and none is open."""
    store = None if signing_key is None else SigningStore(pathlib.Path(signing_key))
    opened: list[ByteLink] = []
    try:
        for index, text in enumerate(links):
            link = open_link(text)
            if store is not None:
                link = SignedLink(link, store, SIGNED_LINKS + index % 100, tells=False)
            opened.append(link)
    except Exception:
        for each in opened:
            each.close()
        raise
    return opened
