"""Bringing vehicles home whose agents are silent.

An ArduPilot in GUIDED hovers where its last target was until its battery is empty; nobody else will move it. So
when an agent that flew its vehicle falls silent, and the vehicle still flies in the mode that agent used, the
ground station commands the autopilot's own return (or landing) and repeats that until the mode is seen.

What it must not do is end a healthy survey, or fight a person:

* A vehicle that is no member is not ours to command, whatever flew it.
* A vehicle in any other mode is in the hands of its pilot or of its own failsafe, and is left alone. PX4's
  own ways into other modes are not a pilot's: HOLD at the end of its take-off, and what COM_OBL_RC_ACT says when the
  setpoints stop. That is a pilot's mode as PX4 comes, in which it sinks to the ground where it is if nobody is there.
* A companion heard over MAVLink, or surveying agents that still count the drone in, tell that the agent lives
  and only our own radio is bad. (Drones on their way home no longer keep the table, so they do not testify.) An agent
  that is heard, and says that it does not fly its vehicle, is believed.
* When all agents fall silent at once our own radio is the likelier cause: a longer grace.

Autopilots on their way home make way for nobody. So where two might meet on it, one waits for the other.
"""

from __future__ import annotations

import enum
import math

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.commands import result_name
from flightstack.mavlink.modes import Duty, Flavour, mode_of
from flightstack.mavlink.vehicle_state import HEARTBEAT_LOST_S
from flightstack.swarm.wire import Phase, Severity
from gcs.fleet.vehicles import Component
from gcs.fleet.view import FleetView
from gcs.station_config import OrphanConfig
from mission.geometry.ways_home import WayHome, in_the_way

FAST_REPEATS = 4
FAST_REPEAT_S = 0.5
SLOW_REPEAT_S = 2.0
REFUSALS_UNTIL_LANDING = 6
"""So many commands to return without effect (no position, say): then it is asked to land where it is."""
FAILSAFE_HOLD_S = 4.0
"""PX4 leaves OFFBOARD within COM_OF_LOSS_T (1 s by default) of the last setpoint."""
PILOT_MODES = frozenset({"POSITION", "ALTITUDE", "MANUAL", "STABILIZED"})
"""PX4's modes for sticks. Only a failsafe that enters one has the vehicle's state critical."""


COMMAND_MEMORY_S = 60.0
"""A vehicle that was not heard for so long is not what the operator's command was given for: it may fly again."""

SURVEYING = frozenset({Phase.TAKEOFF, Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING})
"""The phases in which agents watch each other and count the silent ones out."""


class Step(enum.StrEnum):
    WAITING = "waiting"
    """The agent is silent; the grace runs."""
    ASKING = "asking"
    """The mode is commanded and not seen yet."""
    COMING = "coming"
    """The vehicle is in the mode, and in the air."""


class ModeChange(msgspec.Struct, frozen=True):
    """Command `MAV_CMD_DO_SET_MODE` to send in this tick."""

    vehicle: Component
    duty: Duty
    confirmation: int


class Action(msgspec.Struct, frozen=True):
    """Something that was done or found, for the record and the operator."""

    drone: int
    severity: Severity
    text: str


class _Case(msgspec.Struct):
    since_s: float
    """When the agent was last heard flying the vehicle, or the operator's command came."""
    step: Step
    duty: Duty
    commanded: bool = False
    """By the operator: the mode that it was in does not matter then, but one that is chosen later does."""
    from_mode: int | None = None
    """The mode in which the operator's command met it."""
    sent: int = 0
    sent_s: float | None = None
    excused: str = ""
    """Why nothing is done for now; said once."""
    due_s: float | None = None
    """Since when there has been no excuse."""


