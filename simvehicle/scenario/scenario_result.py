"""What a scenario came to."""

from __future__ import annotations

import msgspec


class Violation(msgspec.Struct, frozen=True):
    """An invariant that did not hold."""

    kind: str
    """A short stable word, by which violations are counted and compared."""
    at_s: float
    """Simulated seconds after the first take-off."""
    text: str


class ScenarioResult(msgspec.Struct, frozen=True):
    violations: tuple[Violation, ...]
    """In the order of their times, each kind once for the same drones."""
    transcript: tuple[str, ...]
    """Lines "time who what" for people; the same for the same scenario."""
    figures: dict[str, float]
    """By name with unit: "simulated_s", "min_separation_m"."""
