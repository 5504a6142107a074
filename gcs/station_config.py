"""The ground station's configuration file, typed. It shares its vocabulary with the drones' files."""

from __future__ import annotations

import logging
import pathlib
from collections.abc import Iterator
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from flightstack.config import (
    Fraction,
    NodeName,
    NotNegative,
    Positive,
    Section,
    SharedClockConfig,
    SwarmConfig,
)
from flightstack.mavlink.link import LinkError, check_link
from flightstack.mavlink.signing_store import SigningKeyError, read_key
from flightstack.transport.access_rules import access_problems
from flightstack.transport.certificates import beside, check_files
from flightstack.transport.claims import Claim, clashes, endpoint_claim, link_claim
from flightstack.transport.endpoints import endpoint_problems
from flightstack.transport.shared_radio import radio_problems
from mission.documents.fence_section import FenceChoice, read_section
from mission.documents.yaml_file import DocumentError, line_of, parse, read_text
from mission.geometry.frames import Geodetic
from mission.geometry.geofence import Geofence

log = logging.getLogger("gcs.station_config")


class MavlinkConfig(Section, frozen=True, kw_only=True):
    links: tuple[str, ...] = ()
    """As pymavlink writes them: "udpin:0.0.0.0:14550", "tcp:127.0.0.1:5760", "/dev/ttyUSB0,57600". All
    vehicles may share one; a vehicle heard on several is one vehicle."""
    signing_key: str | None = None
    """File with the key that MAVLink is signed with on all links, its path relative to this file's directory. None:
    nothing is signed, and everything is believed."""
    system: Annotated[int, Meta(ge=1, le=255)] = 255
    """Our own system id. Two ground stations that hear the same vehicles need different ones."""


class OrphanConfig(Section, frozen=True, kw_only=True):
    """What to do with a vehicle that flies on while its agent is silent."""

    action: Literal["rtl", "land", "none"] = "rtl"
    grace_s: Positive = 5.0
    """Silence of the agent after which its vehicle is brought home by MAVLink."""
    all_silent_grace_s: Positive = 30.0
    """The same when every agent fell silent: more likely our own radio failed than all of them at once, and
    an autopilot that is taken from a healthy agent ends a survey."""
    apart_m: Positive = 5.0
    """How near two may come on their ways home: the drones' `limits.separation_m` and a metre. One that would come
    nearer to another waits for it."""
    longest_wait_s: Positive = 300.0
    """So long a vehicle waits at most for all others together: its battery does not last."""


class AlarmLimits(Section, frozen=True, kw_only=True):
    """When the failure monitor speaks."""

    agent_silent_s: Positive = 3.0
    vehicle_silent_s: Positive = 5.0
    """Five missed heartbeats."""
    absent_s: Positive = 20.0
    """How long after the station's start a member may stay unheard: agents take their time to start."""
    battery_low_fraction: Fraction = 0.3
    battery_critical_fraction: Fraction = 0.15
    late_ticks_fraction: Fraction = 0.05
    """Share of an agent's newest ticks that may miss their deadline."""
    ceiling_above_home_m: Positive | None = None
    fence_tolerance_m: NotNegative = 1.0
    """How far inside a drone must be again before a fence alarm ends."""


class GroundConfig(Section, frozen=True, kw_only=True):
    station: NodeName = "ground"
    """Name of this ground station among the nodes of the swarm."""
    swarm: SwarmConfig
    origin: Geodetic
    """Origin of the swarm's local frame, the same as in the drones' files."""
    mavlink: MavlinkConfig = MavlinkConfig()
    geofence: Geofence | None = None
    """The fence that breaches are watched against; in a file also `file`, as in the drones' files; or `plan`."""
    plan: str | None = None
    """A .plan or other file whose geofence is watched, its path relative to this file's directory."""
    orphans: OrphanConfig = OrphanConfig()
    alarms: AlarmLimits = AlarmLimits()
    record_to: str = "flights"
    """Directory for the recordings (swarm-TIME.mcap, vehicle-N-TIME.tlog), made if absent."""
    speedup: Positive = 1.0
    """1 in real flights. Simulated flights may run faster; all processes must be given the same."""
    clock: SharedClockConfig | None = None
    """Simulated flights only: the time that all their processes share, instead of each one's own."""
    radio: str | None = None
    """Simulated flights only, as in the drones' files."""
    tick_hz: Positive = 10.0


