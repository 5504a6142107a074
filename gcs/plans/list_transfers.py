"""Missions, fences and rally points of one vehicle: sent and fetched by MAVSDK, over our own link.

MAVSDK (4: a library in our process) carries the mission protocol out and says how it ended. Which item was refused it
does not say: that is heard on the link, where the autopilot asked for it last. It is imported when the first list is
transferred and not before: parameters do not need it.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.framing import MavlinkFrame
from gcs.errors import GroundError
from gcs.plans.mission_items import Item
from gcs.plans.vehicle_link import COMPONENT, VehicleError, VehicleLink

log = logging.getLogger("gcs.mavsdk")

KINDS: Final = {
    mavlink.MAV_MISSION_TYPE_MISSION: "mission",
    mavlink.MAV_MISSION_TYPE_FENCE: "fence",
    mavlink.MAV_MISSION_TYPE_RALLY: "rally points",
}
"""By MAV_MISSION_TYPE, as an operator calls them."""
_DISCOVERY_S: Final = 5.0
_GIVING_UP_S: Final = 1.0
"""How long an interrupted transfer may take to end: the vehicle is to be told."""
_CALLS: Final = {
    mavlink.MAV_MISSION_TYPE_MISSION: ("upload_mission", "download_mission"),
    mavlink.MAV_MISSION_TYPE_FENCE: ("upload_geofence", "download_geofence"),
    mavlink.MAV_MISSION_TYPE_RALLY: ("upload_rally_points", "download_rallypoints"),
}
_RESULTS: Final = {
    value: entry.name.removeprefix("MAV_MISSION_").lower().replace("_", " ")
    for value, entry in mavlink.enums["MAV_MISSION_RESULT"].items()
}


class ListRefusedError(VehicleError):
    """An autopilot that did not take a list."""

    def __init__(self, problem: str, refused: Item | None, *, answered: bool) -> None:
        """`refused`: the item that it asked for last, where that is known; `answered`: it said no, and did not just
        fall silent."""
        super().__init__(problem)
        self.refused = refused
        self.answered = answered


class _Watch:
    """What the autopilot asks for and says at the end of an upload."""

    def __init__(self, kind: int) -> None:
        self._kind = kind
        self.asked: int | None = None
        self.result: int | None = None

    def hears(self, _now_s: float, message: MavlinkMessage) -> None:
        if getattr(message.fields, "mission_type", None) != self._kind:
            return
        if message.kind == mavlink.MAVLINK_MSG_ID_MISSION_ACK:
            self.result = message.fields.type
        else:
            self.asked = message.fields.seq


class ListTransfers:
    """MAVSDK at the other end of a `VehicleLink`."""

    def __init__(self, link: VehicleLink, system: int) -> None:
        """`system` is ours. `GroundError` where MAVSDK is not installed."""
        try:
            import mavsdk
            from mavsdk.mavsdk import Configuration, Mavsdk
        except ImportError as error:
            raise GroundError(
                "this command needs MAVSDK, which is not installed: pip install 'flightstack[ground]'"
            ) from error
        mavsdk.log_subscribe(_to_log)
        self._link = link
        self._client = Mavsdk(Configuration.create_manual(system, COMPONENT, True))
        self._client.add_any_connection("raw://")
        self._out: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._client.subscribe_raw_bytes_to_be_sent(self._out.put)
        self._plugin: Any = None
        self._call_runs = False
        link.listener = self

    def close(self) -> None:
        self._link.listener = None
        if not self._call_runs:  # a call that waits in it would wait for ever
            self._client.destroy()

    # -- what passes over the link ---------------------------------------------------------------------------

    def frame(self, frame: MavlinkFrame) -> None:
        self._client.pass_received_raw_bytes(frame.data)

    def waiting(self) -> bytes:
        pieces = bytearray()
        while not self._out.empty():
            pieces += self._out.get_nowait()
        return bytes(pieces)

    # -- transfers ---------------------------------------------------------------------------------------------

    async def upload(self, kind: int, items: Sequence[Item]) -> None:
        """Send a list that is not empty. `ListRefusedError` with the autopilot's reason."""
        from mavsdk.exceptions import MavsdkError

        watch = _Watch(kind)
        self._link.hears = watch.hears
        try:
            await self._call(_CALLS[kind][0], _raw(items))
        except MavsdkError as error:
            refused = None if watch.asked is None else next((i for i in items if i.seq == watch.asked), None)
            reason = _reason(error) if watch.result is None else result_name(watch.result)
            answered = watch.result is not None
            raise ListRefusedError(reason, refused if answered else None, answered=answered) from error
        finally:
            self._link.hears = None

    async def download(self, kind: int) -> list[Item]:
        """The list as the autopilot holds it."""
        from mavsdk.exceptions import MavsdkError

        try:
            return _own(await self._call(_CALLS[kind][1]))
        except MavsdkError as error:
            problem = f"drone {self._link.drone}: download of the {KINDS[kind]}: {_reason(error)}"
            raise VehicleError(problem) from error

    async def _call(self, name: str, *arguments: Any) -> Any:
        if self._plugin is None:
            await self._discover()
        call: Callable[..., Any] = getattr(self._plugin, name)
        done = _started(call, arguments)
        try:
            await self._link.during(_end_of(done))
        except asyncio.CancelledError:
            await self._give_up(name, done)
            raise
        return done.result()

    async def _give_up(self, name: str, done: concurrent.futures.Future[Any]) -> None:
        """End an interrupted call, which waits for the vehicle in a thread of its own, and tell the vehicle."""
        from mavsdk.exceptions import MavsdkError

        downloads = name.startswith("download")
        with contextlib.suppress(MavsdkError):  # it had ended by itself
            (self._plugin.cancel_mission_download if downloads else self._plugin.cancel_mission_upload)()
        end_s = time.monotonic() + _GIVING_UP_S
        while not done.done() and time.monotonic() < end_s:
            await self._link.during(asyncio.sleep(0.02))
        await self._link.during(asyncio.sleep(0.02))  # what it still had to send
        self._call_runs = not done.done()

    async def _discover(self) -> None:
        from mavsdk.plugins.mission_raw import MissionRaw

        if self._link.heartbeat is not None:  # the next one may be a second away
            self.frame(self._link.heartbeat)
        end_s = time.monotonic() + _DISCOVERY_S
        while time.monotonic() < end_s:
            for system in self._client.get_systems():
                if system.get_system_id() == self._link.drone and system.has_autopilot():
                    self._plugin = MissionRaw(system)
                    return
            await self._link.during(asyncio.sleep(0.02))
        raise VehicleError(f"drone {self._link.drone}: its autopilot has fallen silent")


