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
from flightstack.swarm.swarm_table import SwarmTable
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import (
    TAKING_PART,
    Command,
    CommandOutcome,
    DroneState,
    OrderState,
    Phase,
    ReadingsState,
    Severity,
    TableState,
)
from mission.estimation.estimates import Reading
from mission.geometry.formation import Layout, rotated
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, Neighbour, Order, TreePlace


class SwarmView(msgspec.Struct, frozen=True):
    """The swarm in one tick, as this drone knows it."""

    commands: tuple[Command, ...]
    neighbours: tuple[Neighbour, ...]
    place: TreePlace
    """`slot` is -1 while this drone holds none. `healing` does not yet tell whether this drone itself is
    on its way to a new slot."""
    order: Order | None
    readings: tuple[Reading, ...]
    slot_ned_m: Vector3 | None
    """Where this drone's slot is now, by the newest order."""
    moved: bool
    """This drone has claimed another slot in this tick."""
    has_twin: bool
    """Another agent says, now, that it is this drone."""
    part: Part
    handed_over: bool
    """This drone has announced that it leaves, and its heir has claimed its slot."""
    flies_on: bool
    """Others that take part in a survey, in the air, have been heard for a while without a gap."""
    ground_heard_s: float | None
    refused: tuple[Note, ...]
    """Messages that were not believed, each kind once."""
    news: tuple[Note, ...]
    """What changed in the table."""


_GETTING_UP = frozenset({Phase.ARMING, Phase.TAKEOFF})
"""The phases in which a drone takes part, and waits for a slot until it is up where it was counted out."""


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
        suspect_after_s: float,
        lost_after_s: float,
        tick_s: float,
    ) -> None:
        """`suspect_after_s`: silence after which a single peer is missed; `lost_after_s`: after which several that
        are silent at once mean that the swarm has come apart."""
        self._drone = drone
        self._layout = layout
        self._incarnation = incarnation
        self._lost_after_s = lost_after_s
        self._admission = Admission(members, frame_identity, drone, incarnation)
        self._peers = Peers(drone)
        self._table = SwarmTable(
            drone,
            members,
            layout,
            frame_identity=frame_identity,
            incarnation=incarnation,
            suspect_after_s=suspect_after_s,
        )
        self._announcements = Announcements(drone, incarnation, frame_identity, tick_s)
        self._twin: DroneState | None = None
        self._twin_s = -math.inf
        self._stepped_s: float | None = None
        self._awake_s = -math.inf
        """When this program last went on after it had stood still."""

    def step(
        self,
        now_s: float,
        received: Iterable[Received],
        phase: Phase,
        decision: Decision | None,
        position_ned_m: Vector3 | None,
    ) -> SwarmView:
        """Hear what came. `phase` and `decision` are this drone's own of the tick before, `position_ned_m` is where
        it is now."""
        if self._stepped_s is not None and now_s - self._stepped_s > self._lost_after_s:
            self._awake_s = now_s
        self._stepped_s = now_s
        commands: list[Command] = []
        told: list[TableState | OrderState | ReadingsState] = []
        refused: list[Note] = []
        for item in received:
            message = self._admission.admit(item)
            match message:
                case Refusal():
                    if message.fresh:
                        refused.append(Note(Severity.WARNING, "peer", message.text))
                    if message.kind is RefusalKind.TWIN and isinstance(message.message, DroneState):
                        self._twin, self._twin_s = message.message, now_s
                case TableState() | OrderState() | ReadingsState():
                    if self._peers.speaks(message.sender, message.incarnation):
                        told.append(message)
                        self._peers.hear(now_s, message)
                case Command():
                    commands.append(message)
                case _:
                    self._peers.hear(now_s, message)
        facts = self._peers.facts()
        table = self._table
        self._announce(phase)
        news = table.step(now_s, told, facts, decision, position_ned_m)
        return SwarmView(
            tuple(commands),
            self._peers.neighbours(now_s),
            table.place(now_s),
            table.order,
            table.readings,
            self._slot_ned_m(),
            news.moved and not (table.order is not None and table.order.apart),
            now_s - self._twin_s <= TWINS_S,
            self._part(now_s),
            table.has_handed_over(now_s),
            self._peers.flies_on(now_s),
            self._peers.ground_heard_s,
            tuple(refused),
            tuple(tree_notes(news, table.slots)),
        )

    def _part(self, now_s: float) -> Part:
        """Of those whom it could not hear because it stood still, this drone cannot say that they fell silent."""
        if now_s - self._awake_s <= self._lost_after_s:
            return Part.WHOLE
        return self._peers.part(now_s, self._lost_after_s)

    def _announce(self, phase: Phase) -> None:
        """Tell the table whether this drone takes part. That everybody leaves when a survey is over is no news."""
        table = self._table
        if table.survey is None or table.is_over:
            return
        if phase not in TAKING_PART:
            table.leave()
        elif phase not in _GETTING_UP:
            table.rejoin()

    def begin(self, now_s: float, survey: str, anchor_ned_m: Vector3) -> None:
        """A survey starts, known by the identity of the command that started it: nothing of the one before counts."""
        self._table.begin(now_s, survey, anchor_ned_m)

    def tell(
        self, now_s: float, notes: Sequence[Note], outcomes: Sequence[CommandOutcome], own: OwnFacts
    ) -> Announced:
        return self._announcements.step(now_s, notes, outcomes, own, self._table, self._peers.facts())

    def comes_second(self, ticks: int) -> bool:
        """Whether another agent, running before this one (now in its tick `ticks`), says that it is this drone."""
        twin = self._twin
        return twin is not None and (twin.ticks, twin.incarnation) > (ticks, self._incarnation)

    def _slot_ned_m(self) -> Vector3 | None:
        order, slot = self._table.order, self._table.slots.get(self._drone)
        if order is None or slot is None:
            return None
        north_m, east_m = rotated(self._layout.offset_m(slot), order.rotation_rad)
        anchor = order.anchor_ned_m
        return anchor[0] + north_m, anchor[1] + east_m, anchor[2]
