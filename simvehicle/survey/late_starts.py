"""Starting drones again that stand on the ground while their survey goes on, as their operator would. Pure.

The ground station brings a vehicle home whose agent stands still for long. When the agent wakes, it takes part again
only if somebody starts it: it then joins, in the air, the survey that the others fly.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from flightstack.swarm.wire import Command, Phase, Result, Severity
from simvehicle.survey.watch import SurveyWatch

REPEAT_WALL_S = 0.5
START_TRIES = 3
RETRY_S = 5.0
"""Simulated seconds from a refused start to the next."""
ON_THE_GROUND = frozenset({Phase.LANDED, Phase.DISARMED})


class _LateStart(msgspec.Struct):
    """One drone's way back."""

    not_before_s: float
    command: Command | None = None
    sent_wall_s: float = -1e9
    tries: int = 0


class LateStarts:
    def __init__(self, watch: SurveyWatch, new_start: Callable[[int], Command]) -> None:
        """`new_start` makes a start command of its own for a drone."""
        self._watch = watch
        self._new_start = new_start
        self._waiting: dict[int, _LateStart] = {}

    def woken(self, now_s: float, drone: int) -> None:
        """The drone's agent runs again; where its vehicle is will be heard."""
        self._waiting[drone] = _LateStart(now_s)

    def gone(self, drone: int) -> None:
        """The drone's agent runs no more."""
        self._waiting.pop(drone, None)

    def step(self, now_s: float, wall_s: float) -> list[Command]:
        """What to send now, while the survey goes on: each start until it is answered."""
        commands = []
        for drone, late in list(self._waiting.items()):
            if late.command is None:
                self._begin(now_s, drone, late)
            else:
                self._read_answer(now_s, drone, late)
            if late.command is not None and wall_s - late.sent_wall_s >= REPEAT_WALL_S:
                late.sent_wall_s = wall_s
                commands.append(late.command)
        return commands

    def _begin(self, now_s: float, drone: int, late: _LateStart) -> None:
        state = self._watch.states.get(drone)
        if state is None or now_s < late.not_before_s or state.phase not in ON_THE_GROUND:
            return
        if late.tries == START_TRIES:
            del self._waiting[drone]
            return
        late.tries += 1
        late.command = self._new_start(drone)
        self._watch.note(now_s, Severity.INFO, "start", "started again: it stands on the ground", drone)

    def _read_answer(self, now_s: float, drone: int, late: _LateStart) -> None:
        answer = (
            self._watch.outcomes.get((late.command.identity, drone)) if late.command is not None else None
        )
        if answer is None:
            return
        late.command = None
        if answer.result is Result.ACCEPTED:
            del self._waiting[drone]
            return
        self._watch.note(now_s, Severity.WARNING, "start", f"start refused: {answer.reason}", drone)
        late.not_before_s = now_s + RETRY_S
