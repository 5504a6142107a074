"""The flight phase of one drone: what commands, vehicle and swarm make of it, by the table of transitions.

The phase decides who steers (our setpoints, the autopilot by itself, a person) and what is asked of the
autopilot. Ground commands enter here and nowhere else. When the pilot or a failsafe of the autopilot takes the
mode away, our authority ends in the same tick and comes back by a command only. A failsafe that brings the vehicle
down is followed: the phase is then what the vehicle does (`rtl`, `landing`), until it is down or a person takes it.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence

import msgspec

from flightstack.flight.facts import SwarmFacts, VehicleFacts
from flightstack.flight.taking_part import TakingPart, Turn
from flightstack.flight.transitions import (
    HANDS_OVER,
    IN_THE_AIR,
    STEERING,
    TRANSITIONS,
    FlightEvent,
    following,
)
from flightstack.swarm.news import Note
from flightstack.swarm.wire import TAKING_PART, Command, CommandName, CommandOutcome, Phase, Result, Severity

DOWN_S = 3.0
"""How long a vehicle in formation may seem disarmed before it counts as down: heartbeats come once a second."""

NAMED_WITHIN_S = 2.0
"""How long after a change of mode the autopilot's text is waited for that says which failsafe it was."""

TAKES_CONTROL = frozenset(
    {FlightEvent.START, FlightEvent.ARMED, FlightEvent.AT_ALTITUDE, FlightEvent.RESUME, FlightEvent.ABORT}
)
"""The events after which our mode is asked for: until it has come, it is not lost."""

_IN_THE_SWARM = HANDS_OVER | {Phase.FORMING, Phase.LEAVING}
"""The phases in which what the swarm does decides about this drone."""

DOWNWARDS = frozenset({CommandName.ABORT, CommandName.RTL, CommandName.LAND})
"""The commands that bring a drone to the ground."""

WHY = {
    CommandName.START: "survey started",
    CommandName.PAUSE: "paused by command",
    CommandName.RESUME: "resumed by command",
    CommandName.ABORT: "survey aborted by command",
    CommandName.RTL: "by command; the autopilot returns and lands by itself",
    CommandName.LAND: "by command, where it is",
}


class Ask(enum.Enum):
    """What the phase asks of the autopilot session. Repeating an ask is harmless."""

    TAKE_CONTROL = "take_control"
    ARM = "arm"
    """Set parameters, wait until ready, take the mode, start the motors."""
    TAKE_OFF = "take_off"
    LAND = "land"
    RETURN = "return"
    DISARM = "disarm"


DESCENTS = {Phase.LANDING: Ask.LAND, Phase.RTL: Ask.RETURN, Phase.CRASHED: Ask.LAND}
"""How the autopilot is asked to bring the drone down. A wreck's motors stop when the autopilot takes it for landed,
which may be long after; and what was no wreck lands."""


class PhaseStep(msgspec.Struct, frozen=True):
    phase: Phase
    asks: tuple[Ask, ...]
    outcomes: tuple[CommandOutcome, ...]
    notes: tuple[Note, ...]
    started: str | None
    """Identity of the command that started a survey in this tick."""
    steering: bool


