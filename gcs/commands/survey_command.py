"""One command to the swarm and its answers: repeated until everybody has answered or the time is up.

Pure: the shell publishes when `due` says so and hands over what comes in.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable

import msgspec

from flightstack.swarm.wire import Command, CommandName, CommandOutcome, Result

REPEAT_S = 0.5
FINDING_S = 2.0
"""How long to wait for drones that have not been heard: the network needs this long to find everybody."""


class DroneAnswer(msgspec.Struct, frozen=True):
    """What one drone made of the command."""

    drone: int
    result: str
    """"accepted", "refused", "no answer" (it is alive) or "not heard" (it is not)."""
    reason: str = ""


class SurveyCommand:
    """The life of one command. Times are any clock's seconds."""

    def __init__(
        self,
        name: CommandName,
        *,
        sender: str,
        target: int,
        members: Iterable[int],
        started_s: float,
        deadline_s: float,
        without_recording: bool = False,
        incarnation: int = 0,
    ) -> None:
        self.command = Command(uuid.uuid4().hex, sender, target, name, without_recording, incarnation)
        self._members = tuple(members)
        """Everybody who is to answer; empty: whoever is heard."""
        self._started_s = started_s
        self._deadline_s = deadline_s
        self._sent_s: float | None = None
        self._heard: set[int] = set()
        self._outcomes: dict[int, CommandOutcome] = {}

    def heard(self, drone: int) -> None:
        """A sign of life of a drone: its agent's, or its autopilot's through the running ground station."""
        self._heard.add(drone)

    def answered(self, outcome: CommandOutcome) -> None:
        """Take an outcome from the air; answers to other commands are ignored."""
        if outcome.command == self.command.identity:
            # A drone's acceptance stands: the ground station, answering for one that it took as silent, may
            # be late with a refusal.
            before = self._outcomes.get(outcome.sender)
            if before is None or before.result is not Result.ACCEPTED:
                self._outcomes[outcome.sender] = outcome

    def due(self, now_s: float) -> bool:
        """Whether to publish the command now."""
        if self._sent_s is not None and now_s - self._sent_s < REPEAT_S:
            return False
        self._sent_s = now_s
        # The same command with a number of its own: what is heard twice under one number was recorded.
        self.command = msgspec.structs.replace(self.command, sequence=self.command.sequence + 1)
        return True

    def addressed(self) -> list[int]:
        if self.command.target:
            return [self.command.target]
        return [*self._members, *sorted((self._heard | set(self._outcomes)) - set(self._members))]

    def done(self, now_s: float) -> bool:
        elapsed_s = now_s - self._started_s
        if elapsed_s >= self._deadline_s:
            return True
        waiting = [drone for drone in self.addressed() if drone not in self._outcomes]
        if elapsed_s < FINDING_S:
            # Without a list of members somebody may still be found.
            return not waiting and bool(self._outcomes) and bool(self._members or self.command.target)
        return not any(drone in self._heard for drone in waiting)

    def answers(self) -> list[DroneAnswer]:
        return [self._answer(drone) for drone in self.addressed()]

    def _answer(self, drone: int) -> DroneAnswer:
        outcome = self._outcomes.get(drone)
        if outcome is not None:
            return DroneAnswer(drone, str(outcome.result), outcome.reason)
        if drone in self._heard:
            return DroneAnswer(drone, "no answer", "it is alive, but did not answer in time")
        return DroneAnswer(drone, "not heard", "no sign of it or its vehicle")

    def accepted(self) -> bool:
        """Whether everybody addressed has accepted, and there was somebody."""
        answers = self.answers()
        return bool(answers) and all(answer.result == "accepted" for answer in answers)
