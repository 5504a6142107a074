"""How a simulated survey is conducted: when to give which command, and when it is over. No I/O and no clock."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import TypeAlias

import msgspec

from flightstack.swarm.wire import Command, CommandName, Phase, Result, Severity
from mission.strategies.contract import Stage
from simvehicle.survey.agent_faults import Freeze, Kill
from simvehicle.survey.draft import GROUND, VEHICLES, agent_name
from simvehicle.survey.late_starts import REPEAT_WALL_S, START_TRIES, LateStarts
from simvehicle.survey.processes import Ended
from simvehicle.survey.watch import SurveyWatch

START_UP_WALL_S = 120.0
"""How long the processes may take until every agent hears its autopilot: imports take the machine's time."""
ANSWER_WALL_S = 15.0
"""How long a command is repeated before its unanswered drones are given up."""
BAD_INPUT = 2
"""Exit code of every program of ours that cannot use what it was given."""
LANDING_LIMIT_S = 300.0
"""Simulated seconds that everybody has to get home once the survey is over."""
LAND_NOW_LIMIT_S = 120.0
"""The same for landing on the spot."""
ORPHAN_LIMIT_S = 180.0
"""How much longer than the others a vehicle without an agent is waited for."""
DOWN_S = 1.0
"""A vehicle that has been on the ground for this long has landed."""
STANDSTILL_WALL_S = 30.0
"""The vehicles hang when the simulated time has not moved for so long."""
SETTLE_S = 5.0
"""How long after the start the drones' reported phases may still be those from before it."""


class SurveyOutcome(enum.StrEnum):
    SOURCE_FOUND = "source_found"
    GAVE_UP = "gave_up"
    TIME_LIMIT = "time_limit"
    ABORTED = "aborted"
    FAILED = "failed"


class Give(msgspec.Struct, frozen=True):
    """Send a command to the swarm."""

    command: Command


class KillAgent(msgspec.Struct, frozen=True):
    drone: int


class FreezeAgent(msgspec.Struct, frozen=True):
    drone: int


class WakeAgent(msgspec.Struct, frozen=True):
    drone: int


class Finish(msgspec.Struct, frozen=True):
    """The survey is over and all is down, or cannot be waited for any longer."""

    outcome: SurveyOutcome
    reason: str
    bad_input: bool = False
    """A part refused to start with what it was given (a port in use, say): nothing has flown."""


Action: TypeAlias = Give | KillAgent | FreezeAgent | WakeAgent | Finish


class Stand(enum.StrEnum):
    STARTING_UP = "starting up"
    COMMANDING = "start sent"
    FLYING = "flying"
    COMING_HOME = "coming home"


