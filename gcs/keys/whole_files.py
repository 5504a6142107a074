"""A node's whole configuration file: somebody's file as it is, comments and all, with another `swarm` and name.

The text is changed, not written anew from what was read: what a person wrote beside it stays.
"""

from __future__ import annotations

import contextlib
import pathlib
import re
from typing import Any, Final, NamedTuple

from gcs.errors import GroundError
from mission.documents.yaml_file import DocumentError, parse_value


class Templates(NamedTuple):
    """Files whose settings new nodes get."""

    drone: pathlib.Path | None = None
    station: pathlib.Path | None = None


NO_TEMPLATES: Final = Templates()
_MEND: Final = "write its keys at the beginnings of lines, as in examples"


def whole_file(text: str, file: str, swarm: str, key: str, name: int | str) -> str:
    """`text` with the section `swarm` (YAML) in the place of its own, and `key` ("drone", "station") saying `name`.

    `GroundError` where `text` is not such a file.
    """
    before = _mapping(text, file)
    if "swarm" not in before:
        raise GroundError(f"{file}: has no swarm section that could be replaced; {_MEND}")
    written = _with_block(_with_value(text, key, name), "swarm", swarm)
    wanted = before | _mapping(swarm, "swarm") | {key: name}
    with contextlib.suppress(DocumentError):
        if _mapping(written, file) == wanted:
            return written
    raise GroundError(f"{file}: {key} and swarm cannot be replaced in it; {_MEND}")


def beside(text: str, file: str) -> list[str]:
    """Files that a configuration names and that lie beside it. `GroundError` for one that lies elsewhere."""
    fence = _mapping(text, file).get("geofence")
    if not isinstance(fence, str):
        return []
    if pathlib.PurePath(fence).name != fence:
        raise GroundError(
            f"{file}: geofence: {fence} is not beside it; put it there, it is copied to every drone"
        )
    return [fence]


def _mapping(text: str, file: str) -> dict[str, Any]:
    read = parse_value(text, file)
    if not isinstance(read, dict):
        raise GroundError(f"{file}: is no configuration of a drone or a ground station")
    return read


def _with_value(text: str, key: str, name: int | str) -> str:
    line = re.compile(rf"^({key}\s*:[ \t]*)[^\s#]+", re.MULTILINE)
    if line.search(text) is None:
        return f"{key}: {name}\n{text}"
    return line.sub(lambda match: f"{match[1]}{name}", text, count=1)


def _with_block(text: str, key: str, block: str) -> str:
    """The lines of a key, and those below that are indented or empty, but for empty ones and comments at the end."""
    lines = text.splitlines(keepends=True)
    begin = next((index for index, line in enumerate(lines) if re.match(rf"{key}\s*:", line)), len(lines))
    end = begin + 1
    while end < len(lines) and (not lines[end].strip() or lines[end][0].isspace()):
        end += 1
    while end > begin + 1 and not lines[end - 1].strip():
        end -= 1
    return "".join([*lines[:begin], block, *lines[end:]])
