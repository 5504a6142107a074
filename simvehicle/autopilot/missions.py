"""The mission protocol's autopilot side for its three lists: mission, fence and rally points.

https://mavlink.io/en/services/mission.html. The two flavours differ in how they ask for items, in whether a broken
upload leaves the old list alone, and in what they make of the items; `ListRules` says so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.channel import Channel, ChannelPeer

MISSION, FENCE, RALLY = 0, 1, 2
_RETRY_S = 1.0
_GIVE_UP_S = 8.0
"""ArduPilot repeats a request after one second without an item and gives an upload up after eight."""
_INTEGERS: Final = 2**31
"""Coordinates are kept as 32-bit integers."""


@dataclasses.dataclass(frozen=True, slots=True)
class StoredItem:
    frame: int
    command: int
    p1: float
    p2: float
    p3: float
    p4: float
    x: int
    """Latitude, 1e-7 degrees (local frames: 1e-4 m)."""
    y: int
    z: float
    autocontinue: int = 1


def empty_lists() -> dict[int, list[StoredItem]]:
    return {MISSION: [], FENCE: [], RALLY: []}


@dataclasses.dataclass(frozen=True, slots=True)
class ListRules:
    legacy_requests: bool
    """Ask for items with MISSION_REQUEST (ArduPilot) instead of MISSION_REQUEST_INT."""
    atomic: bool
    """PX4 keeps the old list until the new one is whole; ArduPilot writes item by item."""
    stored: Callable[[int, StoredItem], StoredItem | int]
    """(list, item) -> what is kept, or the MAV_MISSION_RESULT that refuses it."""
    finished: Callable[[int, list[StoredItem]], int]
    """A whole list has come: the MAV_MISSION_RESULT. Accepting it is this function's work."""
    progress: Callable[[int, int], None]
    """(list, items now stored): ArduPilot tells it as a parameter."""
    read: Callable[[int, int, StoredItem], StoredItem]
    """(list, sequence, item) -> what a download gets."""
    set_current: Callable[[int], bool]


@dataclasses.dataclass(slots=True)
class _Upload:
    peer: ChannelPeer
    count: int
    got: list[StoredItem]
    asked_s: float
    heard_s: float


