"""Transactions with one vehicle's autopilot over MAVSDK: plans, fences, parameters.

MAVSDK is imported when a vehicle is opened and not before: the drones do not have it.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import math
import re
import time
from collections.abc import AsyncIterator, Awaitable, Sequence
from typing import Any, TypeVar

from flightstack.mavlink.link import open_link
from flightstack.mavlink.modes import Flavour
from gcs.errors import GroundError
from gcs.plans.mission_items import (
    FenceAction,
    Item,
    differences,
    fence_items,
    fence_of,
    fence_parameters,
    mission_items,
    plan_items,
    rally_items,
    rally_points,
)
from mission.documents.plan_file import Plan
from mission.geometry.geofence import Geofence

log = logging.getLogger("gcs.mavsdk")

DISCOVERY_S = 8.0
FLAVOUR_S = 3.0
_FLAVOURS = {"PX4": Flavour.PX4, "ARDUPILOT": Flavour.ARDUPILOT}
_T = TypeVar("_T")
_SERIAL = re.compile(r"(?P<port>/\S+?|COM\d+),(?P<baud>\d+)")


class VehicleError(GroundError):
    """The autopilot did not answer, or would not."""


def check_parameter(name: str, value: float = 0.0) -> None:
    """`GroundError` for what no autopilot has; before one is looked for."""
    if not re.fullmatch(r"[A-Za-z0-9_]{1,16}", name):
        raise GroundError(f"parameter {name!r}: a name has 1 to 16 letters, digits and underscores")
    if not math.isfinite(value):
        raise GroundError(f"parameter {name}: {value} is no value")


def mavsdk_url(link: str) -> str:
    """A link as pymavlink writes it in MAVSDK's words."""
    kinds = {"udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpin": "tcpin"}
    kind, _, rest = link.partition(":")
    if kind in kinds and re.fullmatch(r"\S+:\d+", rest):
        return f"{kinds[kind]}://{rest}"
    serial = _SERIAL.fullmatch(link)
    if serial:
        return f"serial://{serial['port']}:{serial['baud']}"
    raise GroundError(f"link {link!r}: write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or PATH,BAUD")


@contextlib.asynccontextmanager
async def open_vehicle(links: Sequence[str], drone: int, system: int) -> AsyncIterator[Vehicle]:
    """Find drone `drone` on the links, as ground station `system`. `GroundError` says what is missing."""
    try:
        import mavsdk
        from mavsdk.asyncio import Configuration, Mavsdk, MavsdkConnectionError
    except ImportError as error:
        raise GroundError(
            "this command needs MAVSDK, which is not installed: pip install 'flightstack[ground]'"
        ) from error
    mavsdk.log_subscribe(_to_log)
    # Each call of MAVSDK blocks a thread; the default pool is small on small computers.
    loop = asyncio.get_running_loop()
    loop.set_default_executor(concurrent.futures.ThreadPoolExecutor(8, thread_name_prefix="mavsdk"))
    client = Mavsdk(Configuration.create_manual(system, 190, True))
    try:
        for link in links:
            _check(link)
            try:
                await client.add_any_connection(mavsdk_url(link))
            except MavsdkConnectionError as error:
                problem = str(error) or "cannot be opened"
                raise GroundError(
                    f"link {link}: {problem}; if a ground station is running on it, stop it or give another --link"
                ) from error
        found = await _find(client, drone, links)
        yield Vehicle(found, drone, await _flavour(found, drone))
    finally:
        client.destroy()


def _check(link: str) -> None:
    """Open and close a link ourselves first: MAVSDK shares a UDP port silently with who already has it, and the
    vehicle's answers then go to either; and its words for an absent serial port are less clear than ours."""
    if not link.startswith(("tcp:", "udpout:")):
        open_link(link).close()


def _to_log(level: int, message: str, file: str | None, line: int) -> bool:
    """MAVSDK's own chatter goes to our log instead of standard output."""
    log.log(logging.DEBUG if level < 2 else logging.INFO, "%s (%s:%s)", message, file, line)
    return True


async def _find(client: Any, drone: int, links: Sequence[str]) -> Any:
    deadline = time.monotonic() + DISCOVERY_S
    heard: set[int] = set()
    while time.monotonic() < deadline:
        for system in await client.get_systems():
            number = await system.get_system_id()
            if await system.has_autopilot():
                heard.add(number)
                if number == drone:
                    return system
        await asyncio.sleep(0.1)
    others = f"; heard there: {', '.join(map(str, sorted(heard)))}" if heard else "; nobody else either"
    raise VehicleError(f"drone {drone}: its autopilot is not heard on {', '.join(links)}{others}")


async def _flavour(system: Any, drone: int) -> Flavour:
    """Which autopilot it is. MAVSDK knows a little after it has found it, and writes parameters as it demands."""
    deadline = time.monotonic() + FLAVOUR_S
    while True:
        kind = str((await system.autopilot_type()).name)
        if kind in _FLAVOURS:
            return _FLAVOURS[kind]
        if time.monotonic() > deadline:
            raise VehicleError(f"drone {drone}: neither an ArduPilot nor a PX4 (MAVSDK says {kind.lower()})")
        await asyncio.sleep(0.05)


