"""A swarm of kinematic drones over the radio of one process, and what faults do to it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final

from flightstack.swarm.admission import Admission, Message
from flightstack.swarm.freshness import Freshness, MessageMemory
from flightstack.swarm.topics import ORDER, READINGS, STATE, TABLE, Received
from flightstack.swarm.wire import DroneState, OrderState, Phase, ReadingsState, TableState
from flightstack.transport.memory import MemoryRadio, MemoryTransport
from flightstack.transport.radio_model import RadioModel
from mission.geometry.formation import make_layout
from mission.geometry.frames import Vector3
from simvehicle.faults.fault_table import CommandWord, SwarmFaultSpec
from simvehicle.scenario.kinematic_drone import TICK_S, UP_AGAIN_S, KinematicDrone

HEIGHT_M: Final = 10.0
_TOPICS: Final = (STATE, TABLE, ORDER, READINGS)
Said = DroneState | TableState | OrderState | ReadingsState
"""What is on the air here."""


@dataclasses.dataclass
class KinematicMember:
    """One drone with its radio."""

    drone: KinematicDrone
    transport: MemoryTransport
    alive: bool = True
    """Whether the agent runs; the vehicle hovers on without it."""
    frozen: bool = False
    clock_ahead_s: float = 0.0
    starts: int = 1
    memory: MessageMemory = dataclasses.field(default_factory=MessageMemory)
    """Of what its agent has heard since it was started."""
    up_at_s: float = -math.inf
    """When an agent that was started again takes part."""

    @property
    def runs(self) -> bool:
        return self.alive and not self.frozen


class KinematicSwarm:
    """Steps radio and drones together; a `simvehicle.faults.fault_table.SwarmVictim`. Everybody is in the air, in its
    slot, from the beginning."""

    def __init__(self, count: int, spacing_m: float, model: RadioModel, seed: int) -> None:
        self.ids = tuple(range(1, count + 1))
        self.layout = make_layout("hexagonal", spacing_m)
        self.radio = MemoryRadio(seed, model=model)
        self.now_s = 0.0
        self.members: dict[int, KinematicMember] = {}
        self.changes = 0
        """Counts what has befallen the swarm: faults, ends of faults, and drones that come and go."""
        self._calm = self.radio.conditions
        self._pieces: dict[SwarmFaultSpec, list[str]] = {}
        self._admission = Admission(self.ids, 0)
        self._read: dict[int, tuple[Received, Said]] = {}
        """By identity: a message that is heard by many is decoded and judged once, as each of them would."""
        anchor: Vector3 = (0.0, 0.0, -HEIGHT_M)
        for drone in self.ids:
            north_m, east_m = self.layout.offset_m(drone - 1)
            member = self._started(drone, (north_m, east_m, -HEIGHT_M), Phase.SEARCHING, 1)
            member.drone.table.begin(0.0, "survey", anchor)
            self.members[drone] = member

    def step(self) -> None:
        """One tick."""
        self.now_s = round(self.now_s + TICK_S, 6)
        running = [member for member in self.members.values() if member.runs]
        for member in running:
            for topic, payload in member.drone.tell(self.now_s + member.clock_ahead_s):
                member.transport.publish(topic, payload)
        self.radio.step(self.now_s)
        for member in running:
            if member.up_at_s <= self.now_s and member.drone.phase is Phase.DISARMED:
                self._take_part(member)
            now_s = self.now_s + member.clock_ahead_s
            received = member.transport.receive()
            if received:
                member.drone.hear(now_s, self._admitted(member, received))
            phase = member.drone.phase
            member.drone.step(now_s)
            self.changes += member.drone.phase is not phase
        if len(self._read) > 1000:
            self._read.clear()

    def _admitted(self, member: KinematicMember, received: Sequence[Received]) -> list[Message]:
        """What counts of what has come to a drone: what it has heard before does not."""
        messages: list[Message] = []
        read, judge = self._read, member.memory.judge
        for item in received:
            known = read.get(id(item))
            message = known[1] if known is not None and known[0] is item else self._decoded(item)
            if judge(item, message) is Freshness.NEW:
                messages.append(message)
        return messages

    def _decoded(self, received: Received) -> Said:
        message = self._admission.read(received)
        if not isinstance(message, Said):
            raise RuntimeError(f"a drone of ours is not believed: {message}")
        self._read[id(received)] = received, message
        return message

    def _started(self, drone: int, position_ned_m: Vector3, phase: Phase, starts: int) -> KinematicMember:
        pilot = KinematicDrone(
            drone,
            self.ids,
            self.layout,
            incarnation=1000 * starts + drone,
            position_ned_m=position_ned_m,
            phase=phase,
        )
        transport = self.radio.join(drone, _TOPICS, lambda: pilot.position_ned_m)
        return KinematicMember(pilot, transport, starts=starts)

    def _take_part(self, member: KinematicMember) -> None:
        """The operator's start reaches an agent that was started again: it knows of no other survey than that."""
        member.drone.phase = Phase.FORMING
        now_s = self.now_s + member.clock_ahead_s
        survey = f"start {member.starts} of {member.drone.drone}"
        member.drone.table.begin(now_s, survey, (0.0, 0.0, -HEIGHT_M))
        member.drone.phase = Phase.SEARCHING
        self.changes += 1

    # -- faults --------------------------------------------------------------------------------------------------

    def kill(self, drone: int) -> None:
        member = self.members[drone]
        if member.alive:
            member.alive = False
            member.transport.close()
        self.changes += 1

    def start_again(self, drone: int) -> None:
        before = self.members[drone]
        if before.alive:
            return
        member = self._started(drone, before.drone.position_ned_m, Phase.DISARMED, before.starts + 1)
        member.up_at_s = self.now_s + UP_AGAIN_S
        member.frozen = before.frozen
        member.clock_ahead_s = before.clock_ahead_s
        self.members[drone] = member
        self.changes += 1

    def set_frozen(self, drone: int, frozen: bool) -> None:
        self.members[drone].frozen = frozen
        self.changes += 1

    def set_radio(self, node: int | None, working: bool) -> None:
        if node is not None:
            if working:
                self.radio.switch_on(node)
            else:
                self.radio.switch_off(node)
        self.changes += 1

    def set_one_way(self, drone: int, towards: int, heard: bool) -> None:
        if heard:
            self.radio.unblock(drone, towards)
        else:
            self.radio.block(drone, towards)
        self.changes += 1

    def set_parts(self, fault: SwarmFaultSpec, apart: bool) -> None:
        if apart:
            names = self._pieces[fault] = [f"{fault.at_s:g} s: {part}" for part in fault.parts[1:]]
            for name, part in zip(names, fault.parts[1:], strict=True):
                self.radio.cut(name, part)
        else:
            for name in self._pieces.pop(fault, ()):
                self.radio.mend(name)
        self.changes += 1

    def set_loss(self, loss: float | None) -> None:
        calm = self._calm
        self.radio.conditions = calm if loss is None else dataclasses.replace(calm, loss=loss)
        self.changes += 1

    def advance_clock(self, drone: int, by_s: float) -> None:
        self.members[drone].clock_ahead_s += by_s
        self.changes += 1

    def take_by_pilot(self, drone: int) -> None:
        """A person has it: it says so and takes part no more."""
        self.members[drone].drone.phase = Phase.PILOT
        self.changes += 1

    def command(self, word: CommandWord, drone: int) -> None:
        """Only what sends single drones home or brings them down has a meaning here: they leave."""
        phase = {"rtl": Phase.RETURNING, "land": Phase.LANDING}.get(word)
        if phase is not None and drone in self.members:
            self.members[drone].drone.phase = phase
            self.members[drone].drone.sent_home = True
        self.changes += 1
