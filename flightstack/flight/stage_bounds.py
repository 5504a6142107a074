"""How long each stage of a survey may last, and what ends it: nothing in flight goes on for ever.

The phases of one drone end for that drone: it goes home, or lands where it is. What the swarm does together ends for
all together: the root orders it to give up. Only where that order does not come, from a root that cannot give it,
a drone leaves alone.

Time is counted in ticks, none longer than a second: a clock that jumps, or an agent that stood still, does not end a
survey. A drone that becomes the root has counted for itself meanwhile.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from flightstack.config import LimitsConfig, StagesConfig
from flightstack.flight.transitions import IN_FORMATION, WAYS_DOWN
from flightstack.swarm.news import Note
from flightstack.swarm.wire import Phase, Severity
from mission.geometry.geofence import LocalFence
from mission.strategies.contract import Decision, Order, Stage

ROOT_LATE_S: Final = 120.0
"""How long the root may be late with its order to give up before each goes home alone: it may be on its way to a slot
(60 s), or be lost at that moment, and then the next one's turn comes."""

LONGEST_TICK_S: Final = 1.0

_RETURN_SPARE_S: Final = 300.0
_RETURN_WAYS: Final = 3.0
_RETURN_WITHOUT_FENCE_S: Final = 900.0


class StageEnd(msgspec.Struct, frozen=True):
    """What has come to its end, each in words for an operator, empty while nothing has."""

    leaves: str = ""
    """Why this drone goes home."""
    lands: str = ""
    """Why it lands where it is."""
    gives_up: str = ""
    """Why the root shall give up, for the whole swarm."""
    alarm: str = ""
    """Why somebody has to look at the vehicle: there is nothing more that its agent could do."""


_NOTHING = StageEnd()


class StageBounds:
    """One drone's count. `begin` when a survey starts, `step` once a tick."""

    def __init__(self, limits: LimitsConfig, fence: LocalFence | None) -> None:
        self._stages = limits.stages
        self._returning_s = returning_bound_s(limits, fence)
        self._last_s: float | None = None
        self._phase: Phase | None = None
        self._in_phase_s = 0.0
        self._in_stage_s: dict[Stage, float] = {}
        """How long this drone has flown in formation, by what the swarm was doing."""
        self._end = StageEnd()
        self._told = ""

    def begin(self) -> None:
        self._in_stage_s.clear()

    def step(self, now_s: float, phase: Phase, order: Order | None) -> StageEnd:
        """`phase` and `order` as they are now."""
        self._end = self._step(now_s, phase, order)
        return self._end

    def notes(self, *, root: bool) -> tuple[Note, ...]:
        """What of the newest step no change of phase tells, each once. `root`: whether this drone is the root."""
        text = self._end.alarm or (f"{self._end.gives_up}: giving up" if self._end.gives_up and root else "")
        before, self._told = self._told, text
        if not text or text == before:
            return ()
        return (Note(Severity.CRITICAL if self._end.alarm else Severity.WARNING, "overdue", text),)

    def _step(self, now_s: float, phase: Phase, order: Order | None) -> StageEnd:
        tick_s = min(now_s - self._last_s, LONGEST_TICK_S) if self._last_s is not None else 0.0
        self._last_s = now_s
        if phase is not self._phase:
            self._phase, self._in_phase_s = phase, 0.0
        self._in_phase_s += tick_s
        if phase in IN_FORMATION:
            return self._in_formation(tick_s, order.stage if order is not None else Stage.FORM)
        return self._by_itself(phase)

    def _in_formation(self, tick_s: float, stage: Stage) -> StageEnd:
        if stage.ends_survey:
            return _NOTHING
        spent_s = self._in_stage_s.get(stage, 0.0) + tick_s
        self._in_stage_s[stage] = spent_s
        what, name, bound_s = _swarms(self._stages)[stage]
        if spent_s <= bound_s:
            return _NOTHING
        why = _overdue(what, name, bound_s)
        late = spent_s > bound_s + ROOT_LATE_S
        return StageEnd(gives_up=why, leaves=f"{why}, and no root has ended it" if late else "")

    def _by_itself(self, phase: Phase) -> StageEnd:
        stages, spent_s = self._stages, self._in_phase_s
        if phase is Phase.FORMING and spent_s > stages.forming_s:
            return StageEnd(leaves=_overdue("the way to its slot", "forming_s", stages.forming_s))
        if phase is Phase.HOLDING and spent_s > stages.holding_s:
            return StageEnd(leaves=_overdue("the pause", "holding_s", stages.holding_s))
        if phase is Phase.RETURNING and spent_s > self._returning_s:
            why = _overdue("the way home", "returning_s", self._returning_s)
            return StageEnd(lands=f"{why}: landing here")
        bound_s = stages.landing_s + (self._returning_s if phase is Phase.RTL else 0.0)
        if phase in WAYS_DOWN and spent_s > bound_s:
            what = "the autopilot's way home and landing" if phase is Phase.RTL else "the landing"
            return StageEnd(
                alarm=f"{what} has taken more than {bound_s:.0f} s: look at it, bring it down by hand"
            )
        return _NOTHING


def returning_bound_s(limits: LimitsConfig, fence: LocalFence | None) -> float:
    """How long a way home may take: as configured, or as the size of the area asks for."""
    if limits.stages.returning_s is not None:
        return limits.stages.returning_s
    farthest_m = fence.farthest_m() if fence is not None else math.inf
    if math.isinf(farthest_m):
        return _RETURN_WITHOUT_FENCE_S
    return _RETURN_SPARE_S + _RETURN_WAYS * farthest_m / limits.speed_mps


def ended(decision: Decision, order: Order | None, why: str) -> Decision:
    """The root's `decision`, that of giving up where `why` says so and it ends nothing by itself."""
    if not why or order is None or order.stage.ends_survey:
        return decision
    if decision.order is not None and decision.order.stage.ends_survey:
        return decision
    sequence = max(order.sequence, decision.order.sequence - 1 if decision.order is not None else 0) + 1
    give_up = msgspec.structs.replace(order, sequence=sequence, stage=Stage.GIVE_UP)
    return msgspec.structs.replace(decision, order=give_up)


def _swarms(stages: StagesConfig) -> dict[Stage, tuple[str, str, float]]:
    return {
        Stage.FORM: ("forming up", "forming_s", stages.forming_s),
        Stage.SEARCH: ("the search for contact", "searching_s", stages.searching_s),
        Stage.TRACK: ("following the plume", "tracking_s", stages.tracking_s),
    }


def _overdue(what: str, name: str, bound_s: float) -> str:
    return f"{what} has taken more than {bound_s:.0f} s (limits.stages.{name})"
