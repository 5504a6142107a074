"""Formations: which slots there are, where each stands, and which slot is whose parent.

Slot 0 is the root; slots are numbered level by level, so a drone's place is a pure function of its slot and
needs no messages (LoCUS paper, III-A1). Two layouts stand behind one interface:

* `Rings`, the paper's: level k is a circle of radius k * spacing with floor(2 pi / asin(1 / (k * spread)))
  slots (Lemma 1), where spread = r_max / r_min. A child can be farther from its parent than the spacing (ring
  2 to ring 1 with spread 1: 1.24 times), which breaks the paper's own promise of radio range.
* `Hexagonal`, ours: a triangular lattice. Level k has 6 k slots, every link to a parent is exactly one
  spacing long, and no two slots are nearer than one spacing.
"""

from __future__ import annotations

import abc
import dataclasses
import functools
import math
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

IntArray: TypeAlias = NDArray[np.int64]
FloatArray: TypeAlias = NDArray[np.float64]
Offset: TypeAlias = tuple[float, float]
"""(north_m, east_m) from the root's slot."""

_SAME = 1e-9
"""Two lengths (in spacings) or angles that differ by less are equal: geometry's ties survive rounding."""


@dataclasses.dataclass(frozen=True)
class SlotTable:
    """The first n slots as arrays, in the form in which the tree's rules (and a compiler) take them."""

    level: IntArray
    """(n,) level of each slot, ascending, 0 at the root."""
    parent: IntArray
    """(n,) parent slot, -1 at the root; always smaller than the slot itself."""
    offset_m: FloatArray
    """(n, 2) north and east from the root's slot, formation not rotated."""
    child_start: IntArray
    """(n + 1,) the children of slot s are child[child_start[s]:child_start[s + 1]], ascending."""
    child: IntArray

    def __len__(self) -> int:
        return len(self.level)


@dataclasses.dataclass(frozen=True)
class Layout(abc.ABC):
    """A way to place slots; `spacing_m` is the distance between levels (the paper's r_max)."""

    spacing_m: float
    name: ClassVar[str]

    def __post_init__(self) -> None:
        if not (self.spacing_m > 0.0 and math.isfinite(self.spacing_m)):
            raise ValueError(f"the formation's spacing is {self.spacing_m} m; it must be above 0")

    @abc.abstractmethod
    def capacity(self, level: int) -> int:
        """How many slots `level` has."""

    @abc.abstractmethod
    def ring(self, level: int) -> FloatArray:
        """(capacity, 2) north and east of the slots of `level`, in spacings."""

    def table(self, slots: int) -> SlotTable:
        """The first `slots` slots; made once and kept."""
        return _table(self, slots)

    def level(self, slot: int) -> int:
        level, first = 0, 0
        while slot >= first + self.capacity(level):
            first += self.capacity(level)
            level += 1
        return level

    def offset_m(self, slot: int) -> Offset:
        """Place of `slot` from the root's slot, formation not rotated."""
        return _offset_m(self, slot)

    def parent(self, slot: int) -> int | None:
        """The nearest slot of the previous level, the lowest number on ties; None at the root."""
        return int(self.table(slot + 1).parent[slot]) if slot else None

    def full_levels(self, drones: int) -> int:
        """How many levels `drones` drones fill from the root on, the root's own counted; at least 1."""
        level, left = 0, drones
        while left >= self.capacity(level):
            left -= self.capacity(level)
            level += 1
        return max(level, 1)

    def longest_link_m(self, drones: int) -> float:
        """The longest distance from a drone to its parent when slots 0..drones-1 are taken."""
        table = self.table(drones)
        if drones < 2:
            return 0.0
        return float(np.linalg.norm(table.offset_m[1:] - table.offset_m[table.parent[1:]], axis=1).max())

    def smallest_separation_m(self, drones: int) -> float:
        """The smallest distance between two drones when slots 0..drones-1 are taken; infinite for one."""
        if drones < 2:
            return math.inf
        places_m = self.table(drones).offset_m
        apart_m = np.linalg.norm(places_m[:, None, :] - places_m[None, :, :], axis=2)
        return float(apart_m[np.triu_indices(drones, 1)].min())

    def problems(self, drones: int, separation_m: float, radio_range_m: float | None = None) -> list[str]:
        """Why `drones` drones must not fly this formation: one clear sentence each, empty if they may.

        After losses the drones stand on a subset of these slots whose links are a subset of these links, so
        what holds for the whole formation holds for every healed one. `radio_range_m` None: one spacing.
        """
        if drones < 1:
            return [f"a formation needs at least 1 drone, not {drones}"]
        found = []
        # What would do is told from the same layout spaced 1 m: a tiny spacing has distances of 0.
        unit = dataclasses.replace(self, spacing_m=1.0)
        reach_m = self.spacing_m if radio_range_m is None else radio_range_m
        link_m = self.longest_link_m(drones)
        if link_m > reach_m * (1.0 + _SAME):
            mend = f"a spacing of at most {reach_m / unit.longest_link_m(drones):.2f} m"
            if self.name != Hexagonal.name and self.spacing_m <= reach_m:
                mend += f" or the {Hexagonal.name} layout"
            found.append(
                f"{drones} drones in the {self.name} layout at a spacing of {self.spacing_m:g} m have a link "
                f"of {link_m:.2f} m, but the radio reaches {reach_m:g} m: choose {mend}"
            )
        apart_m = self.smallest_separation_m(drones)
        if apart_m < separation_m * (1.0 - _SAME):
            found.append(
                f"{drones} drones in the {self.name} layout spaced {self.spacing_m:g} m come within "
                f"{apart_m:.2f} m, but must stay {separation_m:g} m apart: choose a spacing of "
                f"at least {separation_m / unit.smallest_separation_m(drones):.2f} m"
            )
        return found


