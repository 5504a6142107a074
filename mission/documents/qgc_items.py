"""Mission items of QGroundControl's files, of all its versions, and the simple items that complex ones carry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, TypeAlias

import msgspec

from mission.documents.flight_plan import (
    AMSL_FRAMES,
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    TERRAIN_FRAMES,
    Parameters,
    PlanItem,
    item_problem,
)
from mission.documents.yaml_file import DocumentError

Number: TypeAlias = float | None
Unset: TypeAlias = msgspec.UnsetType
_EXPAND: Final = (
    "upload the plan from QGroundControl to a (simulated) vehicle, download it there and save that"
)

_SAVE_AGAIN: Final = "write one of them in both places, or correct it in QGroundControl and save it again"
_FRAMES_OF_MODES: Final = {1: RELATIVE_FRAMES | AMSL_FRAMES, 2: AMSL_FRAMES, 4: TERRAIN_FRAMES}
"""QGroundControl's AltitudeMode: 1 over home (before its version 3.5: over the sea), 2 over the sea (over the ground
as it was when the plan was made, sent as over the sea: another number by right), 4 over the ground."""
_SAME_IN: Final = RELATIVE_FRAMES | TERRAIN_FRAMES
"""Where both numbers are the same altitude."""
_SAME_M: Final = 0.01


class QgcItem(msgspec.Struct, rename="camel"):
    type: str
    command: int | None = None
    frame: int | None = None
    params: tuple[Number, ...] | None = None
    auto_continue: bool = True
    do_jump_id: int = 0
    complex_item_type: str = ""
    altitude_mode: int | None = msgspec.field(default=None, name="AltitudeMode")
    altitude: Number = msgspec.field(default=None, name="Altitude")
    transects: _Transects | None = msgspec.field(default=None, name="TransectStyleComplexItem")
    coordinate: tuple[Number, Number, Number] | None = None
    """Versions before 3.2 kept parameters 5 to 7 here, ..."""
    param1: Number | Unset = msgspec.UNSET
    """... and until 3.0 the others by name."""
    param2: Number | Unset = msgspec.UNSET
    param3: Number | Unset = msgspec.UNSET
    param4: Number | Unset = msgspec.UNSET
    id: int = 0


class _Transects(msgspec.Struct):
    items: tuple[QgcItem, ...] = msgspec.field(default=(), name="Items")


def items_of(raw: Iterable[QgcItem], file: str, field: str) -> tuple[PlanItem, ...]:
    found: list[PlanItem] = []
    for index, item in enumerate(raw):
        found += _simple_items(item, file, f"{field}[{index}]")
    return tuple(found)


def _simple_items(item: QgcItem, file: str, field: str) -> Iterator[PlanItem]:
    if item.type == "ComplexItem":
        yield from _carried(item, file, field)
        return
    if item.type not in ("SimpleItem", "missionItem"):
        raise DocumentError(
            file, f'{item.type!r} is neither "SimpleItem" nor "ComplexItem"', field=f"{field}.type"
        )
    params = _params(item, file, field)
    if item.command is None or item.frame is None or params is None:
        raise DocumentError(file, "a simple item needs command, frame and 7 params", field=field)
    simple = PlanItem(
        command=item.command,
        frame=item.frame,
        params=params,
        auto_continue=item.auto_continue,
        jump_id=item.do_jump_id or item.id,
        altitude_mode=item.altitude_mode,
    )
    problem = item_problem(simple) or _altitude_problem(item, simple)
    if problem:
        raise DocumentError(file, problem, field=f"{field}.params")
    yield simple


def _altitude_problem(item: QgcItem, simple: PlanItem) -> str | None:
    """An altitude stands twice in an item, and people change one of them: QGroundControl flies by the first."""
    given, sent = item.altitude, simple.params[6]
    wanted = _FRAMES_OF_MODES.get(item.altitude_mode or 0)
    if wanted is None or given is None or sent is None or simple.frame not in GLOBAL_FRAMES:
        return None
    if simple.frame not in wanted:
        return f"AltitudeMode {item.altitude_mode} and frame {simple.frame} say two things; {_SAVE_AGAIN}"
    if simple.frame in _SAME_IN and abs(given - sent) > _SAME_M:
        return f"its altitude stands twice: Altitude {given:g} and parameter 7 {sent:g}; {_SAVE_AGAIN}"
    return None


def _carried(item: QgcItem, file: str, field: str) -> Iterator[PlanItem]:
    if item.complex_item_type == "StructureScan":
        raise DocumentError(
            file,
            "a structure scan: QGroundControl keeps its settings in the file and not its waypoints, and makes those "
            f"when it uploads; {_EXPAND}",
            field=field,
        )
    if item.transects is None or not item.transects.items:
        raise DocumentError(
            file,
            f"the complex item of type {item.complex_item_type!r} carries no simple items; in QGroundControl, "
            f"replace it by waypoints, or {_EXPAND}",
            field=field,
        )
    for index, inner in enumerate(item.transects.items):
        yield from _simple_items(inner, file, f"{field}.TransectStyleComplexItem.Items[{index}]")


def _params(item: QgcItem, file: str, field: str) -> Parameters | None:
    """Parameters 1 to 7, wherever the file's version keeps them."""
    named = (item.param1, item.param2, item.param3, item.param4)
    given = [value for value in named if not isinstance(value, Unset)]
    if given and item.params is None:
        if len(given) < len(named) or item.coordinate is None:
            raise DocumentError(file, "an item needs param1 to param4 and a coordinate", field=field)
        first: tuple[Number, ...] = tuple(given)
    elif item.params is None:
        return None
    else:
        first = item.params
    values = (*first, *item.coordinate) if item.coordinate is not None and len(first) == 4 else first
    if len(values) != 7:
        raise DocumentError(file, f"Expected `array` of length 7, got {len(first)}", field=f"{field}.params")
    one, two, three, four, x, y, z = values
    return one, two, three, four, x, y, z
