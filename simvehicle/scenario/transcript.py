"""What happened in a scenario, as lines that a person reads and reviews: when, who, what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from flightstack.swarm.wire import Phase
from simvehicle.faults.fault_table import FaultSpec, SwarmFaultSpec
from simvehicle.scenario.table_invariants import words

TOLD: Final = frozenset(
    {
        "lost",
        "joined",
        "found",
        "crash",
        "failsafe",
        "pilot",
        "blocked",
        "down",
        "leaving",
        "stood_still",
        "overdue",
    }
)
"""Codes of the events that stand in it; what else is told repeats phases or tables."""


class Transcript:
    """Gathers lines. Times are whole seconds after the first take-off; what happens in one second to many is one
    line."""

    def __init__(self) -> None:
        self._second = 0
        self._waiting: dict[str, list[int]] = {}
        self._lines: list[str] = []
        self._phases: dict[int, Phase] = {}
        self._tables: set[str] = set()

    @property
    def lines(self) -> tuple[str, ...]:
        self._flush()
        return tuple(self._lines)

    def at(self, since_takeoff_s: float) -> None:
        """What is told from now on happened then."""
        second = int(since_takeoff_s // 1)
        if second != self._second:
            self._flush()
            self._second = second

    def phase(self, drone: int, phase: Phase) -> None:
        if self._phases.get(drone) is not phase:
            self._phases[drone] = phase
            self._say(phase.value, drone)

    def table(self, drone: int, epoch: int, slots: Mapping[int, int]) -> None:
        """Told once, by whoever has it first."""
        if slots and (told := f"table {epoch}: {words(slots)}") not in self._tables:
            self._tables.add(told)
            self._say(told, drone)

    def event(self, drone: int, code: str, text: str) -> None:
        if code in TOLD:
            self._say(f"{code}: {text}", drone)

    def fault(self, begins: bool, fault: FaultSpec | SwarmFaultSpec) -> None:
        self._say(f"{'' if begins else 'end of '}fault {fault_words(fault)}", fault.drone)

    def sent_home(self, drone: int) -> None:
        self._say("sent home by the ground station", drone)

    def left_up(self, drone: int, reason: str) -> None:
        self._say(f"still in the air: {reason}", drone)

    def say(self, text: str) -> None:
        self._say(text, 0)

    def _say(self, text: str, drone: int) -> None:
        self._waiting.setdefault(text, []).append(drone)

    def _flush(self) -> None:
        for text, drones in self._waiting.items():
            self._lines.append(f"{self._second:4d} s  {_names(drones):<10}  {text}")
        self._waiting.clear()


def fault_words(fault: FaultSpec | SwarmFaultSpec) -> str:
    """Its kind with what else says which one: "partition 1 2 | 3 4"."""
    if isinstance(fault, FaultSpec):
        by = {"lying": f"{fault.by_ppm:+g} ppm", "gps_jump": f"{fault.by_m:+g} m north"}.get(fault.kind)
        return " ".join(filter(None, (fault.kind, fault.instrument or fault.unheard, by)))
    details = (
        fault.command or "",
        " | ".join(" ".join(map(str, part)) for part in fault.parts),
        f"unheard by {fault.towards}" if fault.towards else "",
        f"{fault.loss:.0%}" if fault.loss else "",
        f"{fault.by_s:g} s" if fault.by_s else "",
    )
    return " ".join(filter(None, (fault.kind, *details)))


def _names(drones: Iterable[int]) -> str:
    return " ".join(str(drone) for drone in sorted(set(drones)) if drone) or "-"
