"""Mission items of QGroundControl's files, of all its versions, and the simple items that complex ones carry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, TypeAlias

import msgspec

from mission.documents.flight_plan import Parameters, PlanItem, item_problem
from mission.documents.yaml_file import DocumentError

Number: TypeAlias = float | None
Unset: TypeAlias = msgspec.UnsetType
_EXPAND: Final = (
    "upload the plan from QGroundControl to a (simulated) vehicle, download it there and save that"
)


class QgcItem(msgspec.Struct, rename="camel"):
    type: str
    command: int | None = None
    frame: int | None = None
    params: tuple[Number, ...] | None = None
    auto_continue: bool = True
    do_jump_id: int = 0
    complex_item_type: str = ""
    altitude_mode: int | None = msgspec.field(default=None, name="AltitudeMode")
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
    problem = item_problem(simple)
    if problem:
        raise DocumentError(file, problem, field=f"{field}.params")
    yield simple


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
