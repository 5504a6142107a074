"""The agent on one drone: one synchronous, deterministic step a tick, bytes in and bytes out.

    vehicle, swarm -> filters -> slot -> phase -> strategy -> guard -> outputs

Each stage runs once, sees only what the stages before it made, and never calls back; an acknowledgement is an input
of a later tick. Time, randomness and inputs are arguments: a recorded flight replays to the same outputs.
"""

from __future__ import annotations

import msgspec
import numpy as np

from flightstack.autopilot import AutopilotSession, OwnFence, TakenBy, VehicleReport
from flightstack.config import DroneConfig
from flightstack.flight.facts import SwarmFacts, VehicleFacts
from flightstack.flight.fence_conflict import fence_conflict
from flightstack.flight.free_places import FreePlaces
from flightstack.flight.guard import Guard, Guarded, PositionTarget
from flightstack.flight.guidance import heir_below_m, over_the_top, underneath
from flightstack.flight.homecoming import Homecoming
from flightstack.flight.layers import layers_of
from flightstack.flight.leaving import Leaving, LeavingFacts
from flightstack.flight.obedience import Obedience
from flightstack.flight.phase import Ask, FlightPhase, PhaseStep
from flightstack.flight.slot_transfer import SlotStep, SlotTransfer, is_awaited
from flightstack.flight.stage_bounds import StageBounds, StageEnd, ended
from flightstack.flight.strategy_call import consult
from flightstack.flight.transitions import IN_FORMATION, IllegalTransitionError
from flightstack.mavlink.modes import Duty
from flightstack.sensing.autopilot_relay import AutopilotRelay, motion
from flightstack.sensing.filter_stage import PortInput, Sensed, Sensing
from flightstack.swarm import topics
from flightstack.swarm.announcements import OwnFacts
from flightstack.swarm.member import SwarmMember, SwarmView
from flightstack.swarm.news import Note, TextNotes
from flightstack.swarm.parting import Part
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import Event, Phase, Severity
from mission.geometry.formation import make_layout
from mission.geometry.frames import LocalFrame, Vector3
from mission.geometry.geofence import LocalFence
from mission.geometry.known_obstacles import LocalObstacles
from mission.strategies.contract import (
    Decision,
    GoTo,
    Hold,
    Intent,
    Observation,
    OwnState,
    Strategy,
    TreePlace,
)
from mission.strategies.registry import make


class PeerMessage(msgspec.Struct, frozen=True, array_like=True):
    topic: str
    sender: str
    payload: bytes


class Inputs(msgspec.Struct, frozen=True, array_like=True):
    """Everything that reached the drone since its last tick."""

    autopilot: bytes = b""
    ports: tuple[PortInput, ...] = ()
    peers: tuple[PeerMessage, ...] = ()
    late_ticks: int = 0
    """Ticks since start-up that began more than a period late, as the runner counts them."""
    storage: str = ""
    """Why the flight is not recorded; empty when it is."""


class AgentStatus(msgspec.Struct, frozen=True, kw_only=True):
    """What whoever runs the agent has to know of it. It stays on the drone."""

    phase: Phase
    connected: bool
    """The autopilot is heard."""
    airborne: bool
    steerable: bool
    """The autopilot is in the mode in which it follows our setpoints."""
    waiting_for: str
    """What keeps the autopilot from being armed, in words; empty if nothing does."""
    comes_second: bool
    """Another agent that was running before this one says that it is this drone."""
    place: TreePlace
    """Its place in the swarm's tree, and the tree, as it knows them in this tick."""


class Outputs(msgspec.Struct, frozen=True):
    """Everything that leaves the drone in one tick, and the agent's status."""

    autopilot: bytes
    ports: tuple[tuple[str, bytes], ...]
    peers: tuple[tuple[str, bytes], ...]
    """(topic name, payload)."""
    events: tuple[Event, ...]
    """The events among `peers`, decoded, for the log."""
    status: AgentStatus


