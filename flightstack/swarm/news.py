"""What happened once and that a person should read afterwards: notes, which leave the drone as events."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

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


def tree_notes(news: TreeNews, epoch: int, slots: Mapping[int, int]) -> list[Note]:
    """The changes of one tick in words; `slots` (drone -> slot) are those of `epoch`, the newest."""
    notes = []
    if news.joined:
        notes.append(Note(Severity.INFO, "joined", "takes part in the survey that the others fly"))
    if news.lost:
        names = ", ".join(str(drone) for drone in news.lost)
        notes.append(Note(Severity.WARNING, "lost", f"drone {names} lost to the swarm"))
    if news.healed:
        text = ", ".join(f"{drone} in {slot}" for drone, slot in sorted(slots.items(), key=lambda i: i[1]))
        notes.append(Note(Severity.INFO, "heal", f"epoch {epoch}: {text}"))
    if news.order is not None and news.order.stage is Stage.FOUND and news.order.source_ned_m:
        n, e, d = news.order.source_ned_m
        text = f"source at {n:.1f} m north, {e:.1f} m east, {-d:.1f} m up"
        notes.append(Note(Severity.INFO, "found", text))
    return notes
