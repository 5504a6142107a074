"""The one door to the compiler: the rules of `mission` and the kernels of the trials become machine code here.

`mission` itself never imports numba (a drone has no compiler). Its rules are plain functions of numbers and small
arrays; registering them here lets compiled kernels call the very same functions.

Machine code is kept in the user's cache directory under a name made of the sources it came from, so a change
anywhere in the rules or kernels is never answered with stale code.
"""

from __future__ import annotations

import hashlib
import os
import pathlib
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numba.extending

import mission
import mission.geometry.formation as formation_rules
import mission.strategies.locus.gradient as gradient_rules
import mission.strategies.locus.groups as group_rules
import mission.strategies.locus.rule as locus_rules
import mission.strategies.locus.seats as seat_rules
import mission.strategies.locus.spiral as spiral_rules
import mission.strategies.mobs as mobs_rules
import mission.strategies.spokes as spoke_rules
import mission.tree.balanced_tree as tree_rules

Function = TypeVar("Function", bound=Callable[..., Any])

_RULES = (
    tree_rules.first_in_order,
    tree_rules.last_in_order,
    tree_rules.heir_slot,
    tree_rules.next_heal,
    tree_rules.next_rebalance,
    gradient_rules.plane_gradient,
    gradient_rules.waypoint_uphill,
    spiral_rules.spiral_point,
    spiral_rules.spiral_index,
    spoke_rules.next_on_spokes,
    spoke_rules.next_bearing,
    locus_rules.locus_begin,
    locus_rules.contacts,
    locus_rules.locus_next,
    locus_rules.turn,
    locus_rules.keep_best,
    locus_rules.search_on,
    locus_rules.is_at,
    seat_rules.nearest_first,
    group_rules.group_count,
    group_rules.group_begin,
    mobs_rules.mobs_begin,
    mobs_rules.mobs_next,
    formation_rules.rotated,
)


_MISSION = (
    "geometry/formation",
    "tree/balanced_tree",
    "strategies/locus/gradient",
    "strategies/mobs",
    "strategies/locus/spiral",
    "strategies/locus/rule",
    "strategies/locus/seats",
    "strategies/locus/groups",
    "strategies/spokes",
)
_TRIALS = (
    "cell",
    "engine",
    "flight",
    "locus",
    "randomness",
    "mobs",
    "motion",
    "outcome",
    "plume",
)


def _source_identity() -> str:
    """A short hash of every source file that a trial's outcome depends on."""
    rules, world = pathlib.Path(str(mission.__file__)).parent, pathlib.Path(__file__).parent
    files = [rules / f"{name}.py" for name in _MISSION]
    files += [world / "trials" / f"{name}.py" for name in _TRIALS]
    files += [world / "compiled.py", *sorted((world / "world").glob("*.py"))]
    digest = hashlib.sha256(numba.__version__.encode())
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


ENGINE = _source_identity()
"""Equal for equal rules and kernels: results of two engines are never mixed."""


def _usual_cache_directory() -> pathlib.Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (pathlib.Path(base) if base else pathlib.Path.home() / ".cache") / "flightstack" / ENGINE


def cache_directory() -> pathlib.Path:
    """Where machine code is kept."""
    return pathlib.Path(str(numba.config.CACHE_DIR))  # type: ignore[attr-defined]


def needs_compiling() -> bool:
    """Whether nothing has been compiled yet for these sources."""
    return not any(cache_directory().rglob("*.nbi"))


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = str(_usual_cache_directory())  # type: ignore[attr-defined]

for _rule in _RULES:
    numba.extending.register_jitable(_rule)


_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy"}
_INNER: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True}


def compiled(function: Function) -> Function:
    """`function` as machine code, compiled at its first call on this machine and kept."""
    return cast(Function, numba.njit(**_OPTIONS)(function))


def kernel(function: Function) -> Function:
    """Like `compiled`, to be called from compiled code only.

    The translation of Python's arguments is left out, which halves the time to compile. Calling such a function
    from Python crashes the interpreter: give a function that Python calls to `compiled`.
    """
    return cast(Function, numba.njit(**_INNER)(function))
