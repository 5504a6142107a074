"""A name for what functions compute: equal for equal code, whatever else stands in its files.

It is derived from the functions themselves: their bytecode, the constants and globals that they use, and all that
they call, in whatever module or package it stands. Comments, docstrings and neighbours in the file do not count.
"""

from __future__ import annotations

import dis
import enum
import functools
import hashlib
import sys
import types
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

_VERSIONED = frozenset(sys.stdlib_module_names) | {
    "llvmlite",
    "msgspec",
    "numba",
    "numpy",
    "pandas",
    "scipy",
    "shapely",
}
"""Packages whose code has a version instead."""
_COMPILER = ("simvehicle.compiled", "simvehicle.code_identity")
"""What makes machine code of others, and remembers which: that differs from process to process."""
_EXACT = 64
"""Larger tables are compared to single precision: their last bits are those of the machine that made them."""


def code_identity(*functions: Callable[..., Any], versions: tuple[str, ...] = ()) -> str:
    """16 hexadecimal digits for what `functions` compute; `versions` are those of the packages that run them."""
    reached: dict[str, str] = {}
    waiting: list[Any] = [plain(function) for function in functions]
    while waiting:
        one = waiting.pop()
        name = _name(one)
        if name not in reached:
            reached[name], further = _own(one)
            waiting += further
    digest = hashlib.sha256(repr((sys.version_info[:2], versions)).encode())
    for name in sorted(reached):
        digest.update(f"{name}={reached[name]};".encode())
    for function in functions:
        digest.update(_name(plain(function)).encode())
    return digest.hexdigest()[:16]


def callees(function: Callable[..., Any]) -> list[types.FunctionType]:
    """All functions of ours or of plug-ins that `function` calls, directly and indirectly, as they were written."""
    found: dict[types.FunctionType, None] = {}
    waiting = [plain(function)]
    while waiting:
        for value in _own(waiting.pop())[1]:
            if isinstance(value, types.FunctionType) and value not in found:
                found[value] = None
                waiting.append(value)
    return list(found)


def plain(function: Any) -> Any:
    """What was written, under a compiler's or a cache's wrapper."""
    function = getattr(function, "py_func", function)
    return getattr(function, "__wrapped__", function)


def _name(value: Any) -> str:
    closure = ""
    if isinstance(value, types.FunctionType) and value.__closure__:
        # One function closed over two others is two functions.
        closure = ",".join(
            _name(plain(c.cell_contents)) for c in value.__closure__ if _walked(c.cell_contents)
        )
    return f"{value.__module__}.{value.__qualname__}({closure})"


def _versioned(value: Any) -> bool:
    module = getattr(value, "__module__", None) or "builtins"
    return module in _COMPILER or module.partition(".")[0] in _VERSIONED


def _walked(value: Any) -> bool:
    return isinstance(plain(value), (types.FunctionType, type)) and not _versioned(plain(value))


@functools.cache
def _own(value: Any) -> tuple[str, tuple[Any, ...]]:
    """(what a function or class is by itself, the functions and classes that it uses)."""
    further: list[Any] = []
    if isinstance(value, type):
        text = repr([_token(member, further) for member in _members(value)])
    else:
        text = repr(
            [
                _code_token(value.__code__, value.__doc__, further),
                [_token(default, further) for default in value.__defaults__ or ()],
                [(name, _token(default, further)) for name, default in (value.__kwdefaults__ or {}).items()],
                [_token(used, further) for used in _used(value)],
            ]
        )
    return hashlib.sha256(text.encode()).hexdigest(), tuple(further)


def _members(kind: type) -> Iterator[Any]:
    """What makes a class: its bases, fields with their defaults, methods and constants."""
    yield kind.__bases__
    yield getattr(kind, "__struct_fields__", None) or getattr(kind, "_fields", None)
    yield tuple(str(default) for default in getattr(kind, "__struct_defaults__", ()))
    for name, member in sorted(vars(kind).items()):
        unwrapped = getattr(member, "fget", None) or getattr(member, "__func__", member)
        if isinstance(unwrapped, types.FunctionType) or (
            not name.startswith("_") and isinstance(unwrapped, (bool, int, float, str, tuple))
        ):
            yield name, unwrapped


def _used(function: types.FunctionType) -> Iterator[Any]:
    """The values of the globals and of the enclosing functions' names that `function` uses."""
    for cell in function.__closure__ or ():
        yield plain(cell.cell_contents)
    for code in _codes(function.__code__):
        instructions = list(dis.get_instructions(code))
        for place, instruction in enumerate(instructions):
            if instruction.opname == "LOAD_GLOBAL":
                value = _global(function, instruction.argval)
                for after in instructions[place + 1 :]:
                    if not isinstance(value, types.ModuleType) or after.opname not in (
                        "LOAD_ATTR",
                        "LOAD_METHOD",
                    ):
                        break
                    value = getattr(value, after.argval)
                yield plain(value)


def _global(function: types.FunctionType, name: str) -> Any:
    if name in function.__globals__:
        return function.__globals__[name]
    builtin = function.__globals__["__builtins__"]
    table = builtin if isinstance(builtin, dict) else vars(builtin)
    if name not in table:
        raise NameError(
            f"{function.__module__}.{function.__qualname__} uses {name}, which must be defined before it"
        )
    return table[name]


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _code_token(code: types.CodeType, doc: str | None, further: list[Any]) -> Any:
    constants = [
        _code_token(constant, None, further)
        if isinstance(constant, types.CodeType)
        else _constant_token(constant)
        for constant in code.co_consts
        if constant is None or constant != doc
    ]
    return code.co_code.hex(), constants, code.co_names, code.co_varnames, code.co_freevars


def _constant_token(constant: Any) -> str:
    """A set written in the code has another order in every process."""
    return repr(sorted(map(repr, constant)) if isinstance(constant, frozenset) else constant)


def _token(value: Any, further: list[Any]) -> Any:
    """`value` as text that is the same in every process; what it refers to is put on `further`."""
    value = plain(value)
    if _walked(value):
        further.append(value)
        return _name(value)
    if isinstance(value, (tuple, list)):
        return [_token(one, further) for one in value]
    if isinstance(value, (set, frozenset)):
        return sorted(repr(_token(one, further)) for one in value)
    if isinstance(value, dict):
        return [(repr(key), _token(one, further)) for key, one in value.items()]
    if isinstance(value, np.ndarray):
        kept = value.astype(np.float32) if value.size > _EXACT and value.dtype.kind == "f" else value
        return str(value.dtype), value.shape, hashlib.sha256(np.ascontiguousarray(kept).tobytes()).hexdigest()
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes, np.generic, enum.Enum)):
        return repr(value)
    return f"{type(value).__module__}.{type(value).__qualname__} {getattr(value, '__name__', '')}"
