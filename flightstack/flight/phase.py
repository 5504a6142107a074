"""The flight phases of one drone: one table of what may follow what, and one function that changes it.

The phase decides who steers (our setpoints, the autopilot by itself, a person) and what is asked of the
autopilot. Ground commands enter here and nowhere else. When the pilot or a failsafe of the autopilot takes the
mode away, our authority ends in the same tick and comes back by a command only.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence

import msgspec

from flightstack.swarm.wire import Command, CommandName, CommandOutcome, Phase, Result, Severity
from mission.strategies.contract import Order, Stage

AFTER: dict[Phase, frozenset[Phase]] = {
    Phase.DISARMED: frozenset({Phase.ARMING, Phase.RETURNING, Phase.LANDING}),
    Phase.ARMING: frozenset({Phase.TAKEOFF, Phase.DISARMED, Phase.PILOT}),
    Phase.TAKEOFF: frozenset({Phase.FORMING, Phase.RETURNING, Phase.LANDING, Phase.LANDED, Phase.PILOT}),
    Phase.FORMING: frozenset(
        {Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING, Phase.RETURNING, Phase.LANDING, Phase.PILOT}
        | {Phase.LANDED}
    ),
    Phase.SEARCHING: frozenset(
        {Phase.TRACKING, Phase.HOLDING, Phase.RETURNING, Phase.LANDING, Phase.LANDED, Phase.PILOT}
    ),
    Phase.TRACKING: frozenset(
        {Phase.SEARCHING, Phase.HOLDING, Phase.RETURNING, Phase.LANDING, Phase.LANDED, Phase.PILOT}
    ),
    Phase.HOLDING: frozenset({Phase.FORMING, Phase.RETURNING, Phase.LANDING, Phase.LANDED, Phase.PILOT}),
    Phase.RETURNING: frozenset({Phase.LANDING, Phase.LANDED, Phase.PILOT}),
    Phase.LANDING: frozenset({Phase.LANDED, Phase.RETURNING, Phase.PILOT}),
    Phase.PILOT: frozenset({Phase.FORMING, Phase.RETURNING, Phase.LANDING, Phase.LANDED, Phase.DISARMED}),
    Phase.LANDED: frozenset({Phase.ARMING}),
}
"""What may follow a phase. A command or an event that asks for anything else is refused and changes nothing."""

STEERING = frozenset({Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING, Phase.RETURNING})
"""The phases in which we send a setpoint every tick, even to hold."""

IN_FORMATION = frozenset({Phase.SEARCHING, Phase.TRACKING})
"""The phases in which the strategy decides."""

TAKING_PART = frozenset(
    {Phase.ARMING, Phase.TAKEOFF, Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING}
)
"""The phases of a live member of the survey; any other phase after the start announces that it left."""


DOWN_S = 3.0
"""How long a vehicle in formation may seem disarmed before it counts as down: heartbeats come once a second."""


class Ask(enum.Enum):
    """What the phase asks of the autopilot session. Repeating an ask is harmless."""

    TAKE_CONTROL = "take_control"
    ARM = "arm"
    """Set parameters, wait until ready, take the mode, start the motors."""
    TAKE_OFF = "take_off"
    LAND = "land"
    RETURN = "return"
    DISARM = "disarm"


class VehicleFacts(msgspec.Struct, frozen=True):
    """What the phase needs to know of the vehicle, from the autopilot's own reports."""

    connected: bool
    problem: str
    """Why the newest request to the autopilot failed for good, empty otherwise."""
    armed: bool
    airborne: bool
    ours: bool
    """The autopilot is in the mode in which it follows our setpoints."""
    mode: str
    taken_reason: str
    """How authority was lost, as the session saw it; empty while it was not."""
    at_takeoff_altitude: bool


class SwarmFacts(msgspec.Struct, frozen=True):
    """What the phase needs to know of the swarm and of the drone's own place in it."""

    order: Order | None
    member: bool
    """The tree still counts this drone in."""
    formed_up: bool
    """In its slot, or as near to it as it gets."""
    over_home: bool
    """Above its own home and low enough for the autopilot's landing."""
    stuck: bool
    """Returning, and no nearer to home for long: something is in the way that does not move."""
    shut_out: bool
    """The others fly a survey that does not count this drone in."""
    must_return: str
    """Why this drone cannot go on (battery, sensor, ground station lost), empty if it can."""