class FlightPhase:
    """The phase of one drone. `step` is called once a tick; everything it knows comes as arguments."""

    def __init__(self, drone: int, *, control_timeout_s: float = 10.0) -> None:
        self.phase = Phase.DISARMED
        self._drone = drone
        self._control_timeout_s = control_timeout_s
        self._control_since_s: float | None = None
        """When we last asked for control; None once we had it. Losing it then means that somebody took it."""
        self._taken_before = ""
        """How authority had been lost when we asked; a text may add to it later."""
        self._down_since_s: float | None = None
        self._part = TakingPart()
        self._had_crashed_with_pilot = False
        self._wreck_was_disarmed = False
        self._answered: dict[str, CommandOutcome] = {}
        self._notes: list[Note] = []
        self._outcomes: list[CommandOutcome] = []
        self._started: str | None = None
        self._storage = ""
        self._prompt: Ask | None = None
        self._follows_failsafe = False
        """The vehicle comes down because its autopilot chose to, not because anybody asked it to."""
        self._taken_s: float | None = None
        """When the mode was taken, while it has not been told by whom."""

    def step(
        self,
        now_s: float,
        commands: Sequence[Command],
        vehicle: VehicleFacts,
        swarm: SwarmFacts,
        *,
        storage: str = "",
    ) -> PhaseStep:
        """One tick. `storage`: why the flight is not recorded, if it is not. An `IllegalTransitionError` leaves the
        phase as it was, and the commands answered: then `stay` is the step that remains."""
        self._storage = storage
        self._notes, self._outcomes = [], []
        self._prompt = self._started = None
        for command in commands:
            if command.target in (0, self._drone):
                self._answer(now_s, command, vehicle, swarm)
        self._advance(now_s, vehicle, swarm)
        if vehicle.ours:
            self._control_since_s = None  # there is nothing to wait for: whoever takes it now wants it
        return self.stay(vehicle)

    def stay(self, vehicle: VehicleFacts) -> PhaseStep:
        """The step of this tick as it is now."""
        return PhaseStep(
            self.phase,
            self._asks(vehicle),
            tuple(self._outcomes),
            tuple(self._notes),
            self._started,
            self.phase in STEERING,
        )

    # -- commands ---------------------------------------------------------------------------------------------

    def _answer(self, now_s: float, command: Command, vehicle: VehicleFacts, swarm: SwarmFacts) -> None:
        """Carry a command out, or say why not; one that was answered before is answered again and no more."""
        outcome = self._answered.get(command.identity)
        if outcome is None:
            before = self.phase
            obeyed = self._obeyed_already(command.name, vehicle)
            reason = "" if obeyed else self._refusal(command, vehicle, swarm)
            if not reason and not obeyed:
                self._obey(now_s, command, vehicle)
            result = Result.REFUSED if reason else Result.ACCEPTED
            reason = reason or obeyed
            outcome = CommandOutcome(command.identity, self._drone, result, reason)
            self._remember(outcome)
            self._note(
                Severity.WARNING if result is Result.REFUSED else Severity.INFO,
                "command",
                f"{command.name} from {command.sender}: {outcome.result}" + (f": {reason}" if reason else ""),
            )
            begins = command.name is CommandName.START or before is Phase.DISARMED
            if begins and self.phase in TAKING_PART and self.phase is not before:
                self._started = command.identity
        self._outcomes.append(outcome)

    def _obeyed_already(self, name: CommandName, vehicle: VehicleFacts) -> str:
        """Why nothing is left to do for what brings a drone down; empty where it is not known to be down."""
        if name not in DOWNWARDS or self.phase is Phase.ARMING or not vehicle.connected:
            return ""
        if vehicle.crash:
            return "it has crashed"
        return "" if vehicle.airborne or vehicle.armed else "it is on the ground"

    def _refusal(self, command: Command, vehicle: VehicleFacts, swarm: SwarmFacts) -> str:
        """Why a command cannot be carried out, or nothing."""
        name = command.name
        to = TRANSITIONS.get((self.phase, FlightEvent(name)))
        match name:
            case CommandName.START:
                reason = self._why_not_start(to, vehicle, swarm)
                unrecorded = "" if command.without_recording or to is self.phase else self._storage
                return reason or (unrecorded and f"{unrecorded}; mend it, or start with --without-recording")
            case CommandName.RESUME:
                if to is self.phase:
                    return ""
                if to is None or not vehicle.airborne:
                    return f"nothing to resume: the drone is {self.phase}"
                if self.phase is Phase.DISARMED:
                    return self._why_not_join(swarm)
            case CommandName.ABORT | CommandName.RTL | CommandName.LAND:
                if self.phase is not Phase.ARMING and not vehicle.airborne and not vehicle.armed:
                    return "the autopilot does not answer: check its link and power"
        return f"the drone is {self.phase}" if to is None else ""

    def _why_not_start(self, to: Phase | None, vehicle: VehicleFacts, swarm: SwarmFacts) -> str:
        if not vehicle.connected:
            return "the autopilot does not answer: check its link and power"
        if to is self.phase:
            return ""
        if to is None:
            return f"already {self.phase}"
        if vehicle.armed:
            resume = ", or resume it" if self.phase is Phase.DISARMED and vehicle.airborne else ""
            return f"the vehicle is armed in {vehicle.mode}: disarm it first{resume}"
        if vehicle.crash:
            return f"it has crashed ({vehicle.crash}): look at it, then restart its autopilot"
        if swarm.has_twin:
            return self._twin_words()
        return swarm.must_return

    def _why_not_join(self, swarm: SwarmFacts) -> str:
        """Why an agent that was restarted in the air does not join what the others fly."""
        if swarm.has_twin:
            return self._twin_words()
        nobody = "" if swarm.flies_on else "no survey that it could join is heard: use abort, rtl or land"
        return nobody or swarm.must_return

    def _twin_words(self) -> str:
        return f"another agent says that it is drone {self._drone} too: stop one of them"

    def _obey(self, now_s: float, command: Command, vehicle: VehicleFacts) -> None:
        name = command.name
        event, why = FlightEvent(name), WHY[name]
        self._taken_before = vehicle.taken_reason
        self._part.obey()
        if name in DOWNWARDS:
            if self.phase is Phase.ARMING:
                self._prompt = Ask.DISARM if vehicle.armed else None
                why = f"start cancelled: {name} by command"
            elif name is not CommandName.ABORT:
                self._prompt = Ask.RETURN if name is CommandName.RTL else Ask.LAND
            elif command.target == self._drone and self.phase in HANDS_OVER:
                event, why = FlightEvent.LEAVE, "by command: the others go on"
        self._happen(now_s, event, why)

    def _remember(self, outcome: CommandOutcome) -> None:
        self._answered[outcome.command] = outcome
        while len(self._answered) > 64:
            del self._answered[next(iter(self._answered))]

    # -- events -----------------------------------------------------------------------------------------------

    def _advance(self, now_s: float, vehicle: VehicleFacts, swarm: SwarmFacts) -> None:
        if vehicle.crash and self.phase in IN_THE_AIR | {Phase.LANDED}:
            self._had_crashed_with_pilot, self._wreck_was_disarmed = self.phase is Phase.PILOT, False
            self._happen(now_s, FlightEvent.CRASHED, vehicle.crash, Severity.CRITICAL, "crash")
        elif self._lost_control(now_s, vehicle):
            self._happen(now_s, FlightEvent.CONTROL_LOST, None)
            self._taken_s = now_s
        self._follow_the_failsafe(now_s, vehicle)
        self._tell_who_took_it(now_s, vehicle)
        match self.phase:
            case Phase.ARMING:
                self._arming(now_s, vehicle)
            case Phase.TAKEOFF:
                self._taking_off(now_s, vehicle)
            case Phase.RETURNING:
                self._returning(now_s, vehicle, swarm)
            case Phase.LANDING | Phase.RTL | Phase.PILOT:
                if not vehicle.armed and not vehicle.airborne:
                    self._happen(now_s, FlightEvent.DOWN, "on the ground, disarmed")
            case Phase.CRASHED:
                self._crashed(now_s, vehicle)
        if self.phase in _IN_THE_SWARM:
            self._take(now_s, self._part.step(now_s, self.phase, swarm))
            self._notice_the_ground(now_s, vehicle)

    def _follow_the_failsafe(self, now_s: float, vehicle: VehicleFacts) -> None:
        """The phase is what the vehicle does: a failsafe may hold first, and its name may come after its mode."""
        if not (vehicle.connected and vehicle.armed) or vehicle.ours:
            return
        if self._follows_failsafe and not vehicle.failsafe:
            self._happen(now_s, FlightEvent.CONTROL_LOST, None)
            self._taken_s = now_s
        elif vehicle.failsafe and (self.phase is Phase.PILOT or self._follows_failsafe):
            event = FlightEvent.FAILSAFE_RETURNS if vehicle.returns else FlightEvent.FAILSAFE_LANDS
            if (vehicle.returns or vehicle.lands) and following(self.phase, event) is not self.phase:
                self._happen(now_s, event, None)
                self._taken_s = now_s

    def _tell_who_took_it(self, now_s: float, vehicle: VehicleFacts) -> None:
        """Once, as soon as it is known: an autopilot's text that names the failsafe may follow the change of mode."""
        if self._taken_s is None:
            return
        if self.phase is not Phase.PILOT and not self._follows_failsafe:
            self._taken_s = None
        elif vehicle.failsafe or now_s - self._taken_s > NAMED_WITHIN_S:
            self._taken_s = None
            who = (
                "failsafe of the autopilot" if vehicle.failsafe else "by the pilot or another ground station"
            )
            how = vehicle.taken_reason or f"our mode did not come, it stays in {vehicle.mode}"
            self._note(
                Severity.WARNING, "failsafe" if vehicle.failsafe else "pilot", f"{self.phase}: {who}: {how}"
            )

    def _arming(self, now_s: float, vehicle: VehicleFacts) -> None:
        if vehicle.armed and vehicle.ours:
            self._happen(now_s, FlightEvent.ARMED, "armed")
        elif vehicle.problem:
            self._happen(now_s, FlightEvent.ARMING_FAILED, vehicle.problem, Severity.CRITICAL, "arming")

    def _taking_off(self, now_s: float, vehicle: VehicleFacts) -> None:
        if vehicle.at_takeoff_altitude:
            self._happen(now_s, FlightEvent.AT_ALTITUDE, "at take-off altitude")
        elif not vehicle.armed:
            self._happen(now_s, FlightEvent.DOWN, "disarmed during take-off", Severity.CRITICAL, "takeoff")
        elif vehicle.problem:
            self._happen(now_s, FlightEvent.TAKEOFF_FAILED, vehicle.problem, Severity.CRITICAL, "takeoff")

    def _returning(self, now_s: float, vehicle: VehicleFacts, swarm: SwarmFacts) -> None:
        if not vehicle.armed and not vehicle.airborne:
            self._happen(now_s, FlightEvent.DOWN, "on the ground, disarmed")
        elif turn := self._part.step(now_s, self.phase, swarm):
            self._take(now_s, turn)
        elif swarm.over_home:
            self._happen(now_s, FlightEvent.OVER_HOME, "over home")
        elif swarm.stuck or swarm.overdue:
            why = swarm.overdue or "the way home is blocked: landing here"
            self._happen(now_s, FlightEvent.BLOCKED, why, Severity.WARNING, "blocked")

    def _crashed(self, now_s: float, vehicle: VehicleFacts) -> None:
        self._wreck_was_disarmed |= not vehicle.armed
        if not vehicle.armed or vehicle.crash:
            return
        if self._wreck_was_disarmed:
            self._happen(now_s, FlightEvent.CONTROL_LOST, "somebody has armed it again")
            return
        event = FlightEvent.CONTROL_LOST if self._had_crashed_with_pilot else FlightEvent.FLIES
        why = "it did not crash, it flies on, out of the survey: rtl brings it home"
        self._happen(now_s, event, why, Severity.CRITICAL, "crash")

    def _take(self, now_s: float, turn: Turn | None) -> None:
        if turn is not None:
            self._happen(now_s, turn.event, turn.why, turn.severity, turn.code)

    def _notice_the_ground(self, now_s: float, vehicle: VehicleFacts) -> None:
        """A drone that fell, or was disarmed, takes no part any more: the others must hear that it left."""
        if self.phase not in _IN_THE_SWARM or vehicle.armed or vehicle.airborne or not vehicle.connected:
            self._down_since_s = None
        elif self._down_since_s is None:
            self._down_since_s = now_s
        elif now_s - self._down_since_s > DOWN_S:
            self._down_since_s = None
            self._happen(now_s, FlightEvent.DOWN, "disarmed during the survey", Severity.CRITICAL, "down")

    def _lost_control(self, now_s: float, vehicle: VehicleFacts) -> bool:
        """Whether a mode that was ours is not any more (without our asking)."""
        if self.phase not in STEERING | {Phase.TAKEOFF} or not vehicle.connected:
            return False
        if vehicle.ours:
            self._control_since_s = None
            return False
        asked_s, before, now = self._control_since_s, self._taken_before, vehicle.taken_reason
        # While we wait for our mode somebody may choose another: a pilot who says no.
        taken_again = bool(now) and (not before or not now.startswith(before))
        return asked_s is None or taken_again or now_s - asked_s > self._control_timeout_s

    def _asks(self, vehicle: VehicleFacts) -> tuple[Ask, ...]:
        if self._prompt is not None:
            return (self._prompt,)
        if self.phase is Phase.ARMING:
            return (Ask.ARM,)
        if self.phase is Phase.TAKEOFF:
            return (Ask.TAKE_OFF,)
        if self.phase in DESCENTS and vehicle.armed and vehicle.ours:
            return (
                DESCENTS[self.phase],
            )  # until the mode has changed once: a pilot's later choice is left alone
        if self.phase in STEERING and not vehicle.ours:
            return (Ask.TAKE_CONTROL,)
        return ()

    def _happen(
        self,
        now_s: float,
        event: FlightEvent,
        why: str | None,
        severity: Severity = Severity.INFO,
        code: str = "phase",
    ) -> None:
        """Go where `event` leads; `why` None: that is told later.

        Raises `IllegalTransitionError`, and changes nothing, where it cannot be.
        """
        before, self.phase = self.phase, following(self.phase, event)
        self._follows_failsafe = event in (FlightEvent.FAILSAFE_RETURNS, FlightEvent.FAILSAFE_LANDS)
        if self.phase is before:
            return
        if event in TAKES_CONTROL:
            self._control_since_s = now_s
        if why is not None:
            self._note(severity, code, f"{self.phase}: {why}")

    def _note(self, severity: Severity, code: str, text: str) -> None:
        self._notes.append(Note(severity, code, text))
