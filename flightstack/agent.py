"""The agent on one drone: one synchronous, deterministic step a tick, bytes in and bytes out.

    belief -> filters -> tree -> phase -> strategy -> guard -> outputs

Each stage runs once, sees only what the stages before it made, and never calls back; an acknowledgement is an input
of a later tick. Time, randomness and inputs are arguments: a recorded flight replays to the same outputs.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from flightstack.autopilot import AutopilotSession, VehicleReport
from flightstack.config import DroneConfig
from flightstack.flight.guard import Guard, Guarded, PositionTarget
from flightstack.flight.guidance import over_the_top, underneath
from flightstack.flight.homecoming import Homecoming, Leaving
from flightstack.flight.launch_point import unfit
from flightstack.flight.phase import IN_FORMATION, Ask, FlightPhase, Note, PhaseStep, SwarmFacts, VehicleFacts
from flightstack.flight.strategy_call import consult
from flightstack.sensing.autopilot_relay import AutopilotRelay, motion
from flightstack.sensing.filter_stage import PortInput, Sensed, Sensing
from flightstack.swarm import topics
from flightstack.swarm.announcements import Announcements
from flightstack.swarm.peers import Belief
from flightstack.swarm.tree_protocol import SwarmTree, TreeNews
from flightstack.swarm.wire import Event, Phase, Severity
from flightstack.transport import Received
from mission.geometry.formation import make_layout, rotated
from mission.geometry.frames import LocalFrame, Vector3
from mission.geometry.geofence import LocalFence
from mission.strategies.arrival import Arrival
from mission.strategies.contract import (
    Decision,
    GoTo,
    Hold,
    Intent,
    Neighbour,
    Observation,
    OwnState,
    Stage,
    Strategy,
    TreePlace,
)
from mission.strategies.registry import make

AT_SLOT_M = 1.2

APPROACH_BLOCKED_S = 20.0
"""A drone that has stood still for so long on its way to its slot comes no nearer: a vehicle whose agent died may
hover in the slot, and the swarm would wait until its battery is empty."""

TRANSFER_LIMIT_S = 60.0
"""How long the swarm waits for an heir on its way to the empty slot."""


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


class Outputs(msgspec.Struct, frozen=True, array_like=True):
    """Everything that leaves the drone in one tick."""

    autopilot: bytes
    ports: tuple[tuple[str, bytes], ...]
    peers: tuple[tuple[str, bytes], ...]
    """(topic name, payload)."""
    events: tuple[Event, ...]
    """The events among `peers`, decoded, for the log."""


class Agent:
    """One drone's decisions. It opens nothing, waits for nothing and asks no clock."""

    def __init__(self, config: DroneConfig, *, incarnation: int) -> None:
        self.config = config
        self.frame = LocalFrame(config.origin)
        self.phase = FlightPhase(config.drone)
        self.session = AutopilotSession(config.drone, self.frame, config.autopilot)
        self._announcements = Announcements(
            config.drone, incarnation, self.frame.identity, 1.0 / config.tick_hz
        )
        self._belief = Belief(config.drone, config.swarm.members, self.frame)
        self._sensing = Sensing(config.instruments, config.filters)
        self._relay = AutopilotRelay(config.instruments)
        self._layout = make_layout(config.formation.layout, config.formation.spacing_m)
        self._tree = SwarmTree(
            config.drone,
            config.swarm.members,
            self._layout,
            frame_identity=self.frame.identity,
            incarnation=incarnation,
            lost_after_s=config.limits.peer_lost_s,
        )
        self._fence = LocalFence(self.frame, config.geofence) if config.geofence else None
        self._guard = Guard(config.limits, self._fence)
        layer = config.swarm.members.index(config.drone) % config.formation.layers
        self._layer_above_home_m = config.formation.above_home_m + config.formation.layer_gap_m * (layer + 1)
        self._homecoming = Homecoming(config.limits, self._fence, -self._layer_above_home_m)
        self._leaving = Leaving(config.limits)
        self._strategy = self._new_strategy()
        self._rng = np.random.default_rng((config.seed, config.drone))
        self._decision: Decision | None = None
        self._word = b""
        """The strategy's newest word: neighbours hear it also while something else flies the drone."""
        self._strategy_failure = ""
        self._formed_s: float | None = None
        self._approach = Arrival(
            arrival_m=AT_SLOT_M, settle_mps=math.inf, settle_s=0.0, blocked_s=APPROACH_BLOCKED_S
        )
        self._transfer_since_s: float | None = None
        self._best_ppm: float | None = None
        self._ticks = 0

    def step(self, now_s: float, inputs: Inputs) -> Outputs:
        """One tick. `now_s` is this drone's own time, seconds; it must not go back."""
        self._ticks += 1
        notes: list[Note] = []
        # belief
        self.session.receive(now_s, inputs.autopilot)
        inbox = self._belief.update(
            now_s, (Received(topics.TOPICS[m.topic], m.sender, m.payload) for m in inputs.peers)
        )
        vehicle = self.session.report
        notes += [Note(Severity.WARNING, "peer", problem) for problem in inbox.problems]
        notes += [Note(_severity(text.severity), "statustext", text.text) for text in vehicle.new_texts]
        # filters
        sensed = self._sensing.step(now_s, inputs.ports, self._relay.samples(now_s, vehicle), motion(vehicle))
        # tree
        news = self._tree.step(now_s, inbox.trees, self._belief, self._decision, vehicle.position_ned_m)
        place = self._tree.place(
            moving=self._transferring(now_s, vehicle, news), belief=self._belief, now_s=now_s
        )
        notes += self._tree_notes(news)
        neighbours = self._belief.neighbours(now_s)
        returning = self.phase.phase is Phase.RETURNING
        self._homecoming.step(now_s, vehicle, neighbours, returning=returning)
        # phase
        phase = self.phase.step(
            now_s, inbox.commands, self._vehicle_facts(vehicle), self._swarm_facts(now_s, vehicle, place)
        )
        notes += phase.notes
        if phase.started is not None:
            self._begin(now_s, phase.started)
        # strategy
        intent = self._decide(now_s, phase, vehicle, sensed, neighbours, place)
        # guard
        guarded = self._steer(phase, intent, vehicle, neighbours)
        # outputs
        self._ask(phase)
        return self._outputs(now_s, inputs, phase, vehicle, sensed, place, guarded, notes)

    @property
    def comes_second(self) -> bool:
        """Another agent that was running before this one says that it is this drone."""
        twin = self._belief.twin
        return twin is not None and (twin.ticks, twin.incarnation) > (
            self._ticks,
            self._announcements.incarnation,
        )

    # -- tree --------------------------------------------------------------------------------------------------

    def _begin(self, now_s: float, survey: str) -> None:
        """A survey starts: a new tree, a new strategy, nothing remembered of the one before."""
        down_m = -self.config.formation.above_home_m
        self._tree.begin(now_s, survey, (0.0, 0.0, down_m))
        self._strategy = self._new_strategy()
        self._decision = None
        self._word = b""
        self._strategy_failure = ""
        self._formed_s = None
        self._best_ppm = None

    def _new_strategy(self) -> Strategy:
        chosen = self.config.strategy
        return make(chosen.name, layout=self._layout, **chosen.parameters)

    def _transferring(self, now_s: float, vehicle: VehicleReport, news: TreeNews) -> bool:
        """Whether this drone is on its way to a slot that a heal gave it."""
        apart = self._tree.order is not None and self._tree.order.apart
        if news.moved and self._tree.member and self.phase.phase in IN_FORMATION and not apart:
            self._transfer_since_s = now_s
        if self._transfer_since_s is None:
            return False
        if self._in_slot(now_s, vehicle) or now_s - self._transfer_since_s > TRANSFER_LIMIT_S:
            self._transfer_since_s = None
        if self.phase.phase not in IN_FORMATION | {Phase.HOLDING}:
            self._transfer_since_s = None
        return self._transfer_since_s is not None

    def _tree_notes(self, news: TreeNews) -> list[Note]:
        notes = []
        if news.joined:
            notes.append(Note(Severity.INFO, "joined", "takes part in the survey that the others fly"))
        if news.lost:
            names = ", ".join(str(d) for d in news.lost)
            notes.append(Note(Severity.WARNING, "lost", f"drone {names} lost to the swarm"))
        if news.healed:
            slots = ", ".join(f"{d} in {s}" for d, s in sorted(self._tree.slots.items(), key=lambda i: i[1]))
            notes.append(Note(Severity.INFO, "heal", f"epoch {self._tree.epoch}: {slots}"))
        if news.order is not None and news.order.stage is Stage.FOUND and news.order.source_ned_m:
            n, e, d = news.order.source_ned_m
            notes.append(
                Note(Severity.INFO, "found", f"source at {n:.1f} m north, {e:.1f} m east, {-d:.1f} m up")
            )
        return notes

    def _slot_target(self) -> Vector3 | None:
        """Where this drone's slot is now, by the newest order."""
        order, slot = self._tree.order, self._tree.slots.get(self.config.drone)
        if order is None or slot is None:
            return None
        north_m, east_m = rotated(self._layout.offset_m(slot), order.rotation_rad)
        anchor = order.anchor_ned_m
        return anchor[0] + north_m, anchor[1] + east_m, anchor[2]

    def _in_slot(self, now_s: float, vehicle: VehicleReport) -> bool:
        """Whether this drone, forming up or on its way to another's slot, is in its slot, or as near as it gets."""
        under_way = self.phase.phase is Phase.FORMING or self._transfer_since_s is not None
        target, position, velocity = self._slot_target(), vehicle.position_ned_m, vehicle.velocity_ned_mps
        if not under_way or target is None or position is None or velocity is None:
            self._approach.interrupt()
            return False
        return self._approach.step(now_s, position, velocity, target)

    # -- phase -------------------------------------------------------------------------------------------------

    def _vehicle_facts(self, vehicle: VehicleReport) -> VehicleFacts:
        position = vehicle.position_ned_m
        return VehicleFacts(
            connected=vehicle.connected,
            problem=self.session.problem,
            armed=vehicle.armed,
            airborne=vehicle.airborne,
            ours=vehicle.mode_ours,
            mode=vehicle.mode,
            taken_reason=vehicle.taken_reason,
            at_takeoff_altitude=vehicle.airborne
            and position is not None
            and -position[2] > self._layer_above_home_m - 1.0,
        )

    def _swarm_facts(self, now_s: float, vehicle: VehicleReport, place: TreePlace) -> SwarmFacts:
        return SwarmFacts(
            order=self._tree.order,
            member=place.slot >= 0,
            formed_up=self._in_slot(now_s, vehicle),
            over_home=self._homecoming.over_home,
            stuck=self._homecoming.stuck,
            shut_out=self._tree.shut_out,
            must_return=self._must_return(now_s, vehicle),
        )

    def _must_return(self, now_s: float, vehicle: VehicleReport) -> str:
        limits = self.config.limits
        on_the_ground = self.phase.phase in (Phase.DISARMED, Phase.LANDED) and not vehicle.armed
        if on_the_ground and vehicle.position_ned_m is not None:
            amsl_m = self.config.origin.amsl_m
            reason = unfit(vehicle.position_ned_m, self._fence, limits.fence_margin_m, amsl_m)
            if reason:
                return reason
        if self._strategy_failure and vehicle.armed:
            return self._strategy_failure
        if vehicle.armed and self._belief.cut_off(now_s, limits.peer_lost_s):
            return (
                "most of the swarm fell silent at one moment: the own radio has failed, or a ridge is between"
            )
        return self._leaving.reason(now_s, vehicle.battery_fraction, self._belief.ground_heard_s)

    def _ask(self, phase: PhaseStep) -> None:
        for ask in phase.asks:
            match ask:
                case Ask.TAKE_CONTROL:
                    self.session.take_control()
                case Ask.ARM:
                    self.session.arm()
                case Ask.TAKE_OFF:
                    self.session.takeoff(self._layer_above_home_m)
                case Ask.LAND:
                    self.session.land()
                case Ask.RETURN:
                    self.session.rtl()
                case Ask.DISARM:
                    self.session.disarm()

    # -- strategy and guard ------------------------------------------------------------------------------------

    def _decide(
        self,
        now_s: float,
        phase: PhaseStep,
        vehicle: VehicleReport,
        sensed: Sensed,
        neighbours: tuple[Neighbour, ...],
        place: TreePlace,
    ) -> Intent:
        """The intent of this tick: the strategy's in formation, our own guidance around it."""
        self._decision = None
        position, target = vehicle.position_ned_m, self._slot_target()
        if position is None or vehicle.velocity_ned_mps is None:
            return Hold()
        match phase.phase:
            case Phase.FORMING if target is not None:
                return GoTo(over_the_top(position, target, -self._layer_above_home_m))
            case Phase.RETURNING:
                return self._homecoming.intent(position)
            case Phase.SEARCHING | Phase.TRACKING:
                if self._formed_s is None:
                    self._formed_s = now_s
                if self._transfer_since_s is not None and target is not None:
                    return GoTo(underneath(position, target, self._lower_layer_down_m()))
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
                        now_s - self._formed_s, own, neighbours, place, self._tree.order, self._tree.readings
                    ),
                    self._rng,
                )
                self._word = self._decision.word
                return self._decision.intent
            case _:
                return Hold()

    def _lower_layer_down_m(self) -> float:
        """Altitude (as down) of the heir's corridor: the separation and some room below the formation."""
        config = self.config
        below_m = 1.25 * config.limits.separation_m + 1.0
        return -max(config.formation.above_home_m - below_m, config.limits.floor_above_home_m)

    def _steer(
        self, phase: PhaseStep, intent: Intent, vehicle: VehicleReport, neighbours: tuple[Neighbour, ...]
    ) -> Guarded | None:
        """Give the autopilot its setpoint of this tick, if steering is ours."""
        if not phase.steering:
            return None
        guarded = self._guard.apply(
            intent, vehicle.position_ned_m, vehicle.velocity_ned_mps, vehicle.position_age_s, neighbours
        )
        if isinstance(guarded.setpoint, PositionTarget):
            self.session.target_position(guarded.setpoint.position_ned_m, None)
        else:
            self.session.target_velocity(guarded.setpoint.velocity_ned_mps, None)
        return guarded

    # -- outputs -----------------------------------------------------------------------------------------------

    def _outputs(
        self,
        now_s: float,
        inputs: Inputs,
        phase: PhaseStep,
        vehicle: VehicleReport,
        sensed: Sensed,
        place: TreePlace,
        guarded: Guarded | None,
        notes: list[Note],
    ) -> Outputs:
        if phase.phase in IN_FORMATION and sensed.excess_co2_ppm is not None:
            self._best_ppm = max(self._best_ppm or 0.0, sensed.excess_co2_ppm.mean)
        telling = self._announcements
        events = telling.events(notes)
        peers = [(topics.EVENT.name, topics.EVENT.codec.encode(event)) for event in events]
        peers += [(topics.OUTCOME.name, topics.OUTCOME.codec.encode(outcome)) for outcome in phase.outcomes]
        if telling.due(now_s, topics.STATE):
            state = telling.state(
                phase=phase.phase,
                vehicle=vehicle,
                sensed=sensed,
                place=place,
                moving=self._transfer_since_s is not None,
                best_ppm=self._best_ppm,
                held_by=guarded.held_by if guarded else (),
                ticks=self._ticks + inputs.late_ticks,  # that were due, whether they were held or missed
                late_ticks=inputs.late_ticks,
                word=self._word,
            )
            peers.append((topics.STATE.name, topics.STATE.codec.encode(state)))
        if self._tree.survey is not None and telling.due(now_s, topics.TREE):
            peers.append((topics.TREE.name, topics.TREE.codec.encode(self._tree.message())))
        return Outputs(self.session.step(now_s), sensed.to_ports, tuple(peers), events)


def _severity(mavlink_severity: int) -> Severity:
    """MAV_SEVERITY (0 emergency … 7 debug) as ours."""
    if mavlink_severity <= 2:
        return Severity.CRITICAL
    return Severity.WARNING if mavlink_severity <= 4 else Severity.INFO
