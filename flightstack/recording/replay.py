"""A recorded flight, flown again by the decision code: the same inputs must give the same outputs."""

from __future__ import annotations

import logging
import pathlib
from typing import Any

import msgspec

from flightstack.agent import Agent, Inputs
from flightstack.config import DroneConfig
from flightstack.errors import FlightstackError
from flightstack.recording.fingerprint import fingerprint
from flightstack.recording.recorder import GAP, Record, read_recording, restore
from flightstack.swarm.wire import VERSION

log = logging.getLogger(__name__)


class ReplayError(FlightstackError):
    """The file is not a whole recording of an agent."""


class Replay(msgspec.Struct, frozen=True):
    ticks: int
    differing: int
    first_difference_s: float | None
    """The agent's time at the first tick whose outputs differ from the recorded ones."""


def replay(path: pathlib.Path) -> Replay:
    """Give a new agent the inputs recorded in `path` and compare what it sends with what was sent then."""
    agent: Agent | None = None
    ticks = differing = 0
    first_s: float | None = None
    now: int | None = None
    for record in read_recording(path):
        if record.topic == "/config":
            agent = _agent(path, record.message)
        elif agent is None:
            raise ReplayError(f"{path}: the recording does not begin with the drone's configuration")
        elif record.topic == GAP:
            log.warning("%s: the disk took nothing for a while; what comes after cannot be flown again", path)
            break
        elif record.topic == "/inputs":
            outputs = agent.step(record.time_s, _inputs(path, record))
            now = fingerprint(outputs)
        elif record.topic == "/outputs" and now is not None:
            ticks += 1
            if record.message["crc32"] != now:
                differing += 1
                first_s = record.time_s if first_s is None else first_s
    if ticks == 0:
        raise ReplayError(f"{path}: no recorded ticks; was it made by `flightstack run`?")
    return Replay(ticks, differing, first_s)


def _agent(path: pathlib.Path, message: dict[str, Any]) -> Agent:
    """A new agent as it was configured then."""
    spoken = message.get("wire")
    if "config" in message and spoken != VERSION:
        then = f"of version {spoken}" if spoken is not None else "older than version 3"
        raise ReplayError(
            f"{path}: was recorded with messages {then}, which this software (version {VERSION}) does not answer "
            "as that one did: replay it with the software that recorded it"
        )
    try:
        config = restore(message["config"], DroneConfig)
        return Agent(config, incarnation=msgspec.convert(message["incarnation"], int))
    except (KeyError, ValueError, TypeError, msgspec.ValidationError) as error:
        raise ReplayError(
            f"{path}: holds no drone's configuration that this version understands; "
            "was it made by `flightstack run`?"
        ) from error


def _inputs(path: pathlib.Path, record: Record) -> Inputs:
    try:
        return restore(record.message, Inputs)
    except (ValueError, TypeError, msgspec.ValidationError) as error:
        raise ReplayError(
            f"{path}: the inputs at {record.time_s:.3f} s are not an agent's: {error}"
        ) from error