class Note(msgspec.Struct, frozen=True):
    severity: Severity
    code: str
    text: str


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
        self._down_since_s: float | None = None
        self._answered: dict[str, CommandOutcome] = {}
        self._notes: list[Note] = []
        self._prompt: Ask | None = None
        self._descent = Ask.LAND
        """How the autopilot is asked to bring the drone down in phase LANDING."""

    def step(
        self, now_s: float, commands: Sequence[Command], vehicle: VehicleFacts, swarm: SwarmFacts
    ) -> PhaseStep:
        self._notes = []
        self._prompt = None
        started = None
        outcomes = []
        for command in commands:
            if command.target not in (0, self._drone):
                continue
            outcome = self._answered.get(command.identity)
            if outcome is None:
                before = self.phase
                reason = self._obey(now_s, command, vehicle, swarm)
                result = Result.REFUSED if reason else Result.ACCEPTED
                outcome = CommandOutcome(command.identity, self._drone, result, reason)
                self._remember(outcome)
                self._note(
                    Severity.WARNING if reason else Severity.INFO,
                    "command",
                    f"{command.name} from {command.sender}: {outcome.result}"
                    + (f": {reason}" if reason else ""),
                )
                if command.name is CommandName.START and self.phase is not before:
                    started = command.identity
            outcomes.append(outcome)
        self._advance(now_s, vehicle, swarm)
        return PhaseStep(
            self.phase,
            self._asks(vehicle),
            tuple(outcomes),
            tuple(self._notes),
            started,
            self.phase in STEERING,
        )

    # -- commands ---------------------------------------------------------------------------------------------

    def _obey(self, now_s: float, command: Command, vehicle: VehicleFacts, swarm: SwarmFacts) -> str:
        """Carry a command out; returns why not, or nothing."""
        name = command.name
        if name is CommandName.START:
            return self._start(now_s, vehicle, swarm)
        if name is CommandName.PAUSE:
            if self.phase is Phase.HOLDING:
                return ""
            return self._change(now_s, Phase.HOLDING, "paused by command")
        if name is CommandName.RESUME:
            if self.phase in TAKING_PART - {Phase.HOLDING}:
                return ""
            if not swarm.member:
                return "no longer in the swarm's tree: use abort (return in good order), rtl or land"
            if self.phase not in (Phase.HOLDING, Phase.PILOT) or not vehicle.airborne:
                return f"nothing to resume: the drone is {self.phase}"
            self._control_since_s = now_s
            return self._change(now_s, Phase.FORMING, "resumed by command")
        if self.phase is Phase.ARMING:
            self._prompt = Ask.DISARM if vehicle.armed else None
            return self._change(now_s, Phase.DISARMED, f"start cancelled: {name} by command")
        if not vehicle.airborne and not vehicle.armed:
            return f"{name}: the drone is not flying"
        if name is CommandName.ABORT:
            if self.phase in (Phase.RETURNING, Phase.LANDING):
                return ""
            self._control_since_s = now_s
            return self._change(now_s, Phase.RETURNING, "survey aborted by command")
        ask, why = (Ask.RETURN, "rtl") if name is CommandName.RTL else (Ask.LAND, "land")
        self._prompt = self._descent = ask
        return "" if self.phase is Phase.LANDING else self._change(now_s, Phase.LANDING, f"{why} by command")

    def _start(self, now_s: float, vehicle: VehicleFacts, swarm: SwarmFacts) -> str:
        if not vehicle.connected:
            return "the autopilot does not answer: check its link and power"
        if self.phase in TAKING_PART - {Phase.HOLDING}:
            return ""  # it takes part already: whoever starts again means those that do not
        if self.phase not in (Phase.DISARMED, Phase.LANDED):
            return f"already {self.phase}"
        if vehicle.armed:
            return f"the vehicle is armed in {vehicle.mode}: disarm it first"
        if swarm.shut_out:
            return "the others fly a survey that has counted this drone out: it can take part in the next"
        if swarm.must_return:
            return swarm.must_return
        return self._change(now_s, Phase.ARMING, "survey started")

    def _remember(self, outcome: CommandOutcome) -> None:
        self._answered[outcome.command] = outcome
        while len(self._answered) > 64:
            del self._answered[next(iter(self._answered))]

    # -- events -----------------------------------------------------------------------------------------------

    def _advance(self, now_s: float, vehicle: VehicleFacts, swarm: SwarmFacts) -> None:
        if self._lost_control(now_s, vehicle):
            why = f"mode {vehicle.mode} was taken by the pilot or a failsafe"
            self._change(now_s, Phase.PILOT, why, Severity.WARNING, "pilot")
        match self.phase:
            case Phase.ARMING:
                self._arming(now_s, vehicle)
            case Phase.TAKEOFF:
                self._taking_off(now_s, vehicle)
            case Phase.RETURNING:
                if not vehicle.armed and not vehicle.airborne:
                    self._change(now_s, Phase.LANDED, "landed")
                elif swarm.over_home:
                    self._change(now_s, Phase.LANDING, "over home")
                elif swarm.stuck:
                    self._change(
                        now_s,
                        Phase.LANDING,
                        "the way home is blocked: landing here",
                        Severity.WARNING,
                        "blocked",
                    )
            case Phase.LANDING | Phase.PILOT:
                if not vehicle.armed and not vehicle.airborne:
                    self._change(now_s, Phase.LANDED, "landed")
        if self.phase in TAKING_PART - {Phase.ARMING, Phase.TAKEOFF}:
            self._follow_the_swarm(now_s, swarm)
            self._notice_the_ground(now_s, vehicle)

    def _arming(self, now_s: float, vehicle: VehicleFacts) -> None:
        if vehicle.armed and vehicle.ours:
            self._change(now_s, Phase.TAKEOFF, "armed")
        elif vehicle.problem:
            self._change(now_s, Phase.DISARMED, vehicle.problem, Severity.CRITICAL, "arming")

    def _taking_off(self, now_s: float, vehicle: VehicleFacts) -> None:
        if vehicle.at_takeoff_altitude:
            self._control_since_s = now_s
            self._change(now_s, Phase.FORMING, "at take-off altitude")
        elif not vehicle.armed:
            self._change(now_s, Phase.LANDED, "disarmed during take-off", Severity.CRITICAL, "takeoff")
        elif vehicle.problem:
            self._change(now_s, Phase.LANDING, vehicle.problem, Severity.CRITICAL, "takeoff")

    def _follow_the_swarm(self, now_s: float, swarm: SwarmFacts) -> None:
        stage = swarm.order.stage if swarm.order else None
        if swarm.must_return:
            self._change(now_s, Phase.RETURNING, swarm.must_return, Severity.WARNING, "leaving")
        elif not swarm.member:
            why = "the swarm has counted this drone out"
            self._change(now_s, Phase.RETURNING, why, Severity.WARNING, "leaving")
        elif stage is Stage.FOUND:
            self._change(now_s, Phase.RETURNING, "the source is found")
        elif stage is Stage.GIVE_UP:
            self._change(now_s, Phase.RETURNING, "the search area is exhausted")
        elif self.phase is Phase.FORMING and swarm.formed_up:
            self._change(now_s, Phase.TRACKING if stage is Stage.TRACK else Phase.SEARCHING, "in formation")
        elif self.phase is Phase.SEARCHING and stage is Stage.TRACK:
            self._change(now_s, Phase.TRACKING, "following the plume")
        elif self.phase is Phase.TRACKING and stage is Stage.SEARCH:
            self._change(now_s, Phase.SEARCHING, "plume lost")

    def _notice_the_ground(self, now_s: float, vehicle: VehicleFacts) -> None:
        """A drone that fell, or was disarmed, takes no part any more: the others must hear that it left."""
        if self.phase not in TAKING_PART or vehicle.armed or vehicle.airborne or not vehicle.connected:
            self._down_since_s = None
        elif self._down_since_s is None:
            self._down_since_s = now_s
        elif now_s - self._down_since_s > DOWN_S:
            self._down_since_s = None
            self._change(now_s, Phase.LANDED, "disarmed during the survey", Severity.CRITICAL, "down")

    def _lost_control(self, now_s: float, vehicle: VehicleFacts) -> bool:
        """Whether a mode that was ours is not any more (without our asking)."""
        if self.phase not in STEERING | {Phase.TAKEOFF} or not vehicle.connected:
            return False
        if vehicle.ours:
            self._control_since_s = None
            return False
        asked_s = self._control_since_s
        return asked_s is None or now_s - asked_s > self._control_timeout_s

    def _asks(self, vehicle: VehicleFacts) -> tuple[Ask, ...]:
        if self._prompt is not None:
            return (self._prompt,)
        if self.phase is Phase.ARMING:
            return (Ask.ARM,)
        if self.phase is Phase.TAKEOFF:
            return (Ask.TAKE_OFF,)
        if self.phase is Phase.LANDING and vehicle.ours:
            return (self._descent,)  # until the mode has changed once: a pilot's later choice is left alone
        if self.phase in STEERING and not vehicle.ours:
            return (Ask.TAKE_CONTROL,)
        return ()

    def _change(
        self, now_s: float, to: Phase, why: str, severity: Severity = Severity.INFO, code: str = "phase"
    ) -> str:
        """Go to phase `to`; returns why that cannot be, or nothing."""
        if to is self.phase:
            return ""
        if to not in AFTER[self.phase]:
            return f"the drone is {self.phase}"
        self.phase = to
        if to in (Phase.ARMING, Phase.TAKEOFF):
            self._control_since_s = now_s
        if to is Phase.LANDING and self._prompt is None:
            self._descent = Ask.LAND
        self._note(severity, code, f"{to}: {why}")
        return ""

    def _note(self, severity: Severity, code: str, text: str) -> None:
        self._notes.append(Note(severity, code, text))