class OrphanKeeper:
    """One case for each vehicle that needs bringing home."""

    def __init__(self, config: OrphanConfig) -> None:
        self._config = config
        self._cases: dict[int, _Case] = {}
        self._actions: list[Action] = []
        self._held: dict[int, int] = {}
        """In this tick: who has to wait, and for whom."""

    def command(self, now_s: float, drone: int, duty: Duty) -> None:
        """The operator wants this vehicle in the mode for `duty`, whatever it does now."""
        self._cases[drone] = _Case(now_s, Step.ASKING, duty, commanded=True)

    def take_actions(self) -> list[Action]:
        taken, self._actions = self._actions, []
        return taken

    def step(self, now_s: float, fleet: FleetView) -> list[ModeChange]:
        requests = []
        self._held = self._in_the_way(now_s, fleet)
        for drone in filter(fleet.is_member, fleet.drones(now_s)):
            vehicle = fleet.vehicle(drone)
            case = self._cases.get(drone)
            if vehicle is None or vehicle.age_s(now_s) > HEARTBEAT_LOST_S:
                # Nothing reaches it now; the case stays for when it is heard again.
                unheard_s = math.inf if vehicle is None else vehicle.age_s(now_s)
                if case is not None and case.commanded and unheard_s > COMMAND_MEMORY_S:
                    self._close(drone, "not heard any more: the operator's command is forgotten")
                continue
            if case is None or not case.commanded:
                case = self._open_or_close(now_s, fleet, drone, vehicle, case)
            if case is not None and (request := self._pursue(now_s, fleet, drone, vehicle, case)):
                requests.append(request)
        return requests

    def _open_or_close(
        self, now_s: float, fleet: FleetView, drone: int, vehicle: Component, case: _Case | None
    ) -> _Case | None:
        """Whether this vehicle is an orphan at all."""
        agent = fleet.agents.get(drone)
        if self._config.action == "none" or agent is None or not agent.flown:
            if case is not None:
                self._close(drone, "on the ground" if not vehicle.armed else "not an orphan any more")
            return None
        if fleet.agent_live(drone, now_s) and agent.has_its_vehicle():
            if case is not None and case.step is not Step.WAITING:
                self._close(drone, "its agent is back")
            self._cases.pop(drone, None)
            return None
        if case is None and agent.last_flying_s is not None:
            duty = Duty.LAND if self._config.action == "land" else Duty.RETURN
            case = self._cases[drone] = _Case(agent.last_flying_s, Step.WAITING, duty)
        return case

    def _pursue(
        self, now_s: float, fleet: FleetView, drone: int, vehicle: Component, case: _Case
    ) -> ModeChange | None:
        if not vehicle.armed:
            self._close(drone, "on the ground, disarmed")
            return None
        if vehicle.crash:  # a wreck is not sent anywhere: its propellers would turn
            self._close(drone, "it has crashed: left alone")
            return None
        if vehicle.in_mode(case.duty):
            if case.step is Step.ASKING:
                self._say(drone, Severity.WARNING, f"is in {vehicle.mode} by command of the ground station")
                case.step = Step.COMING
            return None
        if case.step is Step.COMING:
            # It was in our mode and somebody chose another: a pilot, or a failsafe. Theirs from now on.
            self._say(drone, Severity.WARNING, f"left our mode for {vehicle.mode}: left alone")
            del self._cases[drone]
            agent = fleet.agents.get(drone)
            if agent is not None:
                agent.flown = False
            return None
        if case.commanded:
            if case.from_mode is None:
                case.from_mode = vehicle.custom_mode
            elif vehicle.custom_mode != case.from_mode and not _px4_by_itself(
                vehicle, case, _last_flying_phase(fleet, drone)
            ):
                self._say(drone, Severity.WARNING, f"somebody chose {vehicle.mode}: left alone")
                del self._cases[drone]
                return None
        else:
            excuse = self._excuse(now_s, fleet, drone, vehicle, case)
            if excuse is not None:
                if excuse and excuse != case.excused:
                    self._say(drone, Severity.WARNING, f"agent silent, but {excuse}: left alone")
                    case.excused = excuse
                return None
            if case.step is Step.WAITING and self._waits(now_s, drone, case):
                return None
        return self._ask(now_s, drone, vehicle, case)

    def _waits(self, now_s: float, drone: int, case: _Case) -> bool:
        """Whether another has to come down, or to go, first. Whose turn it is, is seen in the tick after."""
        if case.duty is not Duty.RETURN:
            return False
        if case.due_s is None:
            case.due_s = now_s
            return True
        first = self._held.get(drone)
        if first is None or now_s - case.due_s > self._config.longest_wait_s:
            return False
        excuse = f"waits for drone {first}"
        if excuse != case.excused:
            text = f"agent silent: brought home after drone {first}, which is in its way"
            self._say(drone, Severity.WARNING, text)
            case.excused = excuse
        return True

    def _in_the_way(self, now_s: float, fleet: FleetView) -> dict[int, int]:
        """Who is to be brought home, and has to wait for whom."""
        waiting: dict[int, WayHome] = {}
        on_their_way: dict[int, WayHome] = {}
        for drone in filter(fleet.is_member, fleet.drones(now_s)):
            vehicle, case = fleet.vehicle(drone), self._cases.get(drone)
            if vehicle is None or vehicle.crash or not vehicle.armed or not vehicle.airborne(now_s):
                continue
            way = _way_home(fleet, drone, vehicle)
            if way is None:
                continue
            if vehicle.in_mode(Duty.RETURN) or (case is not None and case.step is Step.ASKING):
                on_their_way[drone] = way
            elif case is not None and not (case.excused and case.due_s is None):
                waiting[drone] = way
        later = {drone for drone in waiting if self._cases[drone].due_s is None}
        return in_the_way(waiting, on_their_way, self._config.apart_m, later=later)

    def _excuse(
        self, now_s: float, fleet: FleetView, drone: int, vehicle: Component, case: _Case
    ) -> str | None:
        """Why nothing is to be done now ("" while the grace runs); None when there is no excuse."""
        phase = _last_flying_phase(fleet, drone)
        unattended = vehicle.in_mode(Duty.CONTROL) or _px4_by_itself(vehicle, case, phase)
        if case.step is Step.ASKING:
            return None if unattended else f"somebody chose {vehicle.mode}"
        if not vehicle.airborne(now_s):
            return ""
        if not unattended:
            return f"it is in {vehicle.mode}, not in the agent's mode"
        silence_s = now_s - case.since_s
        if silence_s < self._config.grace_s:
            return ""
        heard = fleet.agent_live(drone, now_s)
        if not heard and fleet.vehicles.companion_age_s(drone, now_s) <= HEARTBEAT_LOST_S:
            return "its companion is heard over MAVLink"
        if phase in SURVEYING and _counted_in(now_s, fleet, drone):
            return "other drones still count it in"
        alone = not any(fleet.agent_live(other, now_s) for other in fleet.agents if other != drone)
        if alone and len(fleet.members) > 1 and silence_s < self._config.all_silent_grace_s:
            return "no agent at all is heard, so it may be our own radio"
        return None

    def _ask(self, now_s: float, drone: int, vehicle: Component, case: _Case) -> ModeChange | None:
        wait_s = FAST_REPEAT_S if case.sent < FAST_REPEATS else SLOW_REPEAT_S
        if case.sent_s is not None and now_s - case.sent_s < wait_s:
            return None
        if vehicle.mode_table is Flavour.UNKNOWN:
            if case.excused != "flavour":
                text = "no multicopter of ArduPilot or PX4: it cannot be commanded"
                self._say(drone, Severity.CRITICAL, text)
                case.excused = "flavour"
            return None
        if case.sent >= REFUSALS_UNTIL_LANDING and case.duty is Duty.RETURN:
            answer = _answer(vehicle, case)
            self._say(drone, Severity.CRITICAL, f"does not return ({answer}): commanded to land where it is")
            case.duty, case.sent = Duty.LAND, 0
        if case.sent == 0:
            why = (
                "by the operator"
                if case.commanded
                else f"its agent is silent for {now_s - case.since_s:.0f} s"
            )
            self._say(
                drone, Severity.CRITICAL, f"commanded to {case.duty.value} ({why}), from {vehicle.mode}"
            )
        case.step = Step.ASKING
        case.sent += 1
        case.sent_s = now_s
        return ModeChange(vehicle, case.duty, min(case.sent - 1, 255))

    def _close(self, drone: int, why: str) -> None:
        case = self._cases.pop(drone, None)
        if case is not None and case.step is not Step.WAITING:
            self._say(drone, Severity.INFO, why)

    def _say(self, drone: int, severity: Severity, text: str) -> None:
        self._actions.append(Action(drone, severity, text))


