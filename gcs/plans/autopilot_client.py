"""Transactions with one vehicle's autopilot: plans, fences, rally points, parameters."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkMessage
from flightstack.mavlink.exchanges import Answer, ParameterExchange, ParameterQuery
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_list import ParameterList
from flightstack.mavlink.parameter_values import ParameterValue
from flightstack.mavlink.statustext import StatusText
from gcs.errors import GroundError
from gcs.plans.clear_exchange import ClearExchange
from gcs.plans.list_transfers import KINDS, ListRefusedError, ListTransfers, result_name
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
from gcs.plans.nearness import nearness_warnings
from gcs.plans.vehicle_link import VehicleError, VehicleLink, find_vehicle, open_links
from gcs.station_config import MavlinkConfig
from mission.documents.flight_plan import Plan
from mission.geometry.geofence import Geofence

MISSION: Final = mavlink.MAV_MISSION_TYPE_MISSION
FENCE: Final = mavlink.MAV_MISSION_TYPE_FENCE
RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
LISTENED_S: Final = 1.2
"""After every upload: PX4 accepts a list and says within a second that it will not fly it."""
_WARNING: Final = mavlink.MAV_SEVERITY_WARNING
_ABOUT_LISTS: Final = re.compile(
    r"mission|waypoint|geofence|rally|take.?off|land(ing)? (start|pattern)", re.IGNORECASE
)
_ABOUT_MISSIONS: Final = re.compile(r"mission|waypoint", re.IGNORECASE)


class Uploaded(msgspec.Struct, frozen=True):
    """What an upload has done besides sending what it was given."""

    parameters: dict[str, float] = {}
    """With which a fence acts."""
    notes: tuple[str, ...] = ()
    """What was cleared, and what the vehicle keeps."""
    warnings: tuple[str, ...] = ()
    """What the autopilot said of it, and what an operator must know of the place."""


def check_parameter(name: str, value: float = 0.0) -> str:
    """The name as autopilots write it; `GroundError` for what none has, before one is looked for."""
    if not re.fullmatch(r"[A-Za-z0-9_]{1,16}", name):
        raise GroundError(f"parameter {name!r}: a name has 1 to 16 letters, digits and underscores")
    if not math.isfinite(value):
        raise GroundError(f"parameter {name}: {value} is no value")
    return name.upper()


@contextlib.asynccontextmanager
async def open_vehicle(access: MavlinkConfig, drone: int) -> AsyncIterator[Vehicle]:
    """Find drone `drone` on the links. `GroundError` says what is missing."""
    opened = open_links(access.links, access.signing_key)
    try:
        vehicle = Vehicle(await find_vehicle(opened, drone, access.system), access.system)
        try:
            yield vehicle
        finally:
            vehicle.close()
    finally:
        for link in opened:
            link.close()


class Vehicle:
    """One vehicle's autopilot. Every method raises `VehicleError` with the autopilot's own reason."""

    def __init__(self, link: VehicleLink, system: int) -> None:
        self.drone = link.drone
        self.flavour = link.flavour
        self._link = link
        self._system = system
        self._lists: ListTransfers | None = None

    def close(self) -> None:
        if self._lists is not None:
            self._lists.close()

    def expect_disarmed(self, *, force: bool) -> None:
        """`VehicleError` for an armed vehicle: what it may be flying by is not taken from it without `force`."""
        if self._link.state.armed and not force:
            raise VehicleError(
                f"drone {self.drone}: it is armed; nothing was removed (--force does it nevertheless)"
            )

    # -- plans and fences ----------------------------------------------------------------------------------

    async def upload_plan(self, plan: Plan, action: FenceAction, *, clear_fence: bool = False) -> Uploaded:
        """Upload what the plan has, and read it back.

        A mission and rally points that the plan speaks of and has not are cleared. A fence is not removed unless
        `clear_fence`: it may be all that keeps the vehicle out of something. Fence first: PX4 holds every mission
        against the fence that it has.
        """
        told, sent = Uploaded(), []
        try:
            if plan.geofence is not None:
                follows = bool(plan.items)
                told = _together(
                    told, await self.upload_fence(plan.geofence, action, mission_follows=follows)
                )
                sent.append(KINDS[FENCE])
            else:
                told = _together(told, await (self.clear(FENCE) if clear_fence else self.kept(FENCE)))
            mission = mission_items(plan, self.flavour) if plan.items else []
            for kind, part, items in (
                (MISSION, "mission", mission),
                (RALLY, "rally", rally_items(plan.rally)),
            ):
                if items:
                    told = _together(told, await self._send(kind, items))
                    sent.append(KINDS[kind])
                else:
                    speaks_of_it = part in plan.holds
                    told = _together(told, await (self.clear(kind) if speaks_of_it else self.kept(kind)))
        except VehicleError as error:
            if not sent:
                raise
            raise VehicleError(f"{error}; sent before it: {', '.join(sent)}") from error
        return told

    async def upload_fence(
        self, fence: Geofence, action: FenceAction, *, mission_follows: bool = False
    ) -> Uploaded:
        """Upload the fence, read it back, and set and read back what makes the autopilot heed it.

        `mission_follows`: what PX4 says of the mission that it still has is of no interest.
        """
        present = {}
        if self.flavour is not Flavour.PX4:
            several = len(fence.inclusion) + len(fence.inclusion_circles) > 1
            names = ("FENCE_TYPE", "FENCE_OPTIONS") if several else ("FENCE_TYPE",)
            present = {name: (await self.parameter(name)).value for name in names}
        wanted = fence_parameters(fence, action, self.flavour, present)
        told = await self._send(FENCE, fence_items(fence), mission_follows=mission_follows)
        try:
            for name, value in wanted.items():
                await self.set_parameter(name, value)
        except VehicleError as error:
            raise VehicleError(f"{error}; the fence was sent, and may not act") from error
        return msgspec.structs.replace(told, parameters=wanted)

    async def place_warnings(self, plan: Plan) -> tuple[str, ...]:
        """Whether the plan is far from the vehicle, or the vehicle outside of its fence."""
        where = await self._link.whereabouts()
        return () if where is None else tuple(nearness_warnings(plan, where))

    async def download_plan(self) -> Plan:
        """Mission, geofence and rally points as the vehicle holds them."""
        items, home = plan_items(await self._lists_of().download(MISSION), self.flavour)
        return Plan(
            items=items,
            home=home,
            geofence=await self.download_fence(),
            rally=rally_points(await self._held(RALLY)),
            firmware_type=3 if self.flavour is Flavour.ARDUPILOT else 12,
        )

    async def download_fence(self) -> Geofence | None:
        try:
            return fence_of(await self._held(FENCE))
        except ValueError as error:
            raise VehicleError(f"drone {self.drone}: {error}") from error

    async def clear(self, kind: int) -> Uploaded:
        """Remove a list, and read that it is gone. Nothing is sent if the vehicle holds none."""
        held = await self._held(kind)
        if not held:
            return Uploaded()
        exchange = ClearExchange(kind)
        await self._link.ask(exchange, exchange.hears)
        what = KINDS[kind]
        if exchange.answer is not Answer.ACCEPTED:
            reason = "no answer" if exchange.result is None else result_name(exchange.result)
            raise VehicleError(
                f"drone {self.drone}: clearing the {what}: {reason}; it keeps {_count(kind, held)}"
            )
        rest = await self._held(kind)
        if rest:
            raise VehicleError(
                f"drone {self.drone}: the {what} was cleared, and it still holds {_count(kind, rest)}"
            )
        notes = [f"cleared {_count(kind, held)}"]
        if kind == FENCE and self.flavour is Flavour.ARDUPILOT:
            enabled, types = await self.parameter("FENCE_ENABLE"), await self.parameter("FENCE_TYPE")
            if enabled.value:
                notes.append(
                    f"its circle and altitude fences act on: FENCE_ENABLE 1, FENCE_TYPE {types.value:.0f}"
                )
        return Uploaded(notes=tuple(notes))

    async def kept(self, kind: int) -> Uploaded:
        """What the vehicle keeps of this kind, as a note."""
        held = await self._held(kind)
        how = "; --clear-fence removes it" if kind == FENCE else ""
        return Uploaded(notes=(f"it keeps {_count(kind, held)}{how}",)) if held else Uploaded()

    async def _send(self, kind: int, items: Sequence[Item], *, mission_follows: bool = False) -> Uploaded:
        """Upload one list that is not empty, hear what is said of it, read it back."""
        self._link.state.new_texts.clear()
        what = KINDS[kind]
        try:
            await self._lists_of().upload(kind, items)
        except asyncio.CancelledError as error:
            raise VehicleError(
                f"drone {self.drone}: interrupted while the {what} went up: it may hold a part of this file now; "
                "upload it again or clear it before it flies"
            ) from error
        except ListRefusedError as error:
            said = "; ".join(text.text for text in await self._warnings())
            at = "" if error.refused is None else f" at {self._named(kind, error.refused, items)}"
            reason = f"{error} ({said})" if said else str(error)
            now = await self._holds_now(kind, items)
            how = "refused" if error.answered else "not sent"
            raise VehicleError(f"drone {self.drone}: {what} {how}{at}: {reason}; {now}") from error
        said_of_it = await self._warnings()
        if mission_follows:
            said_of_it = [text for text in said_of_it if not _ABOUT_MISSIONS.search(text.text)]
        refusals = [text.text for text in said_of_it if _ABOUT_LISTS.search(text.text)]
        if self.flavour is Flavour.PX4 and refusals:
            now = await self._holds_now(kind, items)
            raise VehicleError(f"drone {self.drone}: {what} refused: {'; '.join(refusals)}; {now}")
        read = await self._lists_of().download(kind)
        first = self._first(kind)  # home reads back as the vehicle's own
        problems = differences(items[first:], read[first:])
        if problems:
            raise VehicleError(f"drone {self.drone}: the {what} read back differs: {problems[0]}")
        return Uploaded(warnings=tuple(f"it says: {text.text}" for text in said_of_it))

    async def _warnings(self) -> list[StatusText]:
        return [text for text in await self._link.texts(LISTENED_S) if text.severity <= _WARNING]

    def _first(self, kind: int) -> int:
        """Index of a list's first item of our own: ArduPilot's item 0 of a mission is home."""
        return int(kind == MISSION and self.flavour is Flavour.ARDUPILOT)

    async def _held(self, kind: int) -> list[Item]:
        """The vehicle's list, without home."""
        return (await self._lists_of().download(kind))[self._first(kind) :]

    def _named(self, kind: int, item: Item, items: Sequence[Item]) -> str:
        number = item.seq - self._first(kind) + 1
        last = ", the last" if item is items[-1] else ""
        return f"item {number} (seq {item.seq}, {_command_name(item.command)}{last})"

    async def _holds_now(self, kind: int, sent: Sequence[Item]) -> str:
        """What the vehicle has after an upload that it did not take, for a person."""
        try:
            held = await self._held(kind)
        except VehicleError:
            return "it may hold a part of this file now: upload it again or clear it before it flies"
        ours = sent[self._first(kind) :]
        same = next((n for n, (a, b) in enumerate(zip(ours, held, strict=False)) if _differ(a, b)), None)
        if same is None:
            same = min(len(ours), len(held))
        if not held:
            return f"it holds no {KINDS[kind]} now"
        if same == len(ours) == len(held):
            return "it holds all of this file now: clear or replace it before it flies"
        others = len(held) - same
        rest = f" and {others} other{'s' * (others > 1)}" if others else ""
        of_ours = f"the first {same} of this file{rest}" if same else "none of this file"
        return f"it holds {_count(kind, held)} now, {of_ours}: upload what it takes before it flies"

    def _lists_of(self) -> ListTransfers:
        if self._lists is None:
            self._lists = ListTransfers(self._link, self._system)
        return self._lists

    # -- parameters ----------------------------------------------------------------------------------------

    async def parameter(self, name: str) -> ParameterValue:
        query = ParameterQuery(name)

        def hears(_now_s: float, message: MavlinkMessage) -> None:
            if message.kind == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
                query.value(self.flavour, message.fields)
            elif message.kind == mavlink.MAVLINK_MSG_ID_PARAM_ERROR:
                query.error(message.fields)

        await self._link.ask(query, hears)
        if query.answer is not Answer.ACCEPTED or query.kind is None:
            raise VehicleError(f"drone {self.drone}: {query.reason}")
        return ParameterValue(query.found, query.kind)

    async def set_parameter(self, name: str, value: float) -> bool:
        """Set a parameter and read it back; False: the vehicle held that value already.

        `GroundError` for a value that the parameter's own type does not take: it is not sent.
        """
        exchange = ParameterExchange(name, value)

        def hears(_now_s: float, message: MavlinkMessage) -> None:
            if message.kind == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
                exchange.value(self.flavour, message.fields)
            elif message.kind == mavlink.MAVLINK_MSG_ID_PARAM_ERROR:
                exchange.error(message.fields)

        await self._link.ask(exchange, hears)
        if exchange.answer is not Answer.ACCEPTED:
            kind = GroundError if exchange.is_impossible else VehicleError
            raise kind(f"drone {self.drone}: {exchange.reason}")
        return exchange.written

    async def parameters(self) -> Mapping[str, ParameterValue]:
        """All of them, by name."""
        everything = ParameterList()

        def hears(now_s: float, message: MavlinkMessage) -> None:
            if message.kind == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
                everything.value(now_s, self.flavour, message.fields)

        await self._link.ask(everything, hears)
        if everything.answer is not Answer.ACCEPTED:
            raise VehicleError(f"drone {self.drone}: {everything.reason}")
        return dict(sorted(everything.found.items()))


def _together(one: Uploaded, other: Uploaded) -> Uploaded:
    return Uploaded(
        {**one.parameters, **other.parameters}, one.notes + other.notes, one.warnings + other.warnings
    )


def _differ(mine: Item, theirs: Item) -> bool:
    return bool(differences([mine], [theirs]))


def _command_name(command: int) -> str:
    """ "NAV_WAYPOINT, command 16"."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    number = f"command {command}"
    return number if entry is None else f"{number} {entry.name.removeprefix('MAV_CMD_')}"


def _count(kind: int, items: Sequence[Item]) -> str:
    if kind == MISSION:
        return f"a mission of {len(items)} items" if len(items) > 1 else "a mission of 1 item"
    if kind == RALLY:
        return f"{len(items)} rally points" if len(items) > 1 else "1 rally point"
    with contextlib.suppress(ValueError):  # an incomplete polygon: then its items are counted
        fence = fence_of(items)
        if fence is not None:
            areas = sum(
                map(len, (fence.inclusion, fence.exclusion, fence.inclusion_circles, fence.exclusion_circles))
            )
            return f"a fence of {areas} areas" if areas > 1 else "a fence of 1 area"
    return f"a fence of {len(items)} items"
