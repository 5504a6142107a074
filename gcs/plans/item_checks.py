"""Mission items before they are flown: what no autopilot takes, or takes for something else than the file says."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.documents.flight_plan import (
    FRAMES,
    GLOBAL_FRAMES,
    LOCAL_FRAMES,
    MISSION_FRAME,
    MOVING_FRAMES,
    Plan,
    PlanItem,
)

_COMMANDS: Final = {
    number: entry.name.removeprefix("MAV_CMD_")
    for number, entry in mavlink.enums["MAV_CMD"].items()
    if not entry.name.endswith("ENUM_END")
}
_OTHER_LISTS: Final = {
    5000: "fence",
    5001: "fence",
    5002: "fence",
    5003: "fence",
    5004: "fence",
    5100: "rally",
}
"""Commands of the geofence and of the rally points, which are lists of their own."""
_PLACES: Final = frozenset({16, 17, 18, 19, 22, 31, 82, 84, 94})
"""Commands whose parameters 5 to 7 are a place or at least an altitude over something."""
_GOES: Final = _PLACES - {22, 84}
"""Those that do not start where the vehicle stands."""
_WINGED: Final = frozenset({30, 83, 3000})
"""NAV_CONTINUE_AND_CHANGE_ALT, NAV_ALTITUDE_WAIT, DO_VTOL_TRANSITION."""
_COPTERS: Final = frozenset({0, 2, 3, 4, 13, 14, 15, 29, 35, 43})
"""MAV_TYPE: generic, and whatever hangs on rotors alone."""
_NUMBERS: Final = {
    18: (1,), 19: (1,), 93: (1,), 112: (1,), 114: (1,), 115: (1,), 177: (1, 2), 178: (2,), 181: (1, 2),
    182: (1, 2), 183: (1, 2), 184: (1, 2, 3, 4), 206: (1,), 211: (2,), 600: (1,), 601: (1,),
}  # fmt: skip
"""Parameters without which a command means nothing, from MAV_CMD's own descriptions: turns, seconds, speeds,
channels. For others "not set" is a value that the autopilot understands."""
_RANGES: Final = {
    (16, 1): (0.0, 65535.0, "seconds to wait"),
    (19, 1): (0.0, 65535.0, "seconds to loiter"),
    (93, 1): (-1.0, 86400.0, "seconds to wait"),
    (112, 1): (0.0, 65535.0, "seconds to wait"),
    (177, 2): (-1.0, 32767.0, "times to jump"),
    (178, 2): (-2.0, 100.0, "m/s, or -1 and -2 for what it is and its default"),
}
"""(command, parameter): what autopilots keep of it, or a multicopter does."""
_JUMP, _TAG, _JUMP_TO_TAG = 177, 600, 601
_LARGEST_FLOAT: Final = 3.4028234e38
_INT32: Final = range(-(1 << 31), 1 << 31)


def item_name(number: int, item: PlanItem) -> str:
    """As errors call the plan's item `number`, counted from 1 as ground stations do."""
    return f"item {number} ({_COMMANDS.get(item.command, f'command {item.command}')})"


def vehicle_problem(plan: Plan) -> str | None:
    """Why this stack's vehicles, which are multicopters, are not those that the plan was made for."""
    kind = plan.vehicle_type
    if kind is None or kind in _COPTERS:
        return None
    entry = mavlink.enums["MAV_TYPE"].get(kind)
    name = "no vehicle type of MAVLink" if entry is None else _words(entry.name.removeprefix("MAV_TYPE_"))
    return (
        f"the plan is for another class of vehicle (vehicleType {kind}, {name}), and these are multicopters; choose "
        "Multi-Rotor in QGroundControl, check every item, and save it again"
    )


def _words(name: str) -> str:
    return name.lower().replace("_", " ")


def item_problems(plan: Plan) -> Iterator[str]:
    """What must not be uploaded, item by item."""
    for number, item in enumerate(plan.items, 1):
        name = item_name(number, item)
        for problem in (*_command_problems(item), *_frame_problems(plan, item), *_number_problems(item)):
            yield f"{name}: {problem}"
    yield from _jump_problems(plan.items)


def item_warnings(plan: Plan) -> Iterator[str]:
    """What is sent otherwise than the file says, or means two things."""
    for number, item in enumerate(plan.items, 1):
        if item.frame in LOCAL_FRAMES and plan.home is not None:
            yield (
                f"{item_name(number, item)}: metres about home (frame {FRAMES[item.frame]}), which autopilots do not "
                "take: it goes up as latitude and longitude about the planned home position"
            )

        if _is_nowhere(item):
            yield (
                f"{item_name(number, item)}: it is at 0, 0: to ArduPilot that is where the vehicle is then, to PX4 a "
                "place in the sea; write the place"
            )


