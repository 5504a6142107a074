"""What a drone's part in the swarm makes of its flight: it searches, tracks, leaves, goes home, comes back.

Who leaves by itself announces it and hovers in its slot until its heir has claimed that, so that the others need not
find out; but not for long, and not where the battery does not last. Who goes home only because it was cut off from
the others turns back when it hears them again. Who finds its slot given away takes the next that is free.
"""

from __future__ import annotations

from typing import Final

import msgspec

from flightstack.flight.facts import SwarmFacts
from flightstack.flight.transitions import HANDS_OVER, IN_FORMATION, FlightEvent
from flightstack.swarm.wire import TAKING_PART, Phase, Severity
from mission.strategies.contract import Stage

SLOTLESS_S: Final = 1.0
"""How long a drone in formation may be without a slot before it counts as put out: two that claim one slot settle it
sooner."""

NO_SLOT_S: Final = 60.0
"""How long one in the air waits for a slot before it goes home."""

HAND_OVER_S: Final = 20.0
"""How long one that leaves waits for its heir: in a swarm that works it takes a second or two."""

_OVER: Final = {
    Stage.FOUND: "the source is found",
    Stage.GIVE_UP: "the survey is given up: no source was found in its area or its time",
}


class Turn(msgspec.Struct, frozen=True):
    """What happens to the drone's flight, and how it is told."""

    event: FlightEvent
    why: str
    severity: Severity = Severity.INFO
    code: str = "phase"


class TakingPart:
    """One drone's part in the survey. `step` once a tick in the phases in which it steers and is no pilot's."""

    def __init__(self) -> None:
        self._phase: Phase | None = None
        self._since_s = 0.0
        """When the present phase was first seen."""
        self._slotless_since_s: float | None = None
        self._may_rejoin = False
        """It goes home only because it was cut off from the swarm."""

    def obey(self) -> None:
        """A command was given: what it asks for is not taken back by what the drone hears."""
        self._may_rejoin = False
        self._slotless_since_s = None

    def step(self, now_s: float, phase: Phase, swarm: SwarmFacts) -> Turn | None:
        if phase is not self._phase:
            if self._phase not in TAKING_PART:
                self._slotless_since_s = None
            self._phase, self._since_s = phase, now_s
        if phase is Phase.RETURNING:
            again = self._may_rejoin and swarm.flies_on and not swarm.must_return
            return Turn(FlightEvent.REJOIN, "it hears the swarm again", code="rejoin") if again else None
        if swarm.member:
            self._slotless_since_s = None
        stage = swarm.order.stage if swarm.order else None
        if swarm.must_return and phase is not Phase.LEAVING:
            return self._leave(phase, swarm)
        if stage in _OVER:
            return self._go_home(Turn(FlightEvent.GO_HOME, _OVER[stage]))
        if phase is Phase.LEAVING:
            return self._hand_over(now_s, swarm)
        if phase is Phase.FORMING and swarm.formed_up:
            event = FlightEvent.TRACK if stage is Stage.TRACK else FlightEvent.SEARCH
            return Turn(event, "in formation")
        if not swarm.member:
            return self._wait_for_a_slot(now_s, phase)
        if phase is Phase.SEARCHING and stage is Stage.TRACK:
            return Turn(FlightEvent.TRACK, "following the plume")
        if phase is Phase.TRACKING and stage is Stage.SEARCH:
            return Turn(FlightEvent.SEARCH, "plume lost")
        return None

    def _leave(self, phase: Phase, swarm: SwarmFacts) -> Turn:
        if phase in HANDS_OVER and swarm.member and not (swarm.parted or swarm.in_haste):
            return Turn(FlightEvent.LEAVE, swarm.must_return, Severity.WARNING, "leaving")
        turn = Turn(FlightEvent.GO_HOME, swarm.must_return, Severity.WARNING, "leaving")
        return self._go_home(turn, may_rejoin=swarm.parted)

    def _hand_over(self, now_s: float, swarm: SwarmFacts) -> Turn | None:
        if swarm.handed_over:
            return self._go_home(Turn(FlightEvent.GO_HOME, "its heir has taken over"))
        if swarm.in_haste or swarm.parted or now_s - self._since_s > HAND_OVER_S:
            return self._go_home(Turn(FlightEvent.GO_HOME, "it waits for its heir no longer"))
        return None

    def _wait_for_a_slot(self, now_s: float, phase: Phase) -> Turn | None:
        if self._slotless_since_s is None:
            self._slotless_since_s = now_s
        elif now_s - self._slotless_since_s > NO_SLOT_S:
            why = f"no slot in the swarm for {NO_SLOT_S:.0f} s"
            return self._go_home(Turn(FlightEvent.GO_HOME, why, Severity.WARNING, "leaving"))
        elif now_s - self._slotless_since_s > SLOTLESS_S and phase in IN_FORMATION:
            why = "its slot was given away, it takes the next free one"
            return Turn(FlightEvent.REJOIN, why, code="rejoin")
        return None

    def _go_home(self, turn: Turn, *, may_rejoin: bool = False) -> Turn:
        self._may_rejoin = may_rejoin
        return turn
