"""Figures of this project, each printed beside its target. `python -m benchmarks` runs them all."""

from __future__ import annotations

import math


class Figures:
    """Prints figures as they come, so that a missed target hides no other, and leaves with an error at the end."""

    def __init__(self) -> None:
        self._missed: list[str] = []

    def show(
        self, what: str, measured: float, unit: str = "", *, least: float = -math.inf, most: float = math.inf
    ) -> None:
        """One line: what was measured, and whether it lies in its target (`least` to `most`, both inclusive)."""
        bounds = [f">= {least:g}"] * (least > -math.inf) + [f"<= {most:g}"] * (most < math.inf)
        met = least <= measured <= most
        verdict = f"target {' and '.join(bounds)}: {'ok' if met else 'MISSED'}" if bounds else ""
        print(f"  {what:<40} {measured:10.3f} {unit:<9} {verdict}".rstrip(), flush=True)
        if not met:
            self._missed.append(what)

    def leave(self) -> None:
        """`SystemExit` that names the targets that were missed; nothing if all were met."""
        if self._missed:
            raise SystemExit(f"targets missed: {', '.join(self._missed)}")
