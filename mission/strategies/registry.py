"""Search strategies, one per file, and the table of their names."""

from __future__ import annotations

from typing import Any

import msgspec

from mission.geometry.formation import Layout
from mission.strategies.contract import Strategy
from mission.strategies.locus.hybrid import LocusHybrid
from mission.strategies.locus.multi import LocusMulti
from mission.strategies.locus.strategy import Locus
from mission.strategies.mobs import Mobs

STRATEGIES: dict[str, type[Locus] | type[Mobs] | type[LocusHybrid] | type[LocusMulti]] = {
    "locus": Locus,
    "mobs": Mobs,
    "locus-hybrid": LocusHybrid,
    "locus-multi": LocusMulti,
}
"""Name in a configuration file -> class. A class takes (layout, parameters) and has its typed `Parameters`."""


def make(name: str, *, layout: Layout, **parameters: Any) -> Strategy:
    """A new strategy object for one drone and one survey. `ValueError` says in one line what is wrong."""
    kind: Any = STRATEGIES.get(name)
    if kind is None:
        raise ValueError(f"no strategy is called {name!r}; there are {', '.join(sorted(STRATEGIES))}")
    known = kind.Parameters.__struct_fields__
    for key in parameters:
        if key not in known:
            raise ValueError(f"strategy {name} has no parameter {key!r}; it has {', '.join(known)}")
    try:
        strategy: Strategy = kind(layout, msgspec.convert(parameters, kind.Parameters))
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        raise ValueError(f"strategy {name}: {where.rstrip('`')}: {problem}") from error
    return strategy