class _GroundFile(GroundConfig, frozen=True, kw_only=True):
    geofence: FenceChoice = None  # type: ignore[assignment]  # until it is read: areas, or a file's name


def load(path: str | pathlib.Path) -> GroundConfig:
    """Read and check a ground station's file. `DocumentError` says in one line what is wrong where."""
    file, text = str(path), read_text(path)
    written = parse(text, _GroundFile, file)
    fence, warnings = read_section(written.geofence, file, text)
    for warning in warnings:
        log.warning("%s", warning)
    directory = pathlib.Path(path).parent
    swarm, mavlink = beside(written.swarm, directory), written.mavlink
    if mavlink.signing_key is not None:
        mavlink = msgspec.structs.replace(mavlink, signing_key=str(directory / mavlink.signing_key))
    parts = {"geofence": fence, "swarm": swarm, "mavlink": mavlink}
    config = GroundConfig(**msgspec.structs.asdict(written) | parts)
    for field, problem in problems(config):
        raise DocumentError(file, problem, line=line_of(text, field), field=field)
    for problem in check_files(config.swarm, config.station):
        raise DocumentError(file, problem, line=line_of(text, "swarm.tls"), field="swarm.tls")
    if config.mavlink.signing_key is not None:
        try:
            read_key(pathlib.Path(config.mavlink.signing_key))
        except SigningKeyError as error:
            field = "mavlink.signing_key"
            raise DocumentError(file, str(error), line=line_of(text, field), field=field) from error
    return config


def problems(config: GroundConfig) -> Iterator[tuple[str, str]]:
    """What cannot be although every value is of its type: (field, what is wrong and how to mend it)."""
    members, mavlink, alarms = config.swarm.members, config.mavlink, config.alarms
    if len(set(members)) != len(members):
        yield "swarm.members", "a drone's id stands twice; every drone needs its own"
    if mavlink.system in members:
        problem = f"{mavlink.system} is also a drone's system id; 255 is the usual one of a ground station"
        yield "mavlink.system", problem
    for index, link in enumerate(mavlink.links):
        try:
            check_link(link)
        except LinkError as error:
            yield f"mavlink.links[{index}]", str(error)
    yield from endpoint_problems(config.swarm)
    yield from access_problems(config.swarm)
    if config.swarm.tls is not None and config.station not in config.swarm.tls.stations:
        yield "station", f"{config.station} is not in swarm.tls.stations, so no drone listens to it"
    yield from clashes(_claims(config))
    if config.geofence is not None and config.plan is not None:
        yield "plan", "give either geofence or plan, not both"
    if alarms.battery_critical_fraction > alarms.battery_low_fraction:
        yield "alarms.battery_critical_fraction", "it is above battery_low_fraction"
    if config.speedup > 100.0:
        yield "speedup", f"{config.speedup:g} is not within 0 to 100"
    yield from radio_problems(config.radio, config.clock)
    if config.tick_hz < 4.0:
        yield "tick_hz", f"{config.tick_hz:g} is too slow for what is sent 4 times a second; 10 is usual"


def _claims(config: GroundConfig) -> Iterator[Claim]:
    for index, link in enumerate(config.mavlink.links):
        yield from link_claim(f"mavlink.links[{index}]", link)
    for index, endpoint in enumerate(config.swarm.listen):
        yield from endpoint_claim(f"swarm.listen[{index}]", endpoint)
