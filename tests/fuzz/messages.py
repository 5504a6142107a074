"""Mutated MAVLink frames and mutated messages of the swarm, by seed.

A frame that was damaged on the way fails its check sum. The interesting one is whole and wrong: its payload is
mutated and it is packed anew, as a broken or hostile program would send it.
"""

from __future__ import annotations

import math
import pathlib
import random
import struct
from collections.abc import Collection, Iterable
from typing import Any

import msgspec
import mutations
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.framing import FrameFinder, MavlinkFrame, pack_frame
from flightstack.swarm import topics
from flightstack.swarm.topics import Topic
from flightstack.swarm.wire import VERSION, CommandName

DATA = pathlib.Path(__file__).parent.parent / "data"
KINDS = sorted(mavlink.mavlink_map)
_FLOATS = (math.nan, math.inf, -math.inf, 1e38, -1e38, 1e-40, 0.0, -0.0, 1.0, -1.0, 16777217.0, 1e9)
_PATTERNS = (b"\0", b"\xff", b"\x7f", b"\x80", b"\x01")
_NUMBERS: tuple[Any, ...] = (
    *(
        math.nan,
        math.inf,
        -math.inf,
        1e308,
        -1e308,
        1e-320,
        0,
        -1,
        1,
        2,
        3,
        4,
        7,
        250,
        255,
        256,
        1e6,
        -5.0,
        0.5,
    ),
    *(2**31, -(2**31) - 1, 2**53 + 1, 2**63 - 1, -(2**63), 2**64 - 1),
)
_OTHERS: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        "",
        "x",
        "1",
        "2",
        "é😀\x1b[2J\n",
        "a" * 5000,
        b"",
        b"\xff" * 600,
        [],
        [[]],
        [None] * 3,
    ),
    *(
        {},
        {"a": 1},
        [1.0, 2.0, 3.0],
        [math.nan, 0.0, 0.0],
        [1e9, 1e9, 1e9],
        [[1, 0], [2, 1], [3, 2]],
        list(range(300)),
    ),
)


def recorded_frames(name: str, at_most: int) -> list[MavlinkFrame]:
    """Frames of a recorded conversation with a real autopilot, one in so many of the whole of it."""
    data = (DATA / name).read_bytes()
    found = FrameFinder().find(data)
    known = [frame for frame in found if frame.kind in mavlink.mavlink_map]
    return known[:: max(1, len(known) // at_most)][:at_most]


def damaged(rng: random.Random, frame: MavlinkFrame) -> bytes:
    """The frame as a bad link delivers it, in any way. One in 65536 passes for a whole one."""
    data = frame.data
    ways = (mutations.flip, mutations.cut, mutations.truncate, mutations.repeat, mutations.swap)
    for _ in range(rng.choice((1, 1, 2))):
        data = rng.choice(ways)(rng, data)
    return data


def slightly_damaged(rng: random.Random, frame: MavlinkFrame) -> bytes:
    """The frame with one to three wrong bits behind its header, which its check sum always shows."""
    data = bytearray(frame.data)
    for place in rng.sample(range(8 * 10, 8 * len(data)), rng.choice((1, 2, 3))):
        data[place // 8] ^= 1 << place % 8
    return bytes(data)


def mutated_payload(rng: random.Random, payload: bytes) -> bytes:
    changed = bytearray(payload.ljust(rng.choice((len(payload), len(payload), 36, 64)), b"\0"))
    for _ in range(rng.choice((1, 1, 2, 4))):
        if not changed:
            break
        match rng.randrange(5):
            case 0:
                changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
            case 1 if len(changed) >= 4:
                struct.pack_into("<f", changed, 4 * rng.randrange(len(changed) // 4), rng.choice(_FLOATS))
            case 2:
                width, place = rng.choice((1, 2, 4, 8)), rng.randrange(len(changed))
                pattern = rng.choice(_PATTERNS) * width
                changed[place : place + width] = pattern[: len(changed) - place]
            case 3:
                del changed[rng.randrange(len(changed) + 1) :]
            case _:
                place = rng.randrange(len(changed))
                changed[place : place + 8] = rng.randbytes(min(8, len(changed) - place))
    return bytes(changed[:255])


def forged(
    rng: random.Random, frame: MavlinkFrame, system: int, component: int, sequence: int | None = None
) -> bytes:
    """A whole frame with a right check sum and a wrong payload, of this sender."""
    kind = frame.kind if rng.random() < 0.8 else rng.choice(KINDS)
    number = rng.randrange(256) if sequence is None else sequence
    return pack_frame(kind, number, system, component, mutated_payload(rng, frame.payload))


def forged_message(rng: random.Random, topic: Topic, payload: bytes, keep: Collection[int] = ()) -> bytes:
    """A message of the swarm with some of its fields mutated. Fields at `keep` (1: the first) stay."""
    if rng.random() < 0.15:
        return rng.choice((mutations.flip, mutations.cut, mutations.truncate, mutations.swap))(rng, payload)
    fields = msgspec.msgpack.decode(payload[1:])
    for _ in range(rng.choice((1, 1, 2, 5))):
        place = rng.randrange(1, max(2, len(fields)))
        if place in keep or place >= len(fields):
            continue
        fields[place] = _mutated_value(rng, fields[place])
    if rng.random() < 0.03:
        fields.append(rng.choice(_OTHERS))
    if rng.random() < 0.03:
        del fields[rng.randrange(1, len(fields)) :]
    data = _encoded(fields)
    if rng.random() < 0.02:
        depth = rng.choice((100, 5000))
        data = data[:-1] + b"\x91" * depth
    return bytes((VERSION if rng.random() < 0.98 else rng.randrange(256),)) + data


def from_sender(payload: bytes, sender: int) -> bytes:
    """A message, if it is one that names its sender, as another drone says it."""
    try:
        fields = msgspec.msgpack.decode(payload[1:])
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return payload
    if not isinstance(fields, list) or len(fields) < 3:
        return payload
    place = 2 if fields[0] == "outcome" else 1
    fields[place] = sender if isinstance(fields[place], int) else str(sender)
    return payload[:1] + _encoded(fields)


def _mutated_value(rng: random.Random, value: Any) -> Any:
    if isinstance(value, list) and value and rng.random() < 0.7:
        changed = list(value)
        place = rng.randrange(len(changed))
        changed[place] = _mutated_value(rng, changed[place])
        return changed * (1 if rng.random() < 0.9 else 3)
    if isinstance(value, int | float) and not isinstance(value, bool) and rng.random() < 0.8:
        return rng.choice((*_NUMBERS, value + 1, -value, value * 10))
    return rng.choice((*_NUMBERS, *_OTHERS))


def _encoded(fields: Any) -> bytes:
    try:
        return msgspec.msgpack.encode(fields)
    except OverflowError:
        return msgspec.msgpack.encode([str(field) for field in fields])


def is_order_to_move(topic: Topic, payload: bytes) -> bool:
    """Whether this says, well formed, that drones shall do something else than hold: then they are right to do it."""
    if topic is not topics.COMMAND:
        return False
    try:
        return bool(topic.codec.decode(payload).name is not CommandName.PAUSE)
    except ValueError:
        return False


def others(system: int) -> Iterable[tuple[int, int]]:
    """Senders that are not the autopilot of this system: foreign systems, and other components of its own."""
    yield from ((other, 1) for other in (0, 1, 2, 3, 9, 77, 250, 255) if other != system)
    yield from ((system, component) for component in (0, 2, 25, 100, 154, 156, 158, 190, 191, 250))
