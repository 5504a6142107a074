"""What happened once and that a person should read afterwards: notes, which leave the drone as events."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from flightstack.mavlink.statustext import StatusText
from flightstack.swarm.wire import Severity
from mission.strategies.contract import Order, Stage


class Note(msgspec.Struct, frozen=True):
    severity: Severity
    code: str
    """A short stable word: "heal", "contact", "found", "fence", "pilot", "statustext"."""
    text: str


class TreeNews(msgspec.Struct, frozen=True):
    """What changed in the swarm's tree in one tick."""

    lost: tuple[int, ...] = ()
    healed: bool = False
    moved: bool = False
    """This drone holds another slot than before and has to fly there."""
    order: Order | None = None
    """The order, if it is a new one."""
    joined: bool = False
    """This drone left the survey that it had begun for the one that the others fly."""


REPEATED_S = 300.0
"""Autopilots say again every half minute what keeps them on the ground: that is told so seldom."""
_REPEATS = ("PreArm: ", "Arm: ", "Preflight Fail: ", "Arming denied")
"""How texts begin of which a repetition is no news."""


class TextNotes:
    """An autopilot's status texts as notes: each once, also where the autopilot repeats it."""

    def __init__(self) -> None:
        self._told_s: dict[str, float] = {}

    def notes(self, now_s: float, texts: Iterable[StatusText]) -> list[Note]:
        return [
            Note(_severity(text.severity), "statustext", text.text)
            for text in texts
            if not self._is_repetition(now_s, text.text)
        ]

    def _is_repetition(self, now_s: float, text: str) -> bool:
        if not text.startswith(_REPEATS):
            return False
        self._told_s = {told: at_s for told, at_s in self._told_s.items() if now_s - at_s < REPEATED_S}
        repeated = text in self._told_s
        self._told_s.setdefault(text, now_s)
        return repeated


def _severity(mavlink_severity: int) -> Severity:
    """MAV_SEVERITY (0 emergency … 7 debug) as ours."""
    if mavlink_severity <= 2:
        return Severity.CRITICAL
    return Severity.WARNING if mavlink_severity <= 4 else Severity.INFO


def tree_notes(news: TreeNews, slots: Mapping[int, int]) -> list[Note]:
    """The changes of one tick in words; `slots` (drone -> slot) are the newest."""
    notes = []
    if news.joined:
        notes.append(Note(Severity.INFO, "joined", "takes part in the survey that the others fly"))
    if news.lost:
        names = ", ".join(str(drone) for drone in news.lost)
        notes.append(Note(Severity.WARNING, "lost", f"drone {names} lost to the swarm"))
    if news.healed:
        text = ", ".join(f"{drone} in {slot}" for drone, slot in sorted(slots.items(), key=lambda i: i[1]))
        notes.append(Note(Severity.INFO, "heal", f"slots: {text}"))
    if news.order is not None and news.order.stage is Stage.FOUND and news.order.source_ned_m:
        n, e, d = news.order.source_ned_m
        text = f"source at {n:.1f} m north, {e:.1f} m east, {-d:.1f} m up"
        if news.order.source_sd_m is not None:
            text += f", known to {news.order.source_sd_m:.1f} m (standard deviation)"
        notes.append(Note(Severity.INFO, "found", text))
    return notes