class MissionServer:
    """All uploads and downloads of one vehicle. Messages come in by `receive`, time by `step`."""

    def __init__(
        self, rules: ListRules, channels: Sequence[Channel], lists: dict[int, list[StoredItem]]
    ) -> None:
        """`lists`: what is kept, by kind; it changes in place."""
        self._rules = rules
        self._channels = channels
        self.lists = lists
        self._uploads: dict[int, _Upload] = {}
        self._handlers = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM_INT": self._item_int,
            "MISSION_ITEM": self._item_float,
            "MISSION_REQUEST_LIST": self._request_list,
            "MISSION_REQUEST_INT": self._request_int,
            "MISSION_REQUEST": self._request_float,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_SET_CURRENT": self._set_current,
            "MISSION_WRITE_PARTIAL_LIST": self._refuse_partial,
        }

    def receive(self, now_s: float, peer: ChannelPeer, message: Any) -> bool:
        """True when the message was one of this protocol."""
        handler = self._handlers.get(message.get_type())
        if handler is None:
            return False
        kind = getattr(message, "mission_type", MISSION)
        if kind == mavlink.MAV_MISSION_TYPE_ALL and message.get_type() == "MISSION_CLEAR_ALL":
            kind = MISSION
            for each in (FENCE, RALLY):
                self._replace(each, [])
        if kind not in self.lists:
            self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)
            return True
        handler(now_s, peer, kind, message)
        return True

    def step(self, now_s: float) -> None:
        for kind, upload in list(self._uploads.items()):
            if now_s - upload.heard_s > _GIVE_UP_S:
                del self._uploads[kind]
                self._ack(upload.peer, mavlink.MAV_MISSION_OPERATION_CANCELLED, kind)
            elif now_s - upload.asked_s > _RETRY_S:
                self._ask(now_s, kind, upload)

    def _ack(self, peer: ChannelPeer, result: int, kind: int) -> None:
        self._channels[peer.link].send(
            mavlink.MAVLink_mission_ack_message(peer.system, peer.component, result, kind)
        )

    def _ask(self, now_s: float, kind: int, upload: _Upload) -> None:
        upload.asked_s = now_s
        peer = upload.peer
        request = (
            mavlink.MAVLink_mission_request_message
            if self._rules.legacy_requests
            else mavlink.MAVLink_mission_request_int_message
        )
        self._channels[peer.link].send(request(peer.system, peer.component, len(upload.got), kind))

    def _replace(self, kind: int, items: list[StoredItem]) -> int:
        result = self._rules.finished(kind, items)
        if result == mavlink.MAV_MISSION_ACCEPTED:
            self.lists[kind] = items
            self._rules.progress(kind, len(items))
        return result

    def _count(self, now_s: float, peer: ChannelPeer, kind: int, message: Any) -> None:
        running = self._uploads.get(kind)
        if running is not None and running.peer != peer:
            self._ack(peer, mavlink.MAV_MISSION_DENIED, kind)
            return
        if message.count == 0:
            self._uploads.pop(kind, None)
            self._ack(peer, self._replace(kind, []), kind)
            return
        if not self._rules.atomic and len(self.lists[kind]) > message.count:
            del self.lists[kind][message.count :]
            self._rules.progress(kind, message.count)
        upload = _Upload(peer, message.count, [], now_s, now_s)
        self._uploads[kind] = upload
        self._ask(now_s, kind, upload)

    def _item_float(self, now_s: float, peer: ChannelPeer, kind: int, message: Any) -> None:
        for value, refusal in (
            (message.x, mavlink.MAV_MISSION_INVALID_PARAM5_X),
            (message.y, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
        ):
            if not abs(value) * 1e7 < _INTEGERS:  # also where it is no number
                self._ack(peer, refusal, kind)
                return
        self._item(now_s, peer, kind, message, round(message.x * 1e7), round(message.y * 1e7))

    def _item_int(self, now_s: float, peer: ChannelPeer, kind: int, message: Any) -> None:
        self._item(now_s, peer, kind, message, message.x, message.y)

    def _item(self, now_s: float, peer: ChannelPeer, kind: int, message: Any, x: int, y: int) -> None:
        upload = self._uploads.get(kind)
        if upload is None or upload.peer != peer:
            self._ack(peer, mavlink.MAV_MISSION_ERROR, kind)
            return
        upload.heard_s = now_s
        if message.seq != len(upload.got):
            if message.seq == len(upload.got) - 1:  # an answer to a request that was repeated
                return
            self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)
            return
        item = StoredItem(
            message.frame,
            message.command,
            message.param1,
            message.param2,
            message.param3,
            message.param4,
            x,
            y,
            message.z,
            message.autocontinue,
        )
        stored = self._rules.stored(kind, item)
        if not isinstance(stored, StoredItem):
            del self._uploads[kind]
            self._ack(peer, stored, kind)
            return
        upload.got.append(stored)
        if not self._rules.atomic:
            items = self.lists[kind]
            items[message.seq : message.seq + 1] = [stored]
            self._rules.progress(kind, max(len(items), message.seq + 1))
        if len(upload.got) < upload.count:
            self._ask(now_s, kind, upload)
            return
        del self._uploads[kind]
        self._ack(peer, self._replace(kind, upload.got), kind)

    def _request_list(self, _now_s: float, peer: ChannelPeer, kind: int, _message: Any) -> None:
        self._channels[peer.link].send(
            mavlink.MAVLink_mission_count_message(peer.system, peer.component, len(self.lists[kind]), kind)
        )

    def _request_int(self, _now_s: float, peer: ChannelPeer, kind: int, message: Any) -> None:
        item = self._asked_for(peer, kind, message.seq)
        if item is not None:
            self._send_item(
                mavlink.MAVLink_mission_item_int_message, peer, kind, message.seq, item, item.x, item.y
            )

    def _request_float(self, _now_s: float, peer: ChannelPeer, kind: int, message: Any) -> None:
        item = self._asked_for(peer, kind, message.seq)
        if item is not None:
            x, y = item.x / 1e7, item.y / 1e7
            self._send_item(mavlink.MAVLink_mission_item_message, peer, kind, message.seq, item, x, y)

    def _asked_for(self, peer: ChannelPeer, kind: int, sequence: int) -> StoredItem | None:
        items = self.lists[kind]
        if sequence >= len(items):
            self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)
            return None
        return self._rules.read(kind, sequence, items[sequence])

    def _send_item(
        self, make: Any, peer: ChannelPeer, kind: int, sequence: int, item: StoredItem, x: float, y: float
    ) -> None:
        message = make(
            peer.system,
            peer.component,
            sequence,
            item.frame,
            item.command,
            0,
            item.autocontinue,
            item.p1,
            item.p2,
            item.p3,
            item.p4,
            x,
            y,
            item.z,
            kind,
        )
        self._channels[peer.link].send(message)

    def _clear(self, _now_s: float, peer: ChannelPeer, kind: int, _message: Any) -> None:
        self._uploads.pop(kind, None)
        self._ack(peer, self._replace(kind, []), kind)

    def _set_current(self, _now_s: float, peer: ChannelPeer, _kind: int, message: Any) -> None:
        if not self._rules.set_current(message.seq):
            self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, MISSION)

    def _refuse_partial(self, _now_s: float, peer: ChannelPeer, kind: int, _message: Any) -> None:
        self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)