class Vehicle:
    """One vehicle's autopilot. Every method raises `VehicleError` with the autopilot's own reason."""

    def __init__(self, system: Any, drone: int, flavour: Flavour) -> None:
        from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
        from mavsdk.asyncio.plugins.param import ParamAsync

        self.drone = drone
        self.flavour = flavour
        self._mission = MissionRawAsync(system)
        self._param = ParamAsync(system)

    # -- plans and fences ----------------------------------------------------------------------------------

    async def upload_plan(self, plan: Plan) -> int:
        """Upload the mission and the rally points and read the mission back; returns its number of items."""
        items = mission_items(plan, self.flavour)
        await self._ask("mission upload", self._mission.upload_mission(_raw(items)))
        read = _own(await self._ask("mission download", self._mission.download_mission()))
        first = 1 if self.flavour is Flavour.ARDUPILOT else 0  # home reads back as the vehicle's own
        self._verify("mission", differences(items[first:], read[first:]))
        if plan.rally:
            points = rally_items(plan.rally)
            await self._ask("rally upload", self._mission.upload_rally_points(_raw(points)))
            read = _own(await self._ask("rally download", self._mission.download_rallypoints()))
            self._verify("rally points", differences(points, read))
        return len(plan.items)

    async def download_plan(self) -> Plan:
        """Mission, geofence and rally points as the vehicle holds them."""
        mission = _own(await self._ask("mission download", self._mission.download_mission()))
        fence = _own(await self._ask("fence download", self._mission.download_geofence()))
        rally = _own(await self._ask("rally download", self._mission.download_rallypoints()))
        items, home = plan_items(mission, self.flavour)
        try:
            geofence = fence_of(fence)
        except ValueError as error:
            raise VehicleError(f"drone {self.drone}: {error}") from error
        return Plan(
            items=items,
            home=home,
            geofence=geofence,
            rally=rally_points(rally),
            firmware_type=3 if self.flavour is Flavour.ARDUPILOT else 12,
        )

    async def upload_fence(self, fence: Geofence, action: FenceAction) -> dict[str, float]:
        """Upload the fence, read it back, and set what makes the autopilot heed it; returns those parameters."""
        items = fence_items(fence)
        await self._ask("fence upload", self._mission.upload_geofence(_raw(items)))
        read = _own(await self._ask("fence download", self._mission.download_geofence()))
        self._verify("fence", differences(items, read))
        present = {}
        if self.flavour is not Flavour.PX4:
            present = {name: await self.parameter(name) for name in ("FENCE_TYPE", "FENCE_OPTIONS")}
        wanted = fence_parameters(fence, action, self.flavour, present)
        for name, value in wanted.items():
            await self.set_parameter(name, value)
        return wanted

    def _verify(self, what: str, problems: list[str]) -> None:
        if problems:
            raise VehicleError(f"drone {self.drone}: the {what} read back differs: {problems[0]}")

    # -- parameters ----------------------------------------------------------------------------------------

    async def parameter(self, name: str) -> float:
        value, _ = await self._typed(name)
        return value

    async def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter and read it back."""
        _, is_integer = await self._typed(name)
        if is_integer and value != int(value):
            raise VehicleError(f"drone {self.drone}: {name} is an integer, {value} is not")
        if is_integer:
            await self._ask(f"setting {name}", self._param.set_param_int(name, int(value)))
        else:
            await self._ask(f"setting {name}", self._param.set_param_float(name, float(value)))
        now = await self.parameter(name)
        if abs(now - value) > 1e-6 * max(1.0, abs(value)):
            raise VehicleError(f"drone {self.drone}: {name} is {now:g} after it was set to {value:g}")

    async def parameters(self) -> dict[str, float]:
        everything = await self._ask("parameter list", self._param.get_all_params())
        found = {p.name: float(p.value) for p in (*everything.int_params, *everything.float_params)}
        if not found:
            raise VehicleError(f"drone {self.drone}: it sent no parameters")
        return dict(sorted(found.items()))

    async def _typed(self, name: str) -> tuple[float, bool]:
        """A parameter's value, and whether it is an integer to the vehicle."""
        from mavsdk.plugins.param import ParamError, ParamResult

        try:
            return float(await self._param.get_param_float(name)), False
        except ParamError as error:
            if error.result is not ParamResult.WRONG_TYPE:
                silent = error.result is ParamResult.TIMEOUT
                hint = " (ArduPilot answers an unknown parameter by silence)" if silent else ""
                raise VehicleError(f"drone {self.drone}: {name}: {_reason(error)}{hint}") from error
        return float(await self._ask(name, self._param.get_param_int(name))), True

    async def _ask(self, what: str, call: Awaitable[_T]) -> _T:
        from mavsdk import MavsdkError

        try:
            return await call
        except MavsdkError as error:
            raise VehicleError(f"drone {self.drone}: {what}: {_reason(error)}") from error


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