@dataclasses.dataclass(frozen=True)
class Rings(Layout):
    """The paper's circles; `spread` is r_max / r_min."""

    spread: float = 1.0
    name: ClassVar[str] = "rings"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.spread >= 1.0 and math.isfinite(self.spread)):
            raise ValueError(f"the formation's spread r_max / r_min is {self.spread}; it must be at least 1")

    def capacity(self, level: int) -> int:
        if level == 0:
            return 1
        # Lemma 1. Level 2 gives 11.999999999999998 in floating point where the exact value is 12.
        return math.floor(2.0 * math.pi / math.asin(1.0 / (level * self.spread)) + _SAME)

    def ring(self, level: int) -> FloatArray:
        angle_rad = np.arange(self.capacity(level)) * (2.0 * math.pi / self.capacity(level))
        return level * np.column_stack((np.cos(angle_rad), np.sin(angle_rad)))


@dataclasses.dataclass(frozen=True)
class Hexagonal(Layout):
    """The triangular lattice: level k is a hexagon of side k, first corner to the north, then clockwise."""

    name: ClassVar[str] = "hexagonal"

    def capacity(self, level: int) -> int:
        return 6 * level if level else 1

    def ring(self, level: int) -> FloatArray:
        if level == 0:
            return np.zeros((1, 2))
        corner_rad = np.arange(7) * (math.pi / 3.0)
        corners = level * np.column_stack((np.cos(corner_rad), np.sin(corner_rad)))
        side, step = np.divmod(np.arange(6 * level), level)
        along = (step / level)[:, None]
        return np.asarray(corners[side] * (1.0 - along) + corners[side + 1] * along)


LAYOUTS: dict[str, type[Layout]] = {layout.name: layout for layout in (Hexagonal, Rings)}


def make_layout(name: str, spacing_m: float) -> Layout:
    """The layout called `name`; `ValueError` names the ones that there are."""
    try:
        kind = LAYOUTS[name]
    except KeyError:
        raise ValueError(f"no formation layout is called {name!r}; there are {', '.join(LAYOUTS)}") from None
    return kind(spacing_m)


def rotated(offset_m: Offset, rotation_rad: float) -> Offset:
    """`offset_m` turned by `rotation_rad` from north towards east."""
    north_m, east_m = offset_m
    cos, sin = math.cos(rotation_rad), math.sin(rotation_rad)
    return north_m * cos - east_m * sin, north_m * sin + east_m * cos


@functools.lru_cache(maxsize=4096)
def _offset_m(layout: Layout, slot: int) -> Offset:
    north_m, east_m = layout.table(slot + 1).offset_m[slot].tolist()
    return north_m, east_m


@functools.lru_cache(maxsize=256)
def _table(layout: Layout, slots: int) -> SlotTable:
    if slots < 1:
        raise ValueError(f"a formation has at least 1 slot, not {slots}")
    levels, parents, rings = [0], [-1], [layout.ring(0)]
    first = 0
    while len(levels) < slots:
        level = levels[-1] + 1
        inner, ring = rings[-1], layout.ring(level)
        for place in ring:
            away = np.linalg.norm(inner - place, axis=1)
            parents.append(first + int(np.flatnonzero(away <= away.min() + _SAME)[0]))
        first = len(levels)
        levels += [level] * len(ring)
        rings.append(ring)
    parent = np.array(parents[:slots], dtype=np.int64)
    order = np.argsort(parent[1:], kind="stable").astype(np.int64) + 1
    counts = np.bincount(parent[1:], minlength=slots)
    table = SlotTable(
        level=np.array(levels[:slots], dtype=np.int64),
        parent=parent,
        offset_m=np.concatenate(rings)[:slots] * layout.spacing_m,
        child_start=np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(counts, dtype=np.int64))),
        child=order,
    )
    for field in dataclasses.fields(table):
        getattr(table, field.name).flags.writeable = False
    return table


def problems(
    drones: int,
    spacing_m: float,
    separation_m: float,
    radio_range_m: float | None = None,
    layout: str = Hexagonal.name,
) -> list[str]:
    """`Layout.problems` of the layout called `layout`: what a planner asks with the numbers of a file."""
    return make_layout(layout, spacing_m).problems(drones, separation_m, radio_range_m)