class Supervisor:
    """One survey. `step` is called several times a second and says what to do."""

    def __init__(
        self,
        watch: SurveyWatch,
        *,
        launcher: str,
        survey: str,
        time_limit_s: float,
        kills: Sequence[Kill],
        freezes: Sequence[Freeze] = (),
    ) -> None:
        self.stand = Stand.STARTING_UP
        self.alive = set(watch.members)
        """Drones whose agents run, frozen ones among them."""
        self.frozen: set[int] = set()
        self.kills: dict[int, float] = {}
        """Drone -> when its agent was killed, seconds after the first take-off."""
        self.freezes: list[Freeze] = []
        """Those that happened, when they did, in seconds after the first take-off."""
        self._watch = watch
        self._launcher = launcher
        self._survey = survey
        self._time_limit_s = time_limit_s
        self._to_kill = sorted(kills, key=lambda kill: kill.at_s)
        self._to_freeze = sorted(freezes, key=lambda freeze: freeze.at_s)
        self._to_wake: dict[int, float] = {}
        self._late_starts = LateStarts(watch, lambda drone: self._new_command(CommandName.START, drone))
        self._began_wall_s: float | None = None
        self._command: Command | None = None
        self._command_since_wall_s = 0.0
        self._sent_wall_s = -1e9
        self._tries = 0
        self._retry_wall_s = 0.0
        self._numbers = 0
        self._over: Finish | None = None
        self._home_by_s = 0.0
        self._alive_down_s: float | None = None
        self._flying_since_s = 0.0
        self._moved = (0.0, 0.0)
        """The newest simulated time, and when it was first seen on the wall clock."""

    def step(self, now_s: float, wall_s: float, ended: Sequence[Ended], *, interrupted: bool) -> list[Action]:
        """`now_s`: simulated time; `wall_s`: the machine's; `ended`: processes that died since the last step."""
        if self._began_wall_s is None:
            self._began_wall_s = self._command_since_wall_s = wall_s
        self._deaths(now_s, ended)
        self._standstill(now_s, wall_s)
        if interrupted and self._over is None:
            self._end(now_s, SurveyOutcome.ABORTED, "interrupted", LAND_NOW_LIMIT_S)
            self._order(CommandName.LAND, wall_s)
        match self.stand:
            case Stand.STARTING_UP:
                self._starting_up(wall_s)
            case Stand.COMMANDING:
                self._commanding(now_s, wall_s)
            case Stand.FLYING:
                self._flying(now_s, wall_s)
            case Stand.COMING_HOME:
                pass
        actions: list[Action] = [*self._killing(now_s), *self._freezing(now_s), *self._giving(wall_s)]
        if self.stand is Stand.FLYING:
            actions += [Give(command) for command in self._late_starts.step(now_s, wall_s)]
        if self.stand is Stand.COMING_HOME and self._over is not None and self._all_down(now_s):
            actions.append(self._over)
        return actions

    @property
    def awake(self) -> set[int]:
        """Drones whose agents run and can answer."""
        return self.alive - self.frozen

    # -- the stands -------------------------------------------------------------------------------------------

    def _starting_up(self, wall_s: float) -> None:
        waiting = [d for d in self._watch.members if not self._connected(d)]
        if not waiting and wall_s >= self._retry_wall_s:
            self._tries += 1
            self._order(CommandName.START, wall_s)
            self.stand = Stand.COMMANDING
        elif self._began_wall_s is not None and wall_s - self._began_wall_s > START_UP_WALL_S:
            silent = ", ".join(str(d) for d in waiting)
            self._fail_on_the_ground(
                f"drone {silent} did not report a connected autopilot within {START_UP_WALL_S:.0f} s"
            )

    def _commanding(self, now_s: float, wall_s: float) -> None:
        """All accept the one start command, or it is taken back and tried again: drones that start with different
        commands would take part in different surveys."""
        command = self._command
        if command is None:
            return
        answers = {d: self._watch.outcomes.get((command.identity, d)) for d in self.awake}
        refused = {d: a.reason for d, a in answers.items() if a is not None and a.result is Result.REFUSED}
        missing = [d for d, a in answers.items() if a is None]
        if not refused and not missing:
            self._command = None
            self._flying_since_s = now_s
            self.stand = Stand.FLYING
        elif refused or wall_s - self._command_since_wall_s > ANSWER_WALL_S:
            why = "; ".join(f"drone {d} refused: {reason}" for d, reason in sorted(refused.items()))
            why = why or f"drone {', '.join(map(str, sorted(missing)))} did not answer"
            self._order(CommandName.ABORT, wall_s)
            if self._tries >= START_TRIES or self._watch.first_takeoff_s is not None:
                self._end(
                    now_s, SurveyOutcome.FAILED, f"the survey could not be started: {why}", LANDING_LIMIT_S
                )
            else:
                self._watch.note(now_s, Severity.WARNING, "start", f"start taken back: {why}")
                self._retry_wall_s = wall_s + 3.0
                self.stand = Stand.STARTING_UP

    def _flying(self, now_s: float, wall_s: float) -> None:
        watch = self._watch
        stage = watch.order.stage if watch.order is not None else None
        elapsed_s = watch.since_takeoff_s(now_s)
        if stage is Stage.FOUND:
            self._end(now_s, SurveyOutcome.SOURCE_FOUND, "the swarm found the source", LANDING_LIMIT_S)
        elif stage is Stage.GIVE_UP:
            self._end(
                now_s,
                SurveyOutcome.GAVE_UP,
                "the swarm searched its area without finding a source",
                LANDING_LIMIT_S,
            )
        elif not self.alive:
            self._end(now_s, SurveyOutcome.FAILED, "no agent is left alive", LANDING_LIMIT_S)
        elif elapsed_s is not None and elapsed_s > self._time_limit_s:
            self._end(
                now_s,
                SurveyOutcome.TIME_LIMIT,
                f"not found within {self._time_limit_s:.0f} s",
                LANDING_LIMIT_S,
            )
            self._order(CommandName.ABORT, wall_s)
        elif (
            self.awake
            and now_s - self._flying_since_s > SETTLE_S
            and all(
                watch.states[d].phase in (Phase.LANDED, Phase.CRASHED, Phase.DISARMED) for d in self.awake
            )
        ):
            texts = "; ".join(f"drone {e.drone}: {e.text}" for e in watch.log().events if e.code == "arming")
            self._end(
                now_s,
                SurveyOutcome.FAILED,
                "all drones are down without a result" + (f": {texts}" if texts else ""),
                30.0,
            )

    def _end(self, now_s: float, outcome: SurveyOutcome, reason: str, limit_s: float) -> None:
        self._over = Finish(outcome, reason)
        self._home_by_s = now_s + limit_s
        self.stand = Stand.COMING_HOME

    def _fail_on_the_ground(self, reason: str, *, bad_input: bool = False) -> None:
        self._end(-1e9, SurveyOutcome.FAILED, reason, 0.0)
        self._over = Finish(SurveyOutcome.FAILED, reason, bad_input)

    # -- what happens on the way --------------------------------------------------------------------------------

    def _deaths(self, now_s: float, ended: Sequence[Ended]) -> None:
        for one in ended:
            self._watch.note(now_s, Severity.CRITICAL, "process", str(one))
            drone = next((d for d in self._watch.members if agent_name(d) == one.name), None)
            if drone is not None:
                self._gone(drone)
                self._watch.died(now_s, drone)
            on_the_ground = self._watch.first_takeoff_s is None
            starting = on_the_ground and self.stand in (Stand.STARTING_UP, Stand.COMMANDING)
            if one.name == VEHICLES or starting:
                self._fail_on_the_ground(str(one), bad_input=on_the_ground and one.code == BAD_INPUT)
            elif one.name == GROUND and self.stand is not Stand.COMING_HOME:
                self._watch.note(now_s, Severity.WARNING, "process", "going on without the ground station")

    def _standstill(self, now_s: float, wall_s: float) -> None:
        if now_s != self._moved[0]:
            self._moved = (now_s, wall_s)
        elif now_s > 0.0 and wall_s - self._moved[1] > STANDSTILL_WALL_S:
            self._fail_on_the_ground("the simulated time stands still: the vehicles' process hangs")

    def _killing(self, now_s: float) -> list[KillAgent]:
        elapsed_s = self._watch.since_takeoff_s(now_s)
        due = [k for k in self._to_kill if elapsed_s is not None and elapsed_s >= k.at_s]
        for kill in due:
            self._to_kill.remove(kill)
            if kill.drone in self.alive and elapsed_s is not None:
                self._gone(kill.drone)
                self.kills[kill.drone] = elapsed_s
                self._watch.note(
                    now_s, Severity.WARNING, "kill", "agent killed on purpose (kill -9)", kill.drone
                )
        return [KillAgent(k.drone) for k in due if k.drone in self.kills]

    def _freezing(self, now_s: float) -> list[FreezeAgent | WakeAgent]:
        elapsed_s = self._watch.since_takeoff_s(now_s)
        if elapsed_s is None:
            return []
        actions: list[FreezeAgent | WakeAgent] = []
        for drone in [d for d, until_s in self._to_wake.items() if elapsed_s >= until_s]:
            del self._to_wake[drone]
            self.frozen.discard(drone)
            (index,) = (i for i, f in enumerate(self.freezes) if f.drone == drone and f.until_s is None)
            began_s = self.freezes[index].at_s
            self.freezes[index] = Freeze(drone, began_s, elapsed_s)
            self._watch.woke(drone, elapsed_s - began_s)
            self._late_starts.woken(now_s, drone)
            self._watch.note(now_s, Severity.INFO, "freeze", "agent goes on (SIGCONT)", drone)
            actions.append(WakeAgent(drone))
        for freeze in [f for f in self._to_freeze if elapsed_s >= f.at_s and f.drone not in self.frozen]:
            self._to_freeze.remove(freeze)
            if freeze.drone not in self.alive:
                continue
            self.frozen.add(freeze.drone)
            self.freezes.append(Freeze(freeze.drone, elapsed_s))
            if freeze.until_s is not None:
                self._to_wake[freeze.drone] = freeze.until_s
            self._watch.note(
                now_s, Severity.WARNING, "freeze", "agent frozen on purpose (SIGSTOP)", freeze.drone
            )
            actions.append(FreezeAgent(freeze.drone))
        return actions

    def _gone(self, drone: int) -> None:
        """Its agent runs no more; what was frozen stays in `freezes` without an end."""
        self.alive.discard(drone)
        self.frozen.discard(drone)
        self._to_wake.pop(drone, None)
        self._late_starts.gone(drone)

    def _order(self, name: CommandName, wall_s: float) -> None:
        self._command = self._new_command(name)
        self._command_since_wall_s = wall_s
        self._sent_wall_s = -1e9

    def _new_command(self, name: CommandName, target: int = 0) -> Command:
        self._numbers += 1
        return Command(f"{self._survey}-{name}-{self._numbers}", self._launcher, target, name)

    def _giving(self, wall_s: float) -> list[Give]:
        """The pending command, repeated until every drone that can has answered or there is no hope of it."""
        command = self._command
        if command is None or wall_s - self._sent_wall_s < REPEAT_WALL_S:
            return []
        unanswered = [d for d in self.awake if (command.identity, d) not in self._watch.outcomes]
        if self.stand is not Stand.COMMANDING and (
            not unanswered or wall_s - self._command_since_wall_s > ANSWER_WALL_S
        ):
            self._command = None
            return []
        self._sent_wall_s = wall_s
        return [Give(command)]

    def _connected(self, drone: int) -> bool:
        state = self._watch.states.get(drone)
        return state is not None and bool(state.mode)

    def _all_down(self, now_s: float) -> bool:
        """Whether everything is on the ground, or has had its time."""
        if now_s > self._home_by_s + ORPHAN_LIMIT_S:
            return True
        down = {d for d, since_s in self._watch.down_since_s.items() if now_s - since_s >= DOWN_S}
        if not self._watch.down_since_s and self._watch.first_takeoff_s is None:
            return True  # nothing ever flew, and the world has not even said where the vehicles stand
        orphans = set(self._watch.members) - self.awake
        if not self.awake <= down:
            self._alive_down_s = None
            return now_s > self._home_by_s
        if self._alive_down_s is None:
            self._alive_down_s = now_s
        return orphans <= down or now_s - self._alive_down_s > ORPHAN_LIMIT_S