def _started(call: Callable[..., Any], arguments: Sequence[Any]) -> concurrent.futures.Future[Any]:
    """The call in a thread that does not keep the process from ending, as those of `asyncio.to_thread` do."""
    done: concurrent.futures.Future[Any] = concurrent.futures.Future()

    def work() -> None:
        try:
            done.set_result(call(*arguments))
        except Exception as error:  # noqa: BLE001 (whoever waits for the result gets it)
            done.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    return done


async def _end_of(done: concurrent.futures.Future[Any]) -> None:
    while not done.done():
        await asyncio.sleep(0.005)


def result_name(result: int) -> str:
    """A MAV_MISSION_RESULT for a person: "invalid param5 x"."""
    text: str = _RESULTS.get(result, f"result {result}")
    return text


def _to_log(level: int, message: str, file: str | None, line: int) -> bool:
    """MAVSDK's own chatter goes to our log instead of standard output."""
    log.log(logging.DEBUG if level < 2 else logging.INFO, "%s (%s:%s)", message, file, line)
    return True


def _reason(error: Any) -> str:
    result = getattr(error, "result", None)
    return str(result.name).lower().replace("_", " ") if result is not None else str(error)


def _raw(items: Sequence[Item]) -> list[Any]:
    from mavsdk.plugins.mission_raw import MissionItem

    return [
        MissionItem(
            i.seq,
            i.frame,
            i.command,
            i.current,
            i.autocontinue,
            i.param1,
            i.param2,
            i.param3,
            i.param4,
            i.x,
            i.y,
            i.z,
            i.mission_type,
        )
        for i in items
    ]


def _own(items: Sequence[Any]) -> list[Item]:
    return [
        Item(
            i.seq,
            i.frame,
            i.command,
            i.param1,
            i.param2,
            i.param3,
            i.param4,
            i.x,
            i.y,
            i.z,
            i.mission_type,
            i.current,
            i.autocontinue,
        )
        for i in items
    ]
