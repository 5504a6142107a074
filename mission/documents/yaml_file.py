"""Text to typed, checked data: the one reader for every YAML file of the project.

Unknown keys, wrong types and impossible values end in one `DocumentError` that names the file, the line, the
field and what would be right.
"""

from __future__ import annotations

import contextlib
import pathlib
import re
from typing import Any, TypeVar

import msgspec
import yaml
from msgspec import inspect

from mission.documents import yaml_values
from mission.documents.printable import printable

T = TypeVar("T")
_STEPS = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
"""The steps of a field's path ("drones[2].link"): names and places in lists."""


class DocumentError(ValueError):
    """A file that a person wrote says something that cannot be. Its text is one line: where, what, how to mend."""

    def __init__(self, file: str, problem: str, *, line: int | None = None, field: str | None = None) -> None:
        place = file if line is None else f"{file}:{line}"
        super().__init__(_visible(f"{place}: {field}: {problem}" if field else f"{place}: {problem}"))
        self.file = file
        self.line = line
        self.field = field


def _visible(text: str) -> str:
    """What a file says stands in its errors: control characters must not reach the terminal, nor a whole page."""
    shown = printable(text)
    return shown if len(shown) <= _LONGEST_LINE else f"{shown[: _LONGEST_LINE - 1]}…"


_LONGEST_LINE = 600
_LARGEST_BYTES = 16 << 20
"""Larger than any file that a person writes, or a ground station for one."""
_OTHERS = (
    ((b"\xff\xfe", b"\xfe\xff"), "it is UTF-16 text, not UTF-8; save it as UTF-8"),
    ((b"PK\x03\x04",), "it is a zip archive (a .kmz file is one); unpack it and give the file in it"),
    ((b"\x1f\x8b",), "it is compressed; unpack it"),
)
"""First bytes of files that are no UTF-8 text, and what to do with them."""


def read_text(path: str | pathlib.Path) -> str:
    """The UTF-8 text of a file, without a byte order mark, its lines ended by "\\n" alone.

    `DocumentError` says why it cannot be read.
    """
    try:
        with pathlib.Path(path).open("rb") as file:
            data = file.read(_LARGEST_BYTES + 1)
    except OSError as error:
        raise DocumentError(str(path), f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a path with a zero byte in it
        raise DocumentError(str(path), f"cannot be read: {error}") from error
    if len(data) > _LARGEST_BYTES:
        megabytes = _LARGEST_BYTES >> 20
        raise DocumentError(
            str(path), f"cannot be read: it is larger than {megabytes} MB, as no file of this kind is"
        )
    for starts, problem in _OTHERS:
        if data.startswith(starts):
            raise DocumentError(str(path), f"cannot be read: {problem}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DocumentError(
            str(path), "cannot be read: it is not UTF-8 text; save it as UTF-8", line=line
        ) from error
    if "\0" in text:
        raise DocumentError(str(path), "cannot be read: there are zero bytes in it; it is no text")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse(text: str, kind: type[T], file: str) -> T:
    """Read YAML `text` (of the file named `file`) as a `kind`, a msgspec struct that forbids unknown fields.

    A kind with a class method `completed` (mapping to mapping) adds by it what its files may leave out.
    """
    raw = _loaded(text, file)
    if raw is None:
        raise DocumentError(file, "the file is empty")
    completed = getattr(kind, "completed", None)
    if completed is not None and isinstance(raw, dict):
        raw = completed(raw)
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        problem, path = _split(str(error))
        if "[...]" in path:
            path = path.replace("[...]", f".{_entry(raw, kind, path, str(error))}", 1)
        if problem.startswith(("Invalid enum value", "Invalid value")) and (choices := _choices(kind, path)):
            problem += f"; write {' or '.join(choices)}"
        raise DocumentError(file, problem, line=line_of(text, path), field=path or None) from error


def parse_value(text: str, where: str) -> Any:
    """One value as an option of a command line gives it, read as files are; `where` stands in the errors."""
    return _loaded(text, where)


def _loaded(text: str, file: str) -> Any:
    try:
        return yaml_values.load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        line = mark.line + 1 if mark else None
        if isinstance(error, yaml.reader.ReaderError):  # a character that YAML does not know
            line = text.encode().count(b"\n", 0, error.position) + 1
        raise DocumentError(file, problem, line=line) from error


def fault_of(file: str, field: str, problem: str) -> DocumentError:
    """The error of what a file asks for and the machine has not, found when it was opened: with the field's line."""
    line = None
    with contextlib.suppress(OSError, ValueError, yaml.YAMLError):  # it has been changed since, or is no file
        line = line_of(read_text(file), field)
    return DocumentError(file, problem.removeprefix(f"{field}: "), line=line, field=field)


def _split(message: str) -> tuple[str, str]:
    """msgspec's "problem - at `$.a.b[0]`" as (problem, "a.b[0]"), the unknown key included in the path."""
    problem, _, where = message.partition(" - at `")
    if where.startswith("key` in `"):
        where, problem = where.removeprefix("key` in `"), "a key must be a word, not a number"
    path = where.rstrip("`").removeprefix("$").removeprefix(".")
    unknown = re.search(r"unknown field `(.+?)`", problem)
    if unknown:
        path = f"{path}.{unknown[1]}" if path else unknown[1]
        problem = "unknown key; remove it or correct its spelling"
    return problem, path


def _entry(raw: Any, kind: type, path: str, message: str) -> str:
    """The key that msgspec leaves out of the path of a mapping's value ("autopilot.parameters[...]")."""
    node = raw
    for name, index in _STEPS.findall(path.partition("[...]")[0]):
        if isinstance(node, dict):
            node = node.get(name)
        elif isinstance(node, list) and index and int(index) < len(node):
            node = node[int(index)]
    for key in list(node) if isinstance(node, dict) else ():
        others = {one: node.pop(one) for one in list(node) if one != key}
        try:
            msgspec.convert(raw, kind)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return str(key)
        finally:
            node |= others
    return "…"


def _choices(kind: type, path: str) -> list[str]:
    """The words that may stand at `path` ("drones[2].flavour") of a `kind`, where only certain ones may."""
    nodes: list[Any] = [inspect.type_info(kind)]
    for name, _ in _STEPS.findall(path):
        structs = [node for node in nodes if isinstance(node, inspect.StructType)]
        if name:
            tags = [inspect.LiteralType((node.tag,)) for node in structs if node.tag_field == name]
            fields = [field.type for node in structs for field in node.fields if field.encode_name == name]
            nodes = [*tags, *fields]
        else:
            nodes = [node.item_type for node in nodes if isinstance(node, inspect.VarTupleType)]
        nodes = [one for node in nodes for one in (getattr(node, "types", None) or (node,))]
    return [str(word) for node in nodes if isinstance(node, inspect.LiteralType) for word in node.values]


def line_of(text: str, path: str) -> int | None:
    """The line (from 1) where the field `path` ("drones[2].link") stands in YAML `text`, or its nearest parent."""
    node = yaml_values.compose(text)
    line: int | None = None
    for name, index in _STEPS.findall(path):
        if isinstance(node, yaml.MappingNode) and name:
            match = next(((k, v) for k, v in node.value if k.value == name), None)
            if match is None:
                break
            line, node = match[0].start_mark.line + 1, match[1]
        elif isinstance(node, yaml.SequenceNode) and index and int(index) < len(node.value):
            node = node.value[int(index)]
            line = node.start_mark.line + 1
        else:
            break
    return line
