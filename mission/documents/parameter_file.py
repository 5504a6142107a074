"""Files of autopilot parameters: as MAVProxy, Mission Planner, QGroundControl and `gcs param save` write them.

MAVProxy and ours: `NAME VALUE`, Mission Planner: `NAME,VALUE`, QGroundControl: `VEHICLE COMPONENT NAME VALUE TYPE`
between tabs. `#` begins a comment everywhere. Each line says by itself which it is.
"""

from __future__ import annotations

import math
import pathlib
import re
from typing import Final

import msgspec

from mission.documents.yaml_file import DocumentError, read_text

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,15}")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_READ_ONLY: Final = "@READONLY"
"""Mark of ArduPilot's files of defaults: a value that no ground station shall change."""


class FileParameter(msgspec.Struct, frozen=True):
    name: str
    """In capitals, as autopilots have them."""
    value: float
    line: int
    is_read_only: bool = False
    """The file itself says so."""
    vehicle: int | None = None
    """The system id that QGroundControl's files say, ..."""
    component: int | None = None
    """... and the component: 1 is the autopilot, others are cameras, gimbals and the like."""


def read_parameters(path: str | pathlib.Path) -> tuple[FileParameter, ...]:
    """The parameters of a file, in its order. `DocumentError` names the line that is none."""
    file = str(path)
    found = parse_parameters(read_text(path), file)
    if not found:
        raise DocumentError(file, "there are no parameters in it; a line is written as NAME VALUE")
    return found


def parse_parameters(text: str, file: str) -> tuple[FileParameter, ...]:
    found: dict[tuple[int, str], FileParameter] = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = re.split(r"[\s,=]+", line.partition("#")[0].strip())
        if words == [""]:
            continue
        parameter = _parameter(words, number, file)
        key = (parameter.component or 1, parameter.name)
        before = found.get(key)
        if before is not None and before.value != parameter.value:
            raise DocumentError(
                file, f"{parameter.name} stands in line {before.line} with another value", line=number
            )
        found.setdefault(key, parameter)
    return tuple(found.values())


def _parameter(words: list[str], line: int, file: str) -> FileParameter:
    is_read_only = words[-1].upper() == _READ_ONLY
    if is_read_only:
        words = words[:-1]
    vehicle, component = None, None
    if len(words) == 5 and words[0].isdecimal() and words[1].isdecimal():  # QGroundControl
        vehicle, component = int(words[0]), int(words[1])
        words = words[2:4]
    if len(words) != 2:
        raise DocumentError(file, f"{' '.join(words)!r} is no parameter; write NAME VALUE", line=line)
    name, value = words
    if not _NAME.fullmatch(name):
        raise DocumentError(
            file, f"{name!r} is no parameter's name: 1 to 16 letters, digits and underscores", line=line
        )
    if not _NUMBER.fullmatch(value) or not math.isfinite(float(value)):
        raise DocumentError(file, f"{name.upper()}: {value!r} is no number", line=line)
    return FileParameter(name.upper(), float(value), line, is_read_only, vehicle, component)
