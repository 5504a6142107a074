"""The live display of `flightstack sensors read`: the newest reading, a bar and a sparkline of the last
minute, or longer where an instrument gives fewer than one a second."""

from __future__ import annotations

import collections
import math

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from mission.documents.printable import printable
from sensors.instruments.samples import InstrumentState, Sample

_SPARKS = "▁▂▃▄▅▆▇█"
_STYLES = {
    InstrumentState.MEASURING: "green",
    InstrumentState.WARMING: "yellow",
    InstrumentState.ZEROING: "yellow",
    InstrumentState.ERROR: "red",
    InstrumentState.SILENT: "red",
}


class LiveDisplay:
    """Redraws itself as samples come in; every state is a word as well as a colour."""

    def __init__(self, console: Console | None = None, width: int = 60) -> None:
        self._width = width
        self._values: collections.deque[float] = collections.deque(maxlen=width)
        self._seconds: collections.deque[int] = collections.deque(maxlen=width)
        self._last: Sample | None = None
        self._count = 0
        self._live = Live(console=console or Console(), refresh_per_second=8, transient=False)
        self._live.start()

    def sample(self, sample: Sample) -> None:
        self._last = sample
        self._count += 1
        value = main_number(sample)
        if value is None:
            return
        second = int(sample.time_s)
        if self._seconds and second == self._seconds[-1]:
            self._values[-1] = value
        else:
            self._values.append(value)
            self._seconds.append(second)

    def tick(self) -> None:
        self._live.update(self.render())

    def close(self) -> None:
        self._live.update(self.render())
        self._live.stop()

    def render(self) -> Group:
        sample = self._last
        if sample is None:
            return Group(Text("waiting for the first byte…", style="dim"))
        head = Text()
        head.append(f"{sample.state.value:<10}", style=_STYLES[sample.state])
        value, unit = main_number(sample), "ppm" if sample.co2_ppm is not None else "m/s"
        if value is not None:
            head.append(f"{value:10.2f} {unit}", style="bold")
        tail = "  ".join(t for t in (f"status {sample.status}" if sample.status else "", sample.reason) if t)
        head.append(f"   {printable(tail)}")
        lines = [head]
        if self._values:
            low, high = min(self._values), max(self._values)
            lines.append(Text(bar(self._values[-1], low, high, self._width), style="cyan"))
            lines.append(Text(sparkline(self._values), style="cyan"))
            seconds = self._seconds[-1] - self._seconds[0] + 1
            span = f"{low:.2f} to {high:.2f} {unit} in the last {seconds} s, {self._count} messages"
            lines.append(Text(span, style="dim"))
        return Group(*lines)


def main_number(sample: Sample) -> float | None:
    """The one number that stands for a sample: ppm, or the wind's speed."""
    if sample.co2_ppm is not None:
        return sample.co2_ppm
    vector = sample.wind_body_mps or sample.wind_ned_mps
    return None if vector is None else math.hypot(*vector)


def bar(value: float, low: float, high: float, width: int) -> str:
    """A horizontal bar from `low` to `high`."""
    share = 0.5 if high <= low else (value - low) / (high - low)
    filled = round(min(max(share, 0.0), 1.0) * width)
    return "█" * filled + "░" * (width - filled)


def sparkline(values: collections.deque[float]) -> str:
    """One character for each value, between the smallest and the largest of them."""
    low, high = min(values), max(values)
    if high <= low:
        return _SPARKS[3] * len(values)
    return "".join(_SPARKS[round((v - low) / (high - low) * (len(_SPARKS) - 1))] for v in values)
