"""A survey's progress on the operator's screen: a live table on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from flightstack.swarm.wire import DroneState
from simvehicle.survey.supervisor import Stand, Supervisor
from simvehicle.survey.watch import SurveyWatch

LINE_EVERY_WALL_S = 10.0
REDRAW_HZ = 4.0


class Progress(Protocol):
    """Shown from `__enter__` to `__exit__`; `show` may be called as often as one likes."""

    def __enter__(self) -> Progress: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def show(self, now_s: float, *, wall_s: float, note: str) -> None: ...


def make_progress(watch: SurveyWatch, supervisor: Supervisor, speedup: float) -> Progress:
    """What fits standard error."""
    if sys.stderr.isatty():
        return LiveTable(watch, supervisor, speedup)
    return Lines(watch, supervisor, speedup)


class _View:
    """What both displays say."""

    def __init__(self, watch: SurveyWatch, supervisor: Supervisor, speedup: float) -> None:
        self._watch = watch
        self._supervisor = supervisor
        self._speedup = speedup

    def headline(self, now_s: float, wall_s: float, note: str) -> str:
        watch = self._watch
        elapsed_s = watch.since_takeoff_s(now_s)
        parts = [str(self._supervisor.stand) if self._supervisor.stand is not Stand.FLYING else self._stage()]
        if elapsed_s is not None:
            parts.append(f"{elapsed_s:.0f} s simulated")
        parts.append(f"{wall_s:.0f} s elapsed, at most {self._speedup:g}x")
        parts.append(f"{len(self._supervisor.alive)} of {len(watch.members)} agents run")
        if watch.best_co2_ppm is not None:
            away_m = watch.from_best_m()
            best = f"best {watch.best_co2_ppm:.0f} ppm"
            parts.append(f"{best}, {away_m:.0f} m away" if away_m is not None else best)
        if note:
            parts.append(note)
        return " | ".join(parts)

    def phase(self, drone: int, state: DroneState, now_s: float) -> str:
        """The drone's own word for it, unless its agent is dead or silent."""
        if drone not in self._supervisor.alive:
            return "dead"
        return str(state.phase) if drone in self._watch.talking(now_s) else "silent"

    def _stage(self) -> str:
        order = self._watch.order
        return (
            str(self._supervisor.stand)
            if order is None
            else {"form": "forming up"}.get(order.stage, f"{order.stage}")
        )


class Lines(_View):
    """One line every ten seconds on standard error: for logs and continuous integration."""

    def __init__(self, watch: SurveyWatch, supervisor: Supervisor, speedup: float) -> None:
        super().__init__(watch, supervisor, speedup)
        self._next_wall_s = 0.0

    def __enter__(self) -> Lines:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def show(self, now_s: float, *, wall_s: float, note: str) -> None:
        if wall_s < self._next_wall_s:
            return
        self._next_wall_s = wall_s + LINE_EVERY_WALL_S
        phases = " ".join(f"{d}:{self.phase(d, s, now_s)}" for d, s in sorted(self._watch.states.items()))
        line = f"{self.headline(now_s, wall_s, note)} | {phases or 'nobody heard yet'}"
        print(line, file=sys.stderr, flush=True)  # noqa: T201


class LiveTable(_View):
    """A table that is drawn over itself."""

    def __init__(self, watch: SurveyWatch, supervisor: Supervisor, speedup: float) -> None:
        super().__init__(watch, supervisor, speedup)
        self._live = Live(console=Console(stderr=True), auto_refresh=False, transient=False)
        self._next_draw_s = 0.0

    def __enter__(self) -> LiveTable:
        self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.__exit__(kind, error, trace)

    def show(self, now_s: float, *, wall_s: float, note: str) -> None:
        if time.monotonic() < self._next_draw_s:
            return
        self._next_draw_s = time.monotonic() + 1.0 / REDRAW_HZ
        self._live.update(Group(Text(self.headline(now_s, wall_s, note)), self.table(now_s)), refresh=True)

    def table(self, now_s: float) -> Table:
        """One line a drone."""
        table = Table(box=None, pad_edge=False)
        for name in ("drone", "phase", "mode", "slot", "up, m", "CO2 over background", "battery", "notes"):
            table.add_column(name, justify="right" if name in ("drone", "slot", "up, m") else "left")
        for drone in self._watch.members:
            state = self._watch.states.get(drone)
            if state is None:
                table.add_row(str(drone), "not heard yet")
                continue
            phase = self.phase(drone, state, now_s)
            excess, up = state.excess_co2_ppm, state.position_ned_m
            table.add_row(
                str(drone),
                Text(phase, style="red" if phase in ("dead", "silent", "pilot", "crashed") else ""),
                state.mode,
                "" if state.slot is None else str(state.slot),
                "" if up is None else f"{0.0 - up[2]:.1f}",
                "" if excess is None else f"{excess.mean:7.1f} ppm",
                "" if state.battery_fraction is None else f"{state.battery_fraction:.0%}",
                "; ".join(state.notes)[:60],
            )
        return table
