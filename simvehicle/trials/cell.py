"""One cell of an experiment: a strategy in a world, with every number that its trials depend on."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from mission.geometry.formation import Hexagonal, Layout, Rings
from mission.strategies.registry import checked, find
from simvehicle.trials.motion import MOTIONS, MotionName

PlumeKind = Literal["smooth", "perturbed", "gaussian", "gusty"]
"""The paper's grid, smooth or perturbed; the physical plume in a steady or in a gusting wind."""
FailureKind = Literal["none", "generic", "in-plume"]
Unhealed = Literal["reached", "nobody"]
"""Who gets further waypoints once a drone in the tree is lost and nobody heals it."""

GRIDS: tuple[PlumeKind, ...] = ("smooth", "perturbed")
PLUMES: tuple[PlumeKind, ...] = (*GRIDS, "gaussian", "gusty")

_NAMES: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("plume", "plume", PLUMES),
    ("motion", "motion model", MOTIONS),
    ("failure", "kind of failure", ("none", "generic", "in-plume")),
    ("layout", "formation layout", ("rings", "hexagonal")),
    ("unhealed", "way to go on without healing", ("reached", "nobody")),
)
"""Field, what it is, and the names that it may have."""


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """What all trials of a cell have in common. Sources: LoCUS paper, section V; [authors]: their program."""

    strategy: str = "locus"
    """A name of `mission.strategies.registry`."""
    parameters: tuple[tuple[str, float], ...] = ()
    """(name, value) of a reactive strategy's parameters that differ from their defaults."""
    drones: int = 20
    plume: PlumeKind = "smooth"
    arena_m: float = 100.0
    motion: MotionName = "pd"
    speed_mps: float = 5.0
    """Of `cruise`; so are the next two. Reactive strategies keep this speed and acceleration, whatever `motion`."""
    acceleration_mps2: float = 2.0
    settle_s: float = 1.0
    healing: bool = True
    unhealed: Unhealed = "reached"
    """Without healing: the drones that the root still reaches through living ones go on, or nobody does [authors]."""
    failure: FailureKind = "none"
    failure_rate: float = 0.0
    """Probability of failure a drone and tick of 1/16 s; in the plume it is multiplied by the reading."""
    layout: Literal["rings", "hexagonal"] = "rings"
    r_min_m: float = 3.0
    r_max_m: float = 3.0
    step_m: float = 2.0
    jitter_m: float = 0.1
    turn_rad: float = math.pi / 8.0
    """Largest turn of the formation at a step up the gradient [authors]; the paper says 45 degrees."""
    group: Annotated[int, Meta(ge=1)] = 5
    """Size of a sub-swarm of `locus-multi`."""
    success_m: float = 0.91
    """Horizontal distance from the maximum that counts: 1 m in space with the drones' height [authors]."""
    in_plume_draws: int = 2
    """How often a tick the authors' program draws an in-plume failure."""
    gust_sd_mps: float = 0.5
    """Of the `gusty` plume's crosswind."""
    cut_cells: bool = False
    """Cells of the plume's grid are cut towards zero in the world's coordinates, and the plume stands at a whole
    decimetre [authors], so that south and west of the launch point readings are a cell off."""
    cut_goal: bool = False
    """The place that counts as the maximum is cut to whole metres towards zero [authors]."""
    limit_ticks: int = 1_000_000
    source: tuple[float, float] | None = None
    """The plume's origin (north, east of the launch point, m); None: drawn anew for every trial."""

    def formation(self) -> Layout:
        if self.layout == "hexagonal":
            return Hexagonal(self.r_max_m)
        return Rings(self.r_max_m, self.r_max_m / self.r_min_m)

    def problems(self) -> list[str]:
        """What makes this cell impossible, one clear sentence each."""
        found = self._strategy_problems()
        found += [
            f"no {what} is called {getattr(self, name)!r}; there are {', '.join(known)}"
            for name, what, known in _NAMES
            if getattr(self, name) not in known
        ]
        if self.cut_cells and self.plume not in GRIDS:
            found.append(f"only the plumes {' and '.join(GRIDS)} have cells to cut, not {self.plume}")
        if not 1 <= self.drones <= 1000:
            found.append(f"a swarm has 1 to 1000 drones, not {self.drones}")
        if not 0.0 <= self.failure_rate <= 1.0:
            found.append(f"a failure rate is a probability from 0 to 1, not {self.failure_rate:g}")
        elif self.failure == "none" and self.failure_rate > 0.0:
            found.append(
                f"a failure rate of {self.failure_rate:g} needs a kind of failure: generic or in-plume"
            )
        found += [
            f"{name} must be above 0, not {getattr(self, name):g}"
            for name in ("speed_mps", "acceleration_mps2", "r_min_m", "r_max_m", "step_m", "success_m")
            if not (getattr(self, name) > 0.0 and math.isfinite(getattr(self, name)))
        ]
        found += [
            f"{name} must not be below 0, but is {getattr(self, name):g}"
            for name in ("settle_s", "jitter_m", "gust_sd_mps")
            if not (getattr(self, name) >= 0.0 and math.isfinite(getattr(self, name)))
        ]
        if self.r_min_m > self.r_max_m:
            found.append(f"r_min ({self.r_min_m:g} m) is above r_max ({self.r_max_m:g} m)")
        if not 10.0 <= self.arena_m <= 10_000.0:
            found.append(f"the arena's radius must be 10 to 10000 m, not {self.arena_m:g}")
        elif self.source is not None and not math.hypot(*self.source) <= self.arena_m:
            found.append(
                f"the plume's origin ({self.source[0]:g}, {self.source[1]:g}) m is outside the arena of "
                f"radius {self.arena_m:g} m"
            )
        if self.limit_ticks < 1:
            found.append(f"a trial needs at least 1 tick, not {self.limit_ticks}")
        return found

    def _strategy_problems(self) -> list[str]:
        try:
            entry = find(self.strategy)
            if not entry.legs and entry.ticks is None:
                return [f"strategy {self.strategy} has no rule that trials could compile: it flies only"]
            if self.parameters and entry.ticks is None:
                return [f"strategy {self.strategy} is flown with the fields of the cell, not with parameters"]
            if entry.ticks is not None:
                checked(entry, dict(self.parameters))
        except ValueError as error:
            return [str(error)]
        return []

    def label(self) -> str:
        """A short name for tables and figures."""
        text = f"{self.strategy} x{self.drones} {self.plume}"
        if not self.healing:
            text += " no-heal" if self.unhealed == "reached" else " no-heal-stop"
        if self.failure != "none":
            text += f" {self.failure} {self.failure_rate:g}"
        return text
