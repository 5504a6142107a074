"""How long the swarm took to heal around each loss, and who came back: from what the launcher heard. Pure.

The time from a failure to the heir in its slot in three parts. *Noticed*: somebody tells the others that the drone is
missed. *Agreed*: it is counted out, and all others hold the slots of a whole tree, each by its own word. *Flown*:
nobody who set out since the failure is still on the way to a slot. Losses that overlap share their ends: a tree is
whole for all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import msgspec

from flightstack.swarm.wire import Phase
from mission.geometry.formation import Layout
from mission.tree.balanced_tree import problems
from simvehicle.survey.agent_faults import Freeze
from simvehicle.survey.watch import Log, SlotMark, WatchStanding

Cause = Literal["killed", "frozen", "died", "crashed"]


class Failure(msgspec.Struct, frozen=True):
    """A drone that the swarm loses, `at_s` simulated seconds after the first take-off."""

    drone: int
    cause: Cause
    at_s: float
    until_s: float = math.inf
    """When its agent was woken again."""


class Healing(msgspec.Struct, frozen=True):
    """How the swarm healed around one failure. Simulated seconds, each from the end of the part before it; None: it
    did not come to that before the survey was over or the drone was back."""

    drone: int
    cause: Cause
    at_s: float
    """Since the first take-off."""
    noticed_after_s: float | None = None
    agreed_after_s: float | None = None
    flown_after_s: float | None = None

    @property
    def words(self) -> str:
        parts = [f"drone {self.drone} {self.cause} at {self.at_s:.0f} s"]
        for part, took_s in (
            ("noticed", self.noticed_after_s),
            ("agreed", self.agreed_after_s),
            ("flown", self.flown_after_s),
        ):
            if took_s is None:
                return ", ".join([*parts, f"not {part} before the end"])
            parts.append(f"{part} after {took_s:.1f} s")
        return ", ".join(parts)


class Rejoin(msgspec.Struct, frozen=True):
    """A drone that was counted out and took a slot again. Seconds since the first take-off."""

    drone: int
    slot: int
    woken_at_s: float | None
    """When its agent was let go on; None: it was not frozen on purpose."""
    joined_at_s: float
    """When it held a slot again, by its own word."""
    in_slot_at_s: float | None
    """When it was there; None: the survey was over before."""

    @property
    def words(self) -> str:
        when = f"at {self.joined_at_s:.0f} s"
        if self.woken_at_s is not None:
            when = f"{self.joined_at_s - self.woken_at_s:.1f} s after it was woken"
        there = "not there before the end"
        if self.in_slot_at_s is not None:
            there = f"there {self.in_slot_at_s - self.joined_at_s:.1f} s later"
        return f"drone {self.drone} back in the swarm {when}, in slot {self.slot}, {there}"


def failures(log: Log, kills: Iterable[tuple[int, float]], freezes: Iterable[Freeze]) -> list[Failure]:
    """What the swarm had to heal around, in order: agents killed ((drone, when)) and frozen on purpose, agents that
    died by themselves, vehicles that crashed."""
    killed = dict(kills)
    found = [Failure(drone, "killed", at_s) for drone, at_s in killed.items()]
    found += [
        Failure(f.drone, "frozen", f.at_s, math.inf if f.until_s is None else f.until_s) for f in freezes
    ]
    found += [Failure(drone, "died", at_s) for drone, at_s in log.died.items() if drone not in killed]
    crashed: set[int] = set()
    for mark in log.phases:
        if mark.phase is Phase.CRASHED and mark.drone not in crashed:
            crashed.add(mark.drone)
            found.append(Failure(mark.drone, "crashed", mark.time_s))
    return sorted(found, key=lambda failure: (failure.at_s, failure.drone))


def healings(log: Log, failed: Sequence[Failure], layout: Layout) -> tuple[Healing, ...]:
    """How each of the failures was healed around."""
    return tuple(_healing(log, failure, failed, layout) for failure in failed)


def rejoins(log: Log, freezes: Iterable[Freeze]) -> tuple[Rejoin, ...]:
    """Who was counted out and took a slot again, by the time of it."""
    woken_s = {f.drone: f.until_s for f in freezes if f.until_s is not None}
    # Then everybody is on the way home, and nobody is missed.
    over_s = min((mark.time_s for mark in log.orders if mark.order.stage.ends_survey), default=math.inf)
    found = []
    for drone in {mark.drone for mark in log.standings}:
        own = [mark for mark in log.standings if mark.drone == drone]
        ends_s = [*(mark.time_s for mark in own[1:]), over_s]
        for before, mark, end_s in zip(own, own[1:], ends_s[1:], strict=False):
            if before.standing is WatchStanding.GONE and mark.standing is WatchStanding.THERE:
                rejoin = _rejoin(log, drone, mark.time_s, min(end_s, over_s), woken_s.get(drone, math.inf))
                found += [] if rejoin is None else [rejoin]
    return tuple(sorted(found, key=lambda one: (one.joined_at_s, one.drone)))


def _rejoin(log: Log, drone: int, back_s: float, end_s: float, woken_s: float) -> Rejoin | None:
    """`back_s`: when the drone was counted in again; `end_s`: when that was over, or the whole survey."""
    own = [mark for mark in log.slots if mark.drone == drone and mark.time_s < end_s]
    known = [msgspec.structs.replace(mark, time_s=back_s) for mark in own if mark.time_s < back_s][-1:]
    later = [mark for mark in own if mark.time_s >= back_s]
    # Who was never told that its slot is another's has kept it.
    held = [mark for mark in later or known if mark.slot is not None]
    if back_s >= end_s or not held or held[0].slot is None:
        return None
    joined_s = held[0].time_s
    there_s = next((mark.time_s for mark in held if not mark.moving), None)
    return Rejoin(drone, held[0].slot, woken_s if woken_s <= joined_s else None, joined_s, there_s)


def _healing(log: Log, failure: Failure, failed: Sequence[Failure], layout: Layout) -> Healing:
    unhealed = Healing(failure.drone, failure.cause, failure.at_s)
    standings = [
        mark
        for mark in log.standings
        if mark.drone == failure.drone and failure.at_s <= mark.time_s < failure.until_s
    ]
    noticed_s = next((m.time_s for m in standings if m.standing is not WatchStanding.THERE), None)
    gone_s = next((m.time_s for m in standings if m.standing is WatchStanding.GONE), None)
    if noticed_s is None:
        return unhealed
    noticed = msgspec.structs.replace(unhealed, noticed_after_s=noticed_s - failure.at_s)
    if gone_s is None:
        return noticed
    agreed_s: float | None = None
    for time_s, held in _held_by_others(log, failure, failed, gone_s):
        if problems({drone: slot for drone, (slot, _) in held.items()}, layout) or not held:
            continue
        agreed_s = time_s if agreed_s is None else agreed_s
        if not any(moving for _, moving in held.values()):
            return msgspec.structs.replace(
                noticed, agreed_after_s=agreed_s - noticed_s, flown_after_s=time_s - agreed_s
            )
    if agreed_s is None:
        return noticed
    return msgspec.structs.replace(noticed, agreed_after_s=agreed_s - noticed_s)


def _held_by_others(
    log: Log, failure: Failure, failed: Sequence[Failure], since_s: float
) -> Iterator[tuple[float, dict[int, tuple[int, bool]]]]:
    """At `since_s` and at every change after it: when, and drone -> (its slot, whether it set out for it since the
    failure and is not there yet) of all but the failed."""
    held: dict[int, SlotMark] = {}

    def others(time_s: float) -> dict[int, tuple[int, bool]]:
        out = {f.drone for f in failed if f.at_s <= time_s < f.until_s} | {failure.drone}
        return {
            d: (m.slot, m.moving and m.time_s >= failure.at_s)
            for d, m in held.items()
            if m.slot is not None and d not in out
        }

    marks = sorted(log.slots, key=lambda mark: mark.time_s)
    for mark in marks:
        if mark.time_s <= since_s:
            held[mark.drone] = mark
    yield since_s, others(since_s)
    for index, mark in enumerate(marks):
        if mark.time_s > since_s:
            held[mark.drone] = mark
            if index + 1 == len(marks) or marks[index + 1].time_s > mark.time_s:
                yield mark.time_s, others(mark.time_s)
