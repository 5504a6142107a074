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

T = TypeVar("T")
_STEPS = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
"""The steps of a field's path ("drones[2].link"): names and places in lists."""


class DocumentError(ValueError):
    """A file that a person wrote says something that cannot be. Its text is one line: where, what, how to mend."""

    def __init__(self, file: str, problem: str, *, line: int | None = None, field: str | None = None) -> None:
        place = file if line is None else f"{file}:{line}"
        super().__init__(f"{place}: {field}: {problem}" if field else f"{place}: {problem}")
        self.file = file
        self.line = line
        self.field = field


class _Loader(yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader):  # type: ignore[misc]
    """YAML that refuses a key given twice: the second would silently win."""


def _mapping(loader: Any, node: yaml.MappingNode) -> dict[Any, Any]:
    loader.flatten_mapping(node)
    seen: dict[Any, int] = {}
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str | int | float | bool):
            raise yaml.constructor.ConstructorError(None, None, "a key must be a word", key_node.start_mark)
        if key in seen:
            raise yaml.constructor.ConstructorError(
                None, None, f"the key {key!r} stands twice", key_node.start_mark
            )
        seen[key] = key_node.start_mark.line
    return {
        loader.construct_object(k, deep=True): loader.construct_object(v, deep=True) for k, v in node.value
    }


_LARGEST = 1e15
"""Beyond it no number means anything here, and squares of it overflow. Whole numbers may have 64 bits."""


def _float(loader: Any, node: yaml.ScalarNode) -> float:
    value: float = loader.construct_yaml_float(node)
    if not abs(value) <= _LARGEST:
        raise yaml.constructor.ConstructorError(
            None,
            None,
            f"{node.value} is no number to work with; leave the key out for its default",
            node.start_mark,
        )
    return value


def _int(loader: Any, node: yaml.ScalarNode) -> int:
    value: int = loader.construct_yaml_int(node)
    if not abs(value) < 1 << 63:
        raise yaml.constructor.ConstructorError(None, None, "the number is too large", node.start_mark)
    return value


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)
_Loader.add_constructor("tag:yaml.org,2002:float", _float)
_Loader.add_constructor("tag:yaml.org,2002:int", _int)


def read_text(path: str | pathlib.Path) -> str:
    """The UTF-8 text of a file, without a byte order mark. `DocumentError` says why it cannot be read."""
    try:
        return pathlib.Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DocumentError(str(path), f"cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DocumentError(str(path), "cannot be read: it is not UTF-8 text") from error


def parse(text: str, kind: type[T], file: str) -> T:
    """Read YAML `text` (of the file named `file`) as a `kind`, a msgspec struct that forbids unknown fields."""
    try:
        raw = yaml.load(text, Loader=_Loader)  # noqa: S506 (a subclass of the safe loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise DocumentError(file, problem, line=mark.line + 1 if mark else None) from error
    except RecursionError as error:
        raise DocumentError(file, "lists or mappings are nested too deeply") from error
    except ValueError as error:  # a date without such a day, a number of thousands of digits
        raise DocumentError(file, f"a value cannot be read: {error}") from error
    if raw is None:
        raise DocumentError(file, "the file is empty")
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        problem, path = _split(str(error))
        if problem.startswith(("Invalid enum value", "Invalid value")) and (choices := _choices(kind, path)):
            problem += f"; write {' or '.join(choices)}"
        raise DocumentError(file, problem, line=line_of(text, path), field=path or None) from error


def fault_of(file: str, field: str, problem: str) -> DocumentError:
    """The error of what a file asks for and the machine has not, found when it was opened: with the field's line."""
    line = None
    with contextlib.suppress(OSError, ValueError, yaml.YAMLError):  # it has been changed since, or is no file
        line = line_of(pathlib.Path(file).read_text(encoding="utf-8"), field)
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
    node = yaml.compose(text, Loader=yaml.SafeLoader)
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