class Agent:
    """One drone's decisions. It opens nothing, waits for nothing and asks no clock."""

    def __init__(self, config: DroneConfig, *, incarnation: int) -> None:
        self.config = config
        self.frame = LocalFrame(config.origin)
        self.phase = FlightPhase(config.drone)
        fence = LocalFence(self.frame, config.geofence) if config.geofence else None
        obstacles = None
        if config.obstacles:
            obstacles = LocalObstacles(self.frame, config.obstacles, config.limits.obstacle_margin_m)
        self._obstacles = obstacles

        def conflict(autopilots: OwnFence, home_ned_m: Vector3) -> str:
            return fence_conflict(autopilots, home_ned_m, fence, config.limits, self.frame)

        self._session = AutopilotSession(config.drone, self.frame, config.autopilot, conflict)
        self._sensing = Sensing(config.instruments, config.filters)
        self._relay = AutopilotRelay(config.instruments)
        self._layout = make_layout(config.formation.layout, config.formation.spacing_m)
        self._swarm = SwarmMember(
            config.drone,
            config.swarm.members,
            self._layout,
            frame_identity=self.frame.identity,
            incarnation=incarnation,
            suspect_after_s=config.limits.peer_suspected_s,
            lost_after_s=config.limits.peer_lost_s,
            tick_s=1.0 / config.tick_hz,
        )
        self._guard = Guard(config.limits, fence, obstacles)
        self._places = FreePlaces(config.limits, fence, obstacles)
        layers = layers_of(config.drone, config.swarm.members, config.formation, config.limits)
        self._layer_above_home_m = layers.agent_above_home_m
        self._homecoming = Homecoming(config.limits, fence, -self._layer_above_home_m, obstacles)
        self._leaving = Leaving(config.limits, fence, config.origin.amsl_m, obstacles)
        self._slot = SlotTransfer(config.limits.separation_m)
        self._bounds = StageBounds(config.limits, fence)
        self._obedience = Obedience(config.limits.floor_above_home_m)
        self._strategy = self._new_strategy()
        self._rng = np.random.default_rng((config.seed, config.drone))
        self._decision: Decision | None = None
        self._word = b""
        """The strategy's newest word: neighbours hear it also while something else flies the drone."""
        self._strategy_failure = ""
        self._formed_s: float | None = None
        self._best_ppm: float | None = None
        self._crash = ""
        """How and where the vehicle crashed since it was armed."""
        self._texts = TextNotes()
        self._defects: set[str] = set()
        self._storage = ""
        self._ticks = 0

    def step(self, now_s: float, inputs: Inputs) -> Outputs:
        """One tick. `now_s` is this drone's own time, seconds; it must not go back."""
        self._ticks += 1
        # vehicle, swarm
        self._session.receive(now_s, inputs.autopilot)
        vehicle = self._session.report
        received = (Received(topics.TOPICS[m.topic], m.sender, m.payload) for m in inputs.peers)
        swarm = self._swarm.step(now_s, received, self.phase.phase, self._decision, vehicle.position_ned_m)
        notes = [*self._storage_notes(inputs.storage), *swarm.refused]
        notes += self._texts.notes(now_s, vehicle.new_texts)
        if vehicle.stood_still_s:
            text = f"this program stood still for {vehicle.stood_still_s:.1f} s and sent no setpoints"
            notes.append(Note(Severity.WARNING, "stood_still", text))
        notes += swarm.news
        # filters
        sensed = self._sensing.step(now_s, inputs.ports, self._relay.samples(now_s, vehicle), motion(vehicle))
        # slot
        slot = self._slot.step(
            now_s,
            self.phase.phase,
            moved=swarm.moved,
            position_ned_m=vehicle.position_ned_m,
            velocity_ned_mps=vehicle.velocity_ned_mps,
            slot_ned_m=swarm.slot_ned_m,
        )
        place = swarm.place
        if slot.transferring and place.slot >= 0:
            place = msgspec.structs.replace(place, healing=True)
        # phase
        returning = self.phase.phase is Phase.RETURNING
        self._homecoming.step(now_s, vehicle, swarm.neighbours, returning=returning)
        end = self._bounds.step(now_s, self.phase.phase, swarm.order)
        phase = self._next_phase(now_s, vehicle, swarm, slot, end, notes)
        if phase.started is not None:
            self._begin(now_s, phase.started)
        # strategy
        intent = self._decide(now_s, phase, vehicle, sensed, swarm, place, slot)
        if self._decision is not None and place.root == self.config.drone:
            self._decision = ended(self._decision, swarm.order, end.gives_up)
        notes += self._bounds.notes(root=place.root == self.config.drone)
        # guard
        self._guard.look(now_s, vehicle.position_ned_m, vehicle.ranges, swarm.neighbours)
        guarded = self._steer(phase, intent, vehicle, swarm)
        notes += self._obedience.step(now_s, guarded.setpoint if guarded else None, vehicle)
        if self._obedience.grounded:
            self._session.believe_crashed(self._obedience.grounded)
        # outputs
        self._ask(phase)
        if phase.phase in IN_FORMATION and sensed.excess_co2_ppm is not None:
            self._best_ppm = max(self._best_ppm or 0.0, sensed.excess_co2_ppm.mean)
        own = OwnFacts(
            phase.phase,
            vehicle,
            sensed,
            place,
            is_awaited(phase.phase, swarm.place.slot, swarm.order, slot),
            self._best_ppm,
            guarded.held_by if guarded else (),
            self._ticks + inputs.late_ticks,  # that were due, whether they were held or missed
            inputs.late_ticks,
            self._word,
            self._crash,
            self._obedience.astray,
            storage=self._storage,
        )
        told = self._swarm.tell(now_s, notes, phase.outcomes, own)
        status = AgentStatus(
            phase=phase.phase,
            connected=vehicle.connected,
            airborne=vehicle.airborne,
            steerable=vehicle.mode_ours,
            waiting_for=vehicle.ready_reason,
            comes_second=self._swarm.comes_second(self._ticks),
            place=place,
        )
        return Outputs(self._session.step(now_s), sensed.to_ports, told.messages, told.events, status)

    def _storage_notes(self, storage: str) -> list[Note]:
        """What is new about the recording."""
        before, self._storage = self._storage, storage
        if storage == before:
            return []
        if storage:
            return [Note(Severity.WARNING, "recording", storage)]
        return [Note(Severity.INFO, "recording", "the flight is recorded again")]

    def _begin(self, now_s: float, survey: str) -> None:
        """A survey starts: a new table, a new strategy, nothing remembered of the one before."""
        self._swarm.begin(now_s, survey, (0.0, 0.0, -self.config.formation.above_home_m))
        self._bounds.begin()
        self._strategy = self._new_strategy()
        self._decision = None
        self._word = b""
        self._strategy_failure = ""
        self._formed_s = None
        self._best_ppm = None

    def _new_strategy(self) -> Strategy:
        chosen = self.config.strategy
        return make(chosen.name, layout=self._layout, **chosen.parameters)

    # -- phase -------------------------------------------------------------------------------------------------

    def _next_phase(
        self,
        now_s: float,
        vehicle: VehicleReport,
        swarm: SwarmView,
        slot: SlotStep,
        end: StageEnd,
        notes: list[Note],
    ) -> PhaseStep:
        """The phase of this tick. An illegal transition is a defect of ours, which the tests of the phase see as an
        error; in flight it must not end the agent that steers the drone: it is told, and the phase stays."""
        facts = self._vehicle_facts(vehicle)
        try:
            phase = self.phase.step(
                now_s,
                swarm.commands,
                facts,
                self._swarm_facts(now_s, vehicle, swarm, slot, end),
                storage=self._storage,
            )
        except IllegalTransitionError as error:
            phase = self.phase.stay(facts)
            if str(error) not in self._defects:
                self._defects.add(str(error))
                notes.append(Note(Severity.CRITICAL, "defect", f"in the flight software: {error}"))
        notes += phase.notes
        return phase

    def _vehicle_facts(self, vehicle: VehicleReport) -> VehicleFacts:
        position = vehicle.position_ned_m
        if not vehicle.crash:
            self._crash = ""
        elif not self._crash:
            self._crash = vehicle.crash + self._place(position)
        return VehicleFacts(
            connected=vehicle.connected,
            problem=self._session.problem,
            armed=vehicle.armed,
            airborne=vehicle.airborne,
            ours=vehicle.mode_ours,
            mode=vehicle.mode,
            taken_reason=vehicle.taken_reason,
            failsafe=vehicle.taken_by is TakenBy.AUTOPILOT,
            returns=vehicle.way_down is Duty.RETURN,
            lands=vehicle.way_down is Duty.LAND,
            crash=self._crash,
            at_takeoff_altitude=vehicle.airborne
            and position is not None
            and -position[2] > self._layer_above_home_m - 1.0,
        )

    def _place(self, position_ned_m: Vector3 | None) -> str:
        """Where somebody has to go and look."""
        if position_ned_m is None:
            return "; it is not known where"
        place = self.frame.to_geodetic(position_ned_m)
        return f", at {place.latitude_deg:.6f}, {place.longitude_deg:.6f}"

    def _swarm_facts(
        self, now_s: float, vehicle: VehicleReport, swarm: SwarmView, slot: SlotStep, end: StageEnd
    ) -> SwarmFacts:
        standing = self.phase.phase in (Phase.DISARMED, Phase.LANDED) and not vehicle.armed
        leaving = LeavingFacts(
            battery_fraction=vehicle.battery_fraction,
            ground_heard_s=swarm.ground_heard_s,
            armed=vehicle.armed,
            launch_ned_m=vehicle.position_ned_m if standing else None,
            strategy_failure=self._strategy_failure,
            part=swarm.part,
        )
        return SwarmFacts(
            order=swarm.order,
            member=swarm.place.slot >= 0,
            formed_up=slot.formed_up,
            over_home=self._homecoming.over_home,
            stuck=self._homecoming.stuck,
            must_return=self._leaving.step(now_s, leaving) or end.leaves,
            overdue=end.lands,
            parted=swarm.part is Part.SMALLER and not end.leaves,
            handed_over=swarm.handed_over,
            in_haste=self._leaving.in_haste(vehicle.battery_fraction),
            flies_on=swarm.flies_on,
            has_twin=swarm.has_twin,
        )

    def _ask(self, phase: PhaseStep) -> None:
        for ask in phase.asks:
            match ask:
                case Ask.TAKE_CONTROL:
                    self._session.take_control()
                case Ask.ARM:
                    self._session.arm()
                case Ask.TAKE_OFF:
                    self._session.takeoff(self._layer_above_home_m)
                case Ask.LAND:
                    self._session.land()
                case Ask.RETURN:
                    self._session.rtl()
                case Ask.DISARM:
                    self._session.disarm()

    # -- strategy and guard ------------------------------------------------------------------------------------

    def _decide(
        self,
        now_s: float,
        phase: PhaseStep,
        vehicle: VehicleReport,
        sensed: Sensed,
        swarm: SwarmView,
        place: TreePlace,
        slot: SlotStep,
    ) -> Intent:
        """The intent of this tick: the strategy's in formation, our own guidance around it."""
        self._decision = None
        position, target = vehicle.position_ned_m, swarm.slot_ned_m
        if position is None or vehicle.velocity_ned_mps is None:
            return Hold()
        match phase.phase:
            case Phase.FORMING if target is not None:
                free = self._places.to_come_down_at(target, swarm.neighbours)
                return GoTo(over_the_top(position, free, -self._layer_above_home_m))
            case Phase.RETURNING:
                return self._homecoming.intent(position)
            case Phase.SEARCHING | Phase.TRACKING if place.slot >= 0:
                if self._formed_s is None:
                    self._formed_s = now_s
                if slot.transferring and target is not None:
                    below_m = self._lower_layer_down_m()
                    free = self._places.at(target)
                    return GoTo(underneath(position, free, below_m, self._places.over(free, below_m)))
                own = OwnState(
                    self.config.drone,
                    position,
                    vehicle.velocity_ned_mps,
                    sensed.excess_co2_ppm,
                    sensed.wind,
                    vehicle.battery_fraction,
                )
                self._decision, self._strategy_failure = consult(
                    self._strategy,
                    Observation(
                        now_s - self._formed_s,
                        own,
                        swarm.neighbours,
                        place,
                        swarm.order,
                        swarm.readings,
                        self._ranges_m(vehicle, position),
                    ),
                    self._rng,
                )
                self._word = self._decision.word
                return self._decision.intent
            case _:
                return Hold()

    def _ranges_m(self, vehicle: VehicleReport, position: Vector3) -> tuple[tuple[float, float], ...]:
        """What stands around: as the range finder sees it, or as far as it is known."""
        if vehicle.ranges is not None:
            return vehicle.ranges.beams
        return () if self._obstacles is None else self._obstacles.ranges_m(position)

    def _lower_layer_down_m(self) -> float:
        """Altitude (as down) of the heir's corridor."""
        config = self.config
        return -(config.formation.above_home_m - heir_below_m(config.limits))

    def _steer(
        self, phase: PhaseStep, intent: Intent, vehicle: VehicleReport, swarm: SwarmView
    ) -> Guarded | None:
        """Give the autopilot its setpoint of this tick, if steering is ours."""
        if not phase.steering:
            return None
        guarded = self._guard.apply(
            intent,
            vehicle.position_ned_m,
            vehicle.velocity_ned_mps,
            vehicle.position_age_s,
            swarm.neighbours,
            vehicle.home_ned_m,
        )
        if isinstance(guarded.setpoint, PositionTarget):
            self._session.target_position(guarded.setpoint.position_ned_m, None)
        else:
            self._session.target_velocity(guarded.setpoint.velocity_ned_mps, None)
        return guarded
