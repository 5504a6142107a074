"""One drone's part in its swarm: what it hears, makes of it, and tells.

`step` takes the messages of a tick and gives the view of it that the rest of the agent decides by; `tell` ends the
tick with the messages that go out. Both are deterministic in their arguments; neither sends anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import msgspec

from flightstack.swarm.admission import Admission, Refusal, RefusalKind
from flightstack.swarm.announcements import Announced, Announcements, OwnFacts
from flightstack.swarm.incarnations import TWINS_S
from flightstack.swarm.news import Note, tree_notes
from flightstack.swarm.parting import Part
from flightstack.swarm.peers import Peers
from flightstack.swarm.topics import Received
from flightstack.swarm.tree_protocol import SwarmTree
from flightstack.swarm.wire import Command, CommandOutcome, DroneState, Severity, TreeState
from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Neighbour, Order, TreePlace


class SwarmView(msgspec.Struct, frozen=True):
    """The swarm in one tick, as this drone knows it."""

    commands: tuple[Command, ...]
    neighbours: tuple[Neighbour, ...]
    place: TreePlace
    """`slot` is -1 if the tree does not count this drone in. `healing` does not yet tell whether this drone itself is
    on its way to a new slot."""
    order: Order | None
    readings: tuple[Reading, ...]
    slot_ned_m: Vector3 | None
    """Where this drone's slot is now, by the newest order."""
    moved: bool
    """A heal of this tick has given this drone another slot."""
    shut_out: bool
    """The others fly a survey that does not count this drone in."""
    has_twin: bool
    """Another agent says, now, that it is this drone."""
    part: Part
    ground_heard_s: float | None
    refused: tuple[Note, ...]
    """Messages that were not believed, each kind once."""
    news: tuple[Note, ...]
    """What changed in the tree."""


class SwarmMember:
    """`step`, then (at most once, if a survey starts) `begin`, then `tell`, once a tick."""

    def __init__(
        self,
        drone: int,
        members: tuple[int, ...],
        layout: Layout,
        *,
        frame_identity: int,
        incarnation: int,
        lost_after_s: float,
        tick_s: float,
    ) -> None:
        self._drone = drone
        self._layout = layout
        self._incarnation = incarnation
        self._lost_after_s = lost_after_s
        self._admission = Admission(members, frame_identity, drone)
        self._peers = Peers(drone)
        self._tree = SwarmTree(
            drone,
            members,
            layout,
            frame_identity=frame_identity,
            incarnation=incarnation,
            lost_after_s=lost_after_s,
        )
        self._announcements = Announcements(drone, incarnation, frame_identity, tick_s)
        self._twin: DroneState | None = None
        self._twin_s = -math.inf

    def step(
        self,
        now_s: float,
        received: Iterable[Received],
        decision: Decision | None,
        position_ned_m: Vector3 | None,
    ) -> SwarmView:
        """Hear what came. `decision` is this drone's own of the tick before, `position_ned_m` where it is now."""
        commands: list[Command] = []
        trees: list[TreeState] = []
        refused: list[Note] = []
        for item in received:
            message = self._admission.admit(item)
            match message:
                case Refusal():
                    if message.fresh:
                        refused.append(Note(Severity.WARNING, "peer", message.text))
                    if message.kind is RefusalKind.TWIN and isinstance(message.message, DroneState):
                        self._twin, self._twin_s = message.message, now_s
                case TreeState():
                    if self._peers.speaks(message.sender, message.incarnation):
                        trees.append(message)
                case Command():
                    commands.append(message)
                case _:
                    self._peers.hear(now_s, message)
        facts = self._peers.facts()
        tree = self._tree
        news = tree.step(now_s, trees, facts, decision, position_ned_m)
        return SwarmView(
            tuple(commands),
            self._peers.neighbours(now_s),
            tree.place(now_s, facts),
            tree.order,
            tree.readings,
            self._slot_ned_m(),
            news.moved and tree.member and not (tree.order is not None and tree.order.apart),
            tree.shut_out,
            now_s - self._twin_s <= TWINS_S,
            self._peers.part(now_s, self._lost_after_s),
            self._peers.ground_heard_s,
            tuple(refused),
            tuple(tree_notes(news, tree.epoch, tree.slots)),
        )

    def begin(self, now_s: float, survey: str, anchor_ned_m: Vector3) -> None:
        """A survey starts, known by the identity of the command that started it: nothing of the one before counts."""
        self._tree.begin(now_s, survey, anchor_ned_m)

    def tell(
        self, now_s: float, notes: Sequence[Note], outcomes: Sequence[CommandOutcome], own: OwnFacts
    ) -> Announced:
        return self._announcements.step(now_s, notes, outcomes, own, self._tree)

    def comes_second(self, ticks: int) -> bool:
        """Whether another agent, running before this one (now in its tick `ticks`), says that it is this drone."""
        twin = self._twin
        return twin is not None and (twin.ticks, twin.incarnation) > (ticks, self._incarnation)

    def _slot_ned_m(self) -> Vector3 | None:
        order, slot = self._tree.order, self._tree.slots.get(self._drone)
        if order is None or slot is None:
            return None
        north_m, east_m = rotated(self._layout.offset_m(slot), order.rotation_rad)
        anchor = order.anchor_ned_m
        return anchor[0] + north_m, anchor[1] + east_m, anchor[2]
