"""Reading a drone's file, and what cannot be flown although every value is of its type."""

from __future__ import annotations

import logging
import pathlib
from collections.abc import Iterator

import msgspec

from flightstack.config import DroneConfig, FormationConfig, LimitsConfig
from flightstack.flight.guard import SEPARATION_MARGIN_M
from flightstack.flight.guidance import heir_below_m
from flightstack.flight.layers import highest_agent_m, layer_cautions
from flightstack.limit_checks import formation_problems, limit_problems, name_problems, parameter_problems
from flightstack.mavlink.link import LinkError, check_link
from flightstack.mavlink.signing_store import SigningKeyError, read_key
from flightstack.obstacle_checks import obstacle_cautions, obstacle_problems
from flightstack.sensing.filter_stage import co2_settings, wind_settings
from flightstack.transport.access_rules import access_problems
from flightstack.transport.certificates import beside, check_files
from flightstack.transport.claims import Claim, clashes, endpoint_claim, link_claim, port_claim
from flightstack.transport.endpoints import endpoint_problems
from flightstack.transport.shared_radio import radio_problems
from mission.documents.fence_section import FenceChoice, read_section
from mission.documents.yaml_file import DocumentError, line_of, parse, read_text
from mission.geometry.formation import make_layout
from mission.geometry.frames import LocalFrame
from mission.geometry.geofence import LocalFence
from mission.strategies.registry import make
from sensors.instruments.registry import make_instrument
from sensors.instruments.sensor_error import SensorError
from sensors.serial.port import check_port

log = logging.getLogger("flightstack.config")

FASTEST = 100.0
"""Largest speed-up; `flightstack.recording.clock` refuses more."""


class _DroneFile(DroneConfig, frozen=True, kw_only=True):
    geofence: FenceChoice = None  # type: ignore[assignment]  # until it is read: areas, or a file's name


def load(path: str | pathlib.Path) -> DroneConfig:
    """Read and check a drone's file. `DocumentError` says in one line what is wrong and how to mend it."""
    file, text = str(path), read_text(path)
    written = parse(text, _DroneFile, file)
    fence, warnings = read_section(written.geofence, file, text)
    for warning in warnings:
        log.warning("%s", warning)
    directory = pathlib.Path(path).parent
    swarm, autopilot = beside(written.swarm, directory), written.autopilot
    if autopilot.signing_key is not None:
        key = str(directory / autopilot.signing_key)
        autopilot = msgspec.structs.replace(autopilot, signing_key=key)
    parts = {"geofence": fence, "swarm": swarm, "autopilot": autopilot}
    config = DroneConfig(**msgspec.structs.asdict(written) | parts)
    for field, problem in problems(config):
        raise DocumentError(file, problem, line=line_of(text, field), field=field)
    for problem in check_files(config.swarm, config.drone):
        raise DocumentError(file, problem, line=line_of(text, "swarm.tls"), field="swarm.tls")
    if config.autopilot.signing_key is not None:
        try:
            read_key(pathlib.Path(config.autopilot.signing_key))
        except SigningKeyError as error:
            field = "autopilot.signing_key"
            raise DocumentError(file, str(error), line=line_of(text, field), field=field) from error
    for field, caution in cautions(config):
        log.warning("%s", DocumentError(file, caution, line=line_of(text, field), field=field))
    return config


def problems(config: DroneConfig) -> Iterator[tuple[str, str]]:
    """What cannot be flown although every value is of its type: (field, what is wrong and how to mend it)."""
    members, limits, formation = config.swarm.members, config.limits, config.formation
    if config.drone not in members:
        yield "drone", f"drone {config.drone} is not in swarm.members {list(members)}"
    if len(set(members)) != len(members):
        yield "swarm.members", "a drone's id stands twice; every drone needs its own"
    yield from name_problems(config)
    yield from _plain_numbers(config)
    yield from limit_problems(limits)
    yield from formation_problems(formation)
    yield from parameter_problems(config.autopilot, limits, config.drone)
    yield from _altitudes(formation, limits, len(members))
    layout = make_layout(formation.layout, formation.spacing_m)
    for problem in layout.problems(len(members), limits.separation_m, formation.radio_range_m):
        yield "formation", problem
    yield from access_problems(config.swarm)
    yield from radio_problems(config.radio, config.clock)
    yield from _fence(config)
    yield from obstacle_problems(config)
    try:
        make(config.strategy.name, layout=layout, **config.strategy.parameters)
    except (TypeError, ValueError) as error:
        yield "strategy", str(error)
    yield from _connections(config)
    yield from _filters(config)
    for index, instrument in enumerate(config.instruments):
        field = f"instruments[{index}]"
        if any(instrument.name == other.name for other in config.instruments[:index]):
            yield f"{field}.name", f"two instruments are called {instrument.name}"
        try:
            make_instrument(instrument.type, instrument.name, instrument.options)
        except SensorError as error:
            yield f"{field}.type", str(error)
            continue
        if instrument.port == "mavlink":
            continue
        try:
            check_port(instrument.port, 9600 if instrument.baud is None else instrument.baud)
        except SensorError as error:
            yield f"{field}.port", str(error)
    yield from clashes(_claims(config))


