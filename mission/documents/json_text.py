"""Strict JSON: what other readers pass over in silence is refused with its place."""

from __future__ import annotations

import json
import re
from typing import Any, Final, TypeVar

import msgspec

from mission.documents.yaml_file import DocumentError

T = TypeVar("T")
_DEEPEST: Final = 100
"""No file of these formats has a tenth of it; decoders end in the stack's depth somewhere above."""
_COMMENT: Final = re.compile(r"^\s*(?://|/\*)|[,{\[\]}0-9\"]\s*(?://|/\*)", re.MULTILINE)


def json_object(text: str, file: str) -> Any:
    """The value that JSON `text` holds. `DocumentError` for what is no JSON, nested too deeply, or ambiguous."""
    try:
        found: Any = msgspec.json.decode(text)
        _refuse_depth(found)
    except msgspec.DecodeError as error:
        position = re.search(r"byte (\d+)", str(error))
        line = text.encode().count(b"\n", 0, int(position[1])) + 1 if position else None
        hint = "; JSON has no comments: remove them" if _COMMENT.search(text) else ""
        raise DocumentError(file, f"not JSON: {error}{hint}", line=line) from error
    except RecursionError as error:
        raise DocumentError(file, "not a plan: lists or objects are nested too deeply") from error
    # msgspec lets the last of several keys win; Python's reader shows them all.
    json.loads(text, parse_int=str, object_pairs_hook=lambda pairs: _unique(pairs, file))
    return found


def converted(content: Any, kind: type[T], file: str) -> T:
    """JSON `content` as a `kind`, a msgspec struct; `DocumentError` names the field that is not."""
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        raise DocumentError(file, problem, field=where.rstrip("`") or None) from error


def _refuse_depth(value: Any) -> None:
    level, depth = [value], 0
    while level:
        depth += 1
        if depth > _DEEPEST:
            raise RecursionError
        level = [
            inner
            for one in level
            for inner in (one.values() if isinstance(one, dict) else one if isinstance(one, list) else ())
            if isinstance(inner, dict | list)
        ]


def _unique(pairs: list[tuple[str, Any]], file: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise DocumentError(file, f"the key {key!r} stands twice in one object; remove one of them")
        found[key] = value
    return found
