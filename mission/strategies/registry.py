"""The strategies by name: ours, and those of other packages (entry points of the group `flightstack.strategies`).

A plug-in is looked for when its name is asked for, and loaded only then: one that is broken cannot harm a drone that
flies another strategy.
"""

from __future__ import annotations

import functools
import importlib.metadata
from typing import Any

import msgspec

from mission.geometry.formation import Layout
from mission.strategies import mobs, mobs_authors, virtual_forces
from mission.strategies.contract import Strategy
from mission.strategies.entry import StrategyEntry
from mission.strategies.infotaxis import infotaxis
from mission.strategies.lattice import lattice
from mission.strategies.locus import hybrid, multi
from mission.strategies.locus import strategy as locus
from mission.strategies.surging import spiral_surge, surge_cast
from mission.strategies.tracing import anemotaxis, casting, chemotaxis, fluxotaxis

GROUP = "flightstack.strategies"
BUILT_IN: dict[str, StrategyEntry] = {
    entry.name: entry
    for entry in (
        locus.ENTRY,
        mobs.ENTRY,
        hybrid.ENTRY,
        multi.ENTRY,
        mobs_authors.ENTRY,
        casting.ENTRY,
        chemotaxis.ENTRY,
        anemotaxis.ENTRY,
        fluxotaxis.ENTRY,
        virtual_forces.ENTRY,
        virtual_forces.UPWIND_ENTRY,
        surge_cast.ENTRY,
        spiral_surge.ENTRY,
        infotaxis.ENTRY,
        infotaxis.COOPERATIVE,
        *lattice.ENTRIES,
    )
}


@functools.cache
def _plug_ins() -> dict[str, tuple[importlib.metadata.EntryPoint, ...]]:
    """Name -> the entry points that claim it; nothing of theirs is imported here."""
    found: dict[str, tuple[importlib.metadata.EntryPoint, ...]] = {}
    for point in importlib.metadata.entry_points(group=GROUP):
        if point not in found.get(point.name, ()):  # a path that stands twice gives a package twice
            found[point.name] = (*found.get(point.name, ()), point)
    return found


def names() -> tuple[str, ...]:
    """Of all strategies, ours first; none of another package is loaded for it."""
    return (*BUILT_IN, *sorted(set(_plug_ins()) - set(BUILT_IN)))


def find(name: str) -> StrategyEntry:
    """The strategy called `name`. `ValueError` says in one line why there is none, and which package to mend."""
    claims = _plug_ins().get(name, ())
    packages = ", ".join(_package(point) for point in claims)
    if name in BUILT_IN:
        if claims:
            raise ValueError(
                f"strategy {name} is one of flightstack's own, and the package {packages} has another of that "
                "name: rename it there or uninstall the package"
            )
        return BUILT_IN[name]
    if not claims:
        raise ValueError(f"no strategy is called {name!r}; there are {', '.join(names())}")
    if len(claims) > 1:
        raise ValueError(f"strategy {name} is in more than one package, {packages}: uninstall all but one")
    return _load(claims[0])


def forget_packages() -> None:
    """Look for other packages' strategies anew: some may have been installed meanwhile."""
    _plug_ins.cache_clear()
    _load.cache_clear()


def make(name: str, *, layout: Layout, **parameters: Any) -> Strategy:
    """A new strategy object for one drone and one survey. `ValueError` says in one line what is wrong."""
    entry = find(name)
    return entry.make(layout, _checked(entry.name, entry.in_flight or entry.parameters, parameters))


def checked(entry: StrategyEntry, parameters: dict[str, Any]) -> msgspec.Struct:
    """`parameters` as the strategy's own struct. `ValueError` says in one line what is wrong."""
    return _checked(entry.name, entry.parameters, parameters)


def _checked(name: str, kind: type[msgspec.Struct], parameters: dict[str, Any]) -> msgspec.Struct:
    known = kind.__struct_fields__
    for key in parameters:
        if key not in known:
            raise ValueError(f"strategy {name} has no parameter {key!r}; it has {', '.join(known)}")
    try:
        return msgspec.convert(parameters, kind)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        field = f"{where.rstrip('`')}: " if where else ""  # what concerns several fields has no one place
        raise ValueError(f"strategy {name}: {field}{problem}") from error


def _package(point: importlib.metadata.EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.module


@functools.cache
def _load(point: importlib.metadata.EntryPoint) -> StrategyEntry:
    where = f"strategy {point.name} of the package {_package(point)}"
    try:
        entry = point.load()
    except Exception as error:
        first = str(error).partition("\n")[0]
        raise ValueError(f"{where} cannot be loaded: {type(error).__name__}: {first}") from error
    if not isinstance(entry, StrategyEntry):
        raise ValueError(f"{where}: {point.value} is no StrategyEntry but {type(entry).__name__}")
    if entry.name != point.name:
        raise ValueError(f"{where}: its entry is called {entry.name!r}; both need the same name")
    return entry
