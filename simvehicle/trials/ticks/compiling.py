"""What the compiler says of a rule that it cannot compile, in one line."""

from __future__ import annotations

from mission.strategies.tick_rule import TickRule


def not_compiled(name: str, rule: TickRule, error: Exception) -> str:
    said = [line.strip() for line in str(error).splitlines() if line.strip()]
    stages = [place for place, line in enumerate(said) if "Failed in nopython mode" in line]
    where = f"{rule.rule.__module__}.{rule.rule.__qualname__}"
    # The compiler tells call by call, each beginning with its own stage; what is wrong stands behind the last.
    first = said[stages[-1] + 1 :] if stages else said
    return f"strategy {name}: its rule {where} cannot be compiled: {' '.join(first[:1])}"