def cautions(config: DroneConfig) -> Iterator[tuple[str, str]]:
    """What can be flown and promises less than it could: (field, what, and how to mend it)."""
    members, parameters = config.swarm.members, config.autopilot.parameters
    yield from layer_cautions(config.drone, members, config.formation, config.limits, parameters)
    yield from obstacle_cautions(config)


def _claims(config: DroneConfig) -> Iterator[Claim]:
    yield from link_claim("autopilot.link", config.autopilot.link)
    for index, endpoint in enumerate(config.swarm.listen):
        yield from endpoint_claim(f"swarm.listen[{index}]", endpoint)
    for index, instrument in enumerate(config.instruments):
        yield from port_claim(f"instruments[{index}].port", instrument.port)


def _filters(config: DroneConfig) -> Iterator[tuple[str, str]]:
    for field, settings in (
        ("filters.co2", lambda: co2_settings((), config.filters)),
        ("filters.wind", lambda: wind_settings(config.filters)),
    ):
        try:
            settings()
        except SensorError as error:
            yield field, str(error).removeprefix(f"{field}: ")


def _plain_numbers(config: DroneConfig) -> Iterator[tuple[str, str]]:
    if not 0 <= config.seed < 1 << 63:
        yield "seed", f"{config.seed} is not within 0 to {(1 << 63) - 1}"
    if config.speedup > FASTEST:
        yield "speedup", f"{config.speedup:g} is not within 0 to {FASTEST:g}"
    if not 4.0 <= config.tick_hz <= 100.0:
        yield "tick_hz", f"{config.tick_hz:g} is not within 4 to 100; 10 is usual"
    if not -500.0 <= config.origin.amsl_m <= 9000.0:
        yield "origin.amsl_m", f"{config.origin.amsl_m:g} m above the sea is nowhere that a drone flies"
    if not config.record_to:
        yield "record_to", "names no directory"


def _altitudes(formation: FormationConfig, limits: LimitsConfig, drones: int) -> Iterator[tuple[str, str]]:
    floor_m, ceiling_m = limits.floor_above_home_m, limits.ceiling_above_home_m
    if floor_m >= ceiling_m:
        yield "limits.floor_above_home_m", "the floor is not below the ceiling"
    if not floor_m < formation.above_home_m < ceiling_m:
        yield (
            "formation.above_home_m",
            f"{formation.above_home_m:g} m is not between the floor ({floor_m:g} m) "
            f"and the ceiling ({ceiling_m:g} m) of limits",
        )
    lowest_m = floor_m + heir_below_m(limits)
    if drones > 1 and formation.above_home_m < lowest_m:
        yield (
            "formation.above_home_m",
            f"below {formation.above_home_m:g} m there is no room over limits.floor_above_home_m = "
            f"{floor_m:g} m for an heir to pass under the others; fly {lowest_m:g} m high or higher",
        )
    if drones > 1 and formation.layer_gap_m < limits.separation_m + SEPARATION_MARGIN_M:
        yield (
            "formation.layer_gap_m",
            f"{formation.layer_gap_m:g} m between layers is less than limits.separation_m = "
            f"{limits.separation_m:g} m and {SEPARATION_MARGIN_M:g} m for errors of the altitude; drones crossing "
            "in two layers would come too near",
        )
    top_m = highest_agent_m(drones, formation)
    if top_m > ceiling_m:
        layers = drones if formation.layers is None else min(drones, formation.layers)
        yield (
            "formation.layer_gap_m",
            f"the highest of {layers} layers is at {top_m:g} m, above limits.ceiling_above_home_m",
        )


def _fence(config: DroneConfig) -> Iterator[tuple[str, str]]:
    if config.geofence is None:
        return
    fence_problems = config.geofence.problems()
    if fence_problems:
        yield from (("geofence", problem) for problem in fence_problems)
        return
    # The swarm forms up over the origin: a fence without it is a fence that nothing can be flown in.
    clearance_m = LocalFence(LocalFrame(config.origin), config.geofence).clearance_m(0.0, 0.0)
    if clearance_m < config.limits.fence_margin_m:
        where = (
            f"{-clearance_m:.0f} m outside the geofence"
            if clearance_m < 0.0
            else f"{clearance_m:.1f} m from the geofence, less than limits.fence_margin_m"
        )
        yield "origin", f"the swarm forms up over it, and it is {where}; move it or widen the fence"


def _connections(config: DroneConfig) -> Iterator[tuple[str, str]]:
    try:
        check_link(config.autopilot.link)
    except LinkError as error:
        yield "autopilot.link", str(error)
    yield from endpoint_problems(config.swarm)