def _is_nowhere(item: PlanItem) -> bool:
    return item.command in _GOES and item.frame in GLOBAL_FRAMES and item.params[4:6] == (0.0, 0.0)


def _command_problems(item: PlanItem) -> Iterator[str]:
    if item.command in _OTHER_LISTS:
        yield f"a {_OTHER_LISTS[item.command]} command is no mission item but one of a list of its own"
    elif item.command not in _COMMANDS:
        yield f"command {item.command} does not exist in MAVLink"
    elif item.command in _WINGED:
        yield "a command for vehicles with wings; a multicopter does not take it"


def _frame_problems(plan: Plan, item: PlanItem) -> Iterator[str]:
    frame = FRAMES[item.frame]
    if item.frame in MOVING_FRAMES:
        yield f"frame {frame} counts from wherever the vehicle is, which no autopilot takes in a mission; use frame 3"
    elif item.frame in LOCAL_FRAMES and plan.home is None:
        yield f"frame {frame} is metres about home, and the file says no home; use frame 3"
    elif item.frame == MISSION_FRAME and item.command in _PLACES:
        yield f"frame {frame} is for commands without a place, and this one has one; use frame 3"


def _number_problems(item: PlanItem) -> Iterator[str]:
    for position in _NUMBERS.get(item.command, ()):
        if item.params[position - 1] is None:
            yield f"parameter {position} is not set (null or NaN), and means nothing then; write a number"
    for position, value in enumerate(item.params, 1):
        if value is None:
            continue
        least, most, meaning = _RANGES.get((item.command, position), (-math.inf, math.inf, ""))
        if not least <= value <= most:
            yield f"parameter {position} is {value:g}, and is {least:g} to {most:g} {meaning}"
            continue
        whole = position in (5, 6) and item.frame == MISSION_FRAME
        if whole and not (float(value).is_integer() and int(value) in _INT32):
            yield f"parameter {position} is {value:.10g}, and frame MISSION carries whole numbers of 32 bits there"
        elif position not in (5, 6) and not abs(value) <= _LARGEST_FLOAT:
            yield f"parameter {position} is {value:g}, more than MAVLink carries"
        elif position not in (5, 6) and float(value).is_integer() and _float32(value) != value:
            yield (
                f"parameter {position} is {value:.17g}, and MAVLink's numbers carry 24 bits: it would become "
                f"{_float32(value):.17g}"
            )


def _float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _jump_problems(items: Sequence[PlanItem]) -> Iterator[str]:
    counts = Counter(item.jump_id for item in items if item.jump_id)
    tags = {item.params[0] for item in items if item.command == _TAG}
    for jump_id, count in counts.items():
        if count > 1 and any(item.command == _JUMP and item.params[0] == jump_id for item in items):
            yield f"{count} items have the number {jump_id} (doJumpId), to which an item jumps; number them anew"
    for number, item in enumerate(items, 1):
        target = item.params[0]
        if target is None or not math.isfinite(target):
            continue
        name = item_name(number, item)
        if item.command == _JUMP_TO_TAG and target not in tags:
            yield f"{name}: it jumps to the tag {target:g}, which no item sets"
        if item.command != _JUMP:
            continue
        if target not in counts:
            there = ", ".join(str(one) for one in sorted(counts)) or "none"
            yield f"{name}: it jumps to item {target:g}, which is not there; the numbers (doJumpId) are {there}"
        elif target == item.jump_id:
            yield f"{name}: it jumps to itself"
        elif any(other is item for other in _jumps_on(items, number - 1)):
            yield f"{name}: it jumps to item {target:g}, which jumps on and comes back here: nothing is flown between"
        repeat = item.params[1]
        if repeat is not None and not float(repeat).is_integer():
            yield f"{name}: it jumps {repeat:g} times; write a whole number, or -1 for ever"


def _jumps_on(items: Sequence[PlanItem], start: int) -> Iterator[PlanItem]:
    """What comes after the jump at index `start` as long as that is jumps, each of which is taken; each item once."""
    by_number = {item.jump_id: index for index, item in enumerate(items) if item.jump_id}
    index: int | None = by_number.get(int(items[start].params[0] or 0))
    seen: set[int] = set()
    while index is not None and index not in seen and items[index].command == _JUMP:
        seen.add(index)
        yield items[index]
        index = by_number.get(int(items[index].params[0] or 0))
