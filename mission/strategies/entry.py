"""What the registry knows of a strategy: enough to fly it, to fly trials of it, and to check its parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from mission.geometry.formation import Layout
from mission.strategies.contract import Strategy
from mission.strategies.tick_rule import TickRule

MakeStrategy = Callable[[Layout, Any], Strategy]
"""(layout, parameters) -> a new strategy for one drone and one survey."""


class StrategyEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One strategy. Another package offers one of these under its entry point in `flightstack.strategies`."""

    name: str
    """As in `strategy.name` of a configuration file and `--strategy` of a trial."""
    make: MakeStrategy
    """Usually its class."""
    parameters: type[msgspec.Struct]
    """What a configuration file, or the cell of a trial, may set."""
    in_flight: type[msgspec.Struct] | None = None
    """The same and more, where a flight has parameters that trials have not; None: there are none."""
    rules: tuple[Callable[..., Any], ...] = ()
    """The plain functions of numbers that decide: called as they are in flight, compiled in trials."""
    note: type[msgspec.Struct] | None = None
    """What it lets an order carry to the next root."""
    word: type[msgspec.Struct] | None = None
    """What it says to its neighbours."""
    legs: bool = False
    """Whether the trials have a kernel of this name that flies it from waypoint to waypoint."""
    ticks: TickRule | None = None
    """How the trials fly a reactive strategy, tick by tick."""
