"""One drone's agent as its own messages describe it: newest state, table, what it flew, how it keeps time."""

from __future__ import annotations

import math
from collections import deque

from flightstack.swarm.incarnations import FLYING_PHASES, Incarnations
from flightstack.swarm.wire import DroneState, Phase, TableState

TICK_WINDOW_S = 10.0
"""Late ticks are counted over this long."""


class HeardAgent:
    """One drone's agent, from its own messages."""

    def __init__(self, drone: int) -> None:
        self.drone = drone
        self.state: DroneState | None = None
        self.state_s: float | None = None
        self.table: TableState | None = None
        self.table_s: float | None = None
        self.incarnations = Incarnations()
        self.flown = False
        """The agent had its vehicle in the air, or sent it there, and it has not been seen disarmed since."""
        self.last_flying_s: float | None = None
        """When the agent last said so, and in which phase."""
        self.last_flying_phase: Phase | None = None
        self._flying_incarnation: int | None = None
        self._ticks: deque[tuple[float, int, int]] = deque()

    def age_s(self, now_s: float) -> float:
        return math.inf if self.state_s is None else now_s - self.state_s

    def receive_state(self, now_s: float, state: DroneState) -> bool:
        """Take a state; False for one that is older than what is known, and for a twin's."""
        before = self.state
        if not self.incarnations.hear(now_s, state):
            return False
        if before is None or state.incarnation != before.incarnation:
            self._ticks.clear()
        self.state, self.state_s = state, now_s
        if state.phase in FLYING_PHASES and (state.airborne or state.phase is Phase.TAKEOFF):
            self.flown, self.last_flying_s, self.last_flying_phase = True, now_s, state.phase
            self._flying_incarnation = state.incarnation
        elif not state.armed and state.position_ned_m is not None:
            # A restarted agent says "not armed" until its autopilot has answered; a position shows that it has.
            self.flown = False
        if not self._ticks or now_s - self._ticks[-1][0] >= 1.0:
            self._ticks.append((now_s, state.ticks, state.late_ticks))
        while self._ticks and now_s - self._ticks[0][0] > TICK_WINDOW_S:
            self._ticks.popleft()
        return True

    def has_its_vehicle(self) -> bool:
        """Whether the agent that speaks now knows what becomes of the vehicle in the air: it flies it, or it gave
        it to the pilot. One that was restarted in the air knows of nothing."""
        if self.state is None or self.state.phase in (Phase.DISARMED, Phase.LANDED):
            return False
        return self.state.phase in FLYING_PHASES or self.state.incarnation == self._flying_incarnation

    def late_fraction(self) -> float:
        """Share of the agent's ticks of the last `TICK_WINDOW_S` that missed their deadline."""
        if len(self._ticks) < 2:
            return 0.0
        ticks = self._ticks[-1][1] - self._ticks[0][1]
        late = self._ticks[-1][2] - self._ticks[0][2]
        return late / ticks if ticks > 0 and late > 0 else 0.0
