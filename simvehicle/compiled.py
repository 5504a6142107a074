"""The one door to the compiler: the rules of `mission` and the kernels of the world become machine code here.

`mission` itself never imports numba (a drone has no compiler). Its rules are plain functions of numbers and small
arrays; a kernel calls the very same functions, and so it does with those of another package's strategy.

Machine code is kept in the user's cache directory, each function's under a name made of all the code that it came
from (`simvehicle.code_identity`): a change anywhere in what it calls is never answered with stale code.
"""

from __future__ import annotations

import os
import pathlib
import types
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numba.extending

from simvehicle.code_identity import callees, code_identity, plain

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy"}
_INNER: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True}
_LEAF: dict[str, Any] = {**_INNER, "forceinline": True, "_nrt": False}
_known: set[types.FunctionType] = set()
"""Functions that compiled code can call already."""


def compiled(function: Function) -> Function:
    """`function` as machine code, compiled at its first call on this machine and kept.

    What it calls must be defined before it. Plain functions among that need nothing: they are compiled with it.
    """
    return _made(function, _OPTIONS)


def kernel(function: Function) -> Function:
    """Like `compiled`, to be called from compiled code only.

    The translation of Python's arguments is left out, which halves the time to compile. Calling such a function
    from Python crashes the interpreter: give a function that Python calls to `compiled`.
    """
    return _made(function, _INNER)


def leaf(function: Function) -> Function:
    """Like `kernel`, for what is called millions of times a second: part of its caller, and counts no references.

    It must allocate no array, nor call what does.
    """
    return _made(function, _LEAF)


def called_by_leaves(function: Callable[..., Any]) -> None:
    """Let leaves call the plain `function`, as a leaf itself."""
    if plain(function) not in _known:
        _known.add(plain(function))
        numba.extending.register_jitable(forceinline=True, _nrt=False)(function)


def engine_identity(*functions: Callable[..., Any]) -> str:
    """Equal for equal code under the same compiler: results of two engines are never mixed."""
    return code_identity(*functions, versions=(str(numba.__version__), repr((_INNER, _LEAF))))


def cache_directory() -> pathlib.Path:
    """Where machine code is kept."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return pathlib.Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (pathlib.Path(base) if base else pathlib.Path.home() / ".cache") / "flightstack"


def needs_compiling(function: Callable[..., Any]) -> bool:
    """Whether `function` has never been compiled as it is now."""
    return not any(_directory(plain(function)).rglob("*.nbi"))


def _directory(function: Callable[..., Any]) -> pathlib.Path:
    return cache_directory() / engine_identity(function)


def _made(function: Function, options: dict[str, Any]) -> Function:
    for callee in set(callees(function)) - _known:
        numba.extending.register_jitable(callee)
        _known.add(callee)
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    # The compiler asks for the directory here and once; it has no argument for it.
    numba.config.CACHE_DIR = str(_directory(function))  # type: ignore[attr-defined]
    try:
        return cast(Function, numba.njit(**options)(function))
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]
