"""What the words of a YAML file mean: numbers are what people mean by them, and what two readers may take for two
things is refused.

YAML 1.1 takes 01500 for 832, 12:30:00 for 45000 and `no` for false; 1.2 does not. Here such words end in an error
that says how to write what is meant. Dates are text; 1e3 is a thousand.
"""

from __future__ import annotations

import math
import re
from typing import Any, Final

import yaml

DEEPEST: Final = 50
MOST_VALUES: Final = 200_000
"""With every alias counted as often as it is used: a few lines of aliases of aliases are otherwise billions."""
_LARGEST: Final = 1e15
"""Beyond it no number means anything here, and squares of it overflow. Whole numbers may have 64 bits."""

_INT: Final = "tag:yaml.org,2002:int"
_FLOAT: Final = "tag:yaml.org,2002:float"
_AMBIGUOUS: Final = "!ambiguous"
_WORDS: Final = (
    ("tag:yaml.org,2002:merge", r"<<"),
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|"),
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE"),
    (_INT, r"[-+]?(?:0|[1-9][0-9]*)"),
    (_FLOAT, r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"),
    (_FLOAT, r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"),
    (_AMBIGUOUS, r"(?i:yes|no|on|off)"),
    (_AMBIGUOUS, r"[-+]?0[0-9][0-9_]*(?:\.[0-9_]*)?(?:[eE][-+]?[0-9]+)?"),
    (_AMBIGUOUS, r"[-+]?0[xX][0-9a-fA-F_]+|[-+]?0[oO][0-7_]+|[-+]?0[bB][01_]+"),
    (_AMBIGUOUS, r"[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?"),
    (_AMBIGUOUS, r"[-+]?[0-9][0-9_]*_[0-9_]*(?:\.[0-9_]*)?|[-+]?[0-9]+\.[0-9_]*_[0-9_]*"),
)
_TAB: Final = re.compile(r" *\t")


class _Loader(yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader):  # type: ignore[misc]
    """YAML that refuses a key given twice, where the second would silently win, and words of two meanings."""

    yaml_implicit_resolvers: dict[str | None, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012 (PyYAML's)


class _Dumper(yaml.SafeDumper):
    """Puts into quotation marks what this reader, or one of YAML 1.1, would take for something else than text."""


def refused(problem: str, mark: Any) -> yaml.YAMLError:
    """The error of one place in the text."""
    return yaml.constructor.ConstructorError(None, None, problem, mark)


def _mapping(loader: Any, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        merges = key_node.tag == "tag:yaml.org,2002:merge"
        key = "<<" if merges else loader.construct_object(key_node, deep=True)
        if not isinstance(key, str | int | float | bool):
            raise refused("a key must be a word", key_node.start_mark)
        if key in seen:
            raise refused(f"the key {key!r} stands twice", key_node.start_mark)
        seen.add(key)
    loader.flatten_mapping(node)  # merged keys come first: the mapping's own replace them
    return {
        loader.construct_object(k, deep=True): loader.construct_object(v, deep=True) for k, v in node.value
    }


def _float(_loader: Any, node: yaml.ScalarNode) -> float:
    text = str(node.value)
    special = text.lstrip("+-").lower()
    value = math.inf if special == ".inf" else math.nan if special == ".nan" else float(text)
    if not abs(value) <= _LARGEST:
        raise refused(f"{text} is no number to work with; leave the key out for its default", node.start_mark)
    return value


def _int(_loader: Any, node: yaml.ScalarNode) -> int:
    text = str(node.value)
    if len(text) > 20 or not abs(int(text)) < 1 << 63:
        raise refused("a value cannot be read: the number is too large", node.start_mark)
    return int(text)


def _ambiguous(_loader: Any, node: yaml.ScalarNode) -> Any:
    text = str(node.value)
    raise refused(f"{text} {_meant(text)}, or {text!r} in quotation marks for text", node.start_mark)


def _meant(text: str) -> str:
    """What is wrong with a word of two meanings, and how to write the number or the truth that is meant."""
    lower = text.lower()
    if lower in ("yes", "on", "no", "off"):
        return f"may be text or a truth value; write {'true' if lower in ('yes', 'on') else 'false'}"
    if ":" in text:
        return "may be a time or a number to base 60; write the number, such as seconds"
    digits = lower.lstrip("+-")
    if digits[:2] in ("0x", "0o", "0b"):
        return "is not a decimal number; write it in decimal digits"
    sign = "-" if text.startswith("-") else ""
    plain = digits.replace("_", "").lstrip("0") or "0"
    plain = f"0{plain}" if plain[0] in ".e" else plain
    return (
        f"may be octal or decimal; write {sign}{plain}"
        if "_" not in text
        else f"has underscores; write {sign}{plain}"
    )


for _tag, _pattern in _WORDS:
    for _kind in (_Loader, _Dumper):
        _kind.add_implicit_resolver(_tag, re.compile(f"(?:{_pattern})\\Z"), None)
_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)
_Loader.add_constructor(_FLOAT, _float)
_Loader.add_constructor(_INT, _int)
_Loader.add_constructor(_AMBIGUOUS, _ambiguous)


def load(text: str) -> Any:
    """The one value that `text` holds. `yaml.YAMLError` says what is wrong, with its place in `problem_mark`."""
    try:
        _refuse_size(text)
        return yaml.load(text, Loader=_Loader)  # noqa: S506 (a subclass of the safe loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        lines = text.split("\n")
        if mark is not None and mark.line < len(lines) and _TAB.match(lines[mark.line]):
            raise refused("a tab; YAML indents with spaces: replace it", mark) from error
        raise


def compose(text: str) -> yaml.Node | None:
    """The nodes of `text` with their places, nothing made of them."""
    return yaml.compose(text, Loader=_Loader)


def text_of(value: Any) -> str:
    """YAML that `load` reads as `value` again, and any other reader too."""
    return str(yaml.dump(value, Dumper=_Dumper, sort_keys=False, width=110))


def _refuse_size(text: str) -> None:
    """Depth, tags and aliases are looked at before anything is built: building them may end the process."""
    sizes: dict[str, int] = {}
    open_nodes: list[tuple[str | None, int]] = []
    total = 0
    for event in yaml.parse(text, Loader=_Loader):
        mark = event.start_mark
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise refused(f"the tag {tag} is not used here; write the plain value", mark)
        if isinstance(event, yaml.AliasEvent):
            if any(anchor == event.anchor for anchor, _ in open_nodes):
                raise refused(f"the alias *{event.anchor} refers to what it stands in", mark)
            total += sizes.get(str(event.anchor), 1)
        elif isinstance(event, yaml.CollectionStartEvent):
            if len(open_nodes) >= DEEPEST:
                raise refused("lists or mappings are nested too deeply", mark)
            open_nodes.append((event.anchor, total))
            total += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_nodes.pop()
            if anchor is not None:
                sizes[anchor] = total - before
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
        if total > MOST_VALUES:
            raise refused(f"more than {MOST_VALUES} values, aliases counted as often as they are used", mark)