def _way_home(fleet: FleetView, drone: int, vehicle: Component) -> WayHome | None:
    """As far as its place and its home are known."""
    agent = fleet.agents.get(drone)
    home_ned_m = vehicle.home_ned_m
    if home_ned_m is None and agent is not None and agent.state is not None and fleet.frame_matches(drone):
        home_ned_m = agent.state.home_ned_m
    if vehicle.position_ned_m is None or home_ned_m is None:
        return None
    return WayHome(vehicle.position_ned_m, home_ned_m)


def _last_flying_phase(fleet: FleetView, drone: int) -> Phase | None:
    agent = fleet.agents.get(drone)
    return agent.last_flying_phase if agent is not None else None


def _px4_by_itself(vehicle: Component, case: _Case, phase: Phase | None) -> bool:
    """Whether PX4 came into its mode without anybody's choice, from an agent that flew in `phase`."""
    if vehicle.flavour is not Flavour.PX4:
        return False
    holds = vehicle.custom_mode == mode_of(Flavour.PX4, Duty.HOLD)
    if phase is Phase.TAKEOFF:
        return holds or vehicle.mode == "TAKEOFF"
    sinks = vehicle.mode in PILOT_MODES and vehicle.system_status == mavlink.MAV_STATE_CRITICAL
    return (holds or sinks) and 0.0 <= vehicle.mode_since_s - case.since_s <= FAILSAFE_HOLD_S


def _counted_in(now_s: float, fleet: FleetView, drone: int) -> bool:
    """Whether somebody who surveys still counts `drone` in."""
    return any(
        agent.state is not None and agent.state.phase in SURVEYING for agent in fleet.witnesses(drone, now_s)
    )


def _answer(vehicle: Component, case: _Case) -> str:
    """What the autopilot said to our newest command."""
    acknowledged = vehicle.acknowledgement
    is_ours = (
        acknowledged is not None
        and acknowledged.command == mavlink.MAV_CMD_DO_SET_MODE
        and acknowledged.time_s >= case.since_s
    )
    if acknowledged is None or not is_ours:
        return "no answer"
    return result_name(acknowledged.result)
