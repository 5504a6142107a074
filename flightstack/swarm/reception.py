"""How much of what is told arrives: what a drone must know to tell a silent peer from a bad radio.

A detector with a fixed patience is either slow or raises false alarms wherever the radio is worse than thought. Here
the patience follows from the loss that is seen, so that false alarms stay as rare as they are at `CALM_LOSS`: the
idea of the accrual failure detector (Hayashibara et al., SRDS 2004) in its simplest form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from flightstack.swarm.peers import PeerFacts

STATE_PERIOD_S: Final = 0.2
"""How often a drone tells its state (`flightstack.swarm.topics.STATE`)."""

CALM_LOSS: Final = 0.15
"""The loss for which the configured patience is meant."""

MOST_PATIENCE: Final = 2.5
"""Times the configured patience: with more than 40 % lost, false alarms are the smaller harm."""

OUTAGE_S: Final = 3.0
"""A longer silence is no loss of single messages: a node or a radio was away."""

_MEMORY: Final = 200.0
"""States over which the loss is averaged, all peers together."""
_REMEMBERED: Final = math.exp(-1.0 / _MEMORY)
"""What is left of the loss known before, after one more."""


class Reception:
    """What one drone has heard of the others' states. `look` once a tick."""

    def __init__(self) -> None:
        self._loss = 0.0
        self._heard_s: dict[int, float] = {}

    @property
    def loss(self) -> float:
        """Share of the others' states that does not arrive here."""
        return self._loss

    @property
    def patience(self) -> float:
        """How many times as long a silence must last as at `CALM_LOSS` to be as improbable."""
        if self._loss <= CALM_LOSS:
            return 1.0
        return min(MOST_PATIENCE, math.log(CALM_LOSS) / math.log(min(self._loss, 0.99)))

    def look(self, peers: Mapping[int, PeerFacts]) -> None:
        known = self._heard_s
        for drone, peer in peers.items():
            heard_s = peer.heard_s
            before_s = known.get(drone)
            if before_s == heard_s:
                continue
            known[drone] = heard_s
            if before_s is not None and heard_s - before_s < OUTAGE_S:
                states = max(1, round((heard_s - before_s) / STATE_PERIOD_S))
                remembered = _REMEMBERED if states == 1 else math.exp(-states / _MEMORY)
                self._loss = remembered * self._loss + (1.0 - remembered) * (states - 1) / states
