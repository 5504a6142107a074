"""The one table of what goes over the air: key, type, rate, staleness, delivery."""

from __future__ import annotations

import dataclasses
import enum
from typing import Any, NamedTuple

from flightstack.swarm.wire import (
    Codec,
    Command,
    CommandOutcome,
    DroneState,
    Event,
    GroundBeat,
    GroundReport,
    OrderState,
    ReadingsState,
    TableState,
    Traffic,
)


class Delivery(enum.Enum):
    BEST_EFFORT = "best_effort"
    """Newest wins, dropped under congestion: one slow receiver never holds up the others."""
    RELIABLE = "reliable"


@dataclasses.dataclass(frozen=True)
class Topic:
    name: str
    codec: Codec[Any]
    rate_hz: float | None
    """How often it is sent; None: when there is something to say."""
    stale_s: float | None
    """How old its newest message may be before a receiver acts on the silence."""
    delivery: Delivery

    def key(self, swarm: str, sender: int | str) -> str:
        """zenoh key expression of this topic from one sender; sender "*" matches all."""
        return f"flightstack/{swarm}/{self.name}/{sender}"


class Received(NamedTuple):
    """A message as it came, its payload not yet read."""

    topic: Topic
    sender: str
    """Last part of the key: a drone's id, or a ground station's name."""
    payload: bytes


STATE = Topic("state", Codec(DroneState), 5.0, 2.0, Delivery.BEST_EFFORT)
TABLE = Topic("table", Codec(TableState), 0.2, 30.0, Delivery.BEST_EFFORT)
"""At least at its rate; five times a second while tables differ (`flightstack.swarm.exchange`)."""
ORDER = Topic("order", Codec(OrderState), 0.2, 30.0, Delivery.BEST_EFFORT)
"""As the table, while orders differ."""
READINGS = Topic("readings", Codec(ReadingsState), 5.0, 2.0, Delivery.BEST_EFFORT)
"""At its rate while readings come up, else never (`flightstack.swarm.reading_relay`)."""
COMMAND = Topic("command", Codec(Command), None, None, Delivery.RELIABLE)
OUTCOME = Topic("outcome", Codec(CommandOutcome), None, None, Delivery.RELIABLE)
EVENT = Topic("event", Codec(Event), None, None, Delivery.RELIABLE)
TRAFFIC = Topic("traffic", Codec(Traffic), 4.0, 2.0, Delivery.BEST_EFFORT)
GROUND = Topic("ground", Codec(GroundBeat), 1.0, 5.0, Delivery.BEST_EFFORT)
REPORT = Topic("report", Codec(GroundReport), 1.0, 5.0, Delivery.BEST_EFFORT)

TOPICS: dict[str, Topic] = {
    t.name: t for t in (STATE, TABLE, ORDER, READINGS, COMMAND, OUTCOME, EVENT, TRAFFIC, GROUND, REPORT)
}

RECEIVED_BY_DRONES = (STATE, TABLE, ORDER, READINGS, COMMAND, TRAFFIC, GROUND)
