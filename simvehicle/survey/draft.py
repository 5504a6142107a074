"""From a survey and addresses to the configurations of all its parts. Pure: no port is reserved, no file written."""

from __future__ import annotations

import itertools
import pathlib
from collections.abc import Iterable, Iterator

import msgspec

from flightstack.config import (
    AutopilotConfig,
    DroneConfig,
    FiltersConfig,
    InstrumentConfig,
    SharedClockConfig,
    SwarmConfig,
    TlsConfig,
)
from flightstack.flight.layers import layers_of
from flightstack.transport.access_rules import common_name
from flightstack.transport.radio_model import RadioModel
from flightstack.transport.shared_radio import SharedRadio
from gcs.keys.roster import AUTHORITY
from gcs.station_config import AlarmLimits, GroundConfig, MavlinkConfig
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.survey.survey_file import GROUND_STATION, Survey, SurveyDrone, known_obstacles
from simvehicle.vehicle.dynamics import DRAG_PER_S
from simvehicle.vehicle.range_finder import RangeFinderConfig

AGENT_START_WALL_S = 60.0
"""How long agents may take to start before the ground station wonders about them."""
VEHICLES = "vehicles"
GROUND = "ground"
LAUNCHER = "launcher"
"""Our name among the nodes of the swarm and among the followers of the clock."""
STATIONS = (GROUND_STATION, LAUNCHER)
"""Who may command: the ground station, and we in its operator's place."""


class DroneAddresses(msgspec.Struct, frozen=True):
    """Where one drone's parts meet."""

    endpoint: str
    """Where its agent listens for the swarm's other nodes, as zenoh writes it: "tcp/HOST:PORT", or "tls/…"."""
    companion: str
    """"HOST:PORT" (UDP) at which its agent hears its autopilot."""
    instruments: tuple[str, ...]
    """"HOST:PORT" (TCP) of each of its instruments, in their order."""


class Addresses(msgspec.Struct, frozen=True):
    """Where the parts of a survey meet."""

    ground_endpoint: str
    """As a drone's."""
    ground_mavlink: str
    """"HOST:PORT" (UDP) at which the ground station hears all vehicles."""
    drones: tuple[DroneAddresses, ...]
    """In the survey's order."""
    directory: pathlib.Path | None = None
    """For the shared clock, the world's record and the recordings; None: nothing is shared or recorded."""
    keys: pathlib.Path | None = None
    """Where each node's keys are, in a directory of its name; None: the swarm's network is not encrypted."""

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Of the ground station and of every drone: one list for everybody, so that each pair has one connection
        (decision 0002)."""
        return (self.ground_endpoint, *(drone.endpoint for drone in self.drones))


class Draft(msgspec.Struct, frozen=True):
    """What each part of a survey is given."""

    fleet: FleetConfig
    drones: tuple[DroneConfig, ...]
    ground: GroundConfig
    radio: SharedRadio | None = None
    """What the nodes hear of each other; None: everything."""
    launcher_tls: TlsConfig | None = None
    """What we show to the others ourselves."""

    @property
    def followers(self) -> tuple[str, ...]:
        """The processes that follow the clock: the first has slot 1."""
        return (GROUND, *(agent_name(drone.drone) for drone in self.drones), LAUNCHER)


def agent_name(drone: int) -> str:
    """Name of a drone's agent among the processes, and of its log."""
    return f"drone-{drone}"


def clock_file(directory: pathlib.Path) -> pathlib.Path:
    return directory / "clock"


def radio_file(directory: pathlib.Path) -> pathlib.Path:
    """Of how good the radio between the nodes is."""
    return directory / "radio.yaml"


def places_file(directory: pathlib.Path) -> pathlib.Path:
    """Of where the nodes are, for their radio."""
    return directory / "places"


def truth_file(directory: pathlib.Path) -> pathlib.Path:
    """Of the world's own record of the flight."""
    return directory / "truth.csv"


def ports_needed(survey: Survey) -> tuple[int, int]:
    """How many TCP and UDP ports `numbered` takes."""
    drones = len(survey.drones)
    return 1 + drones + sum(len(drone.instruments or ()) for drone in survey.drones), 1 + drones


def numbered(
    survey: Survey,
    host: str,
    tcp_ports: Iterable[int],
    udp_ports: Iterable[int],
    directory: pathlib.Path | None = None,
    keys: pathlib.Path | None = None,
) -> Addresses:
    """Addresses on one host, with ports as they come."""
    scheme = "tcp" if keys is None else "tls"
    tcp, udp = (map(f"{host}:{{}}".format, ports) for ports in (tcp_ports, udp_ports))
    ground_endpoint, ground_mavlink = f"{scheme}/{next(tcp)}", next(udp)
    drones = tuple(
        DroneAddresses(f"{scheme}/{next(tcp)}", next(udp), tuple(next(tcp) for _ in drone.instruments or ()))
        for drone in survey.drones
    )
    return Addresses(ground_endpoint, ground_mavlink, drones, directory, keys)


def in_process(survey: Survey) -> Addresses:
    """Addresses for a swarm in one process (`simvehicle.scenario`): they differ, and nobody opens them."""
    return numbered(survey, "127.0.0.1", itertools.count(1), itertools.count(1))


def draft(survey: Survey, addresses: Addresses) -> Draft:
    """The configurations of the vehicles, of every drone's agent and of the ground station."""
    config, directory = survey.config, addresses.directory
    clock = None if directory is None else str(clock_file(directory))
    radio = None if directory is None else _radio(survey, directory)
    radio_path = None if directory is None or radio is None else str(radio_file(directory))
    fleet = FleetConfig(
        origin=config.origin,
        vehicles=tuple(
            _vehicle(drone, own, addresses.ground_mavlink, config.range_finder)
            for drone, own in zip(survey.drones, addresses.drones, strict=True)
        ),
        wind=config.wind,
        plume=config.plume,
        background_co2_ppm=config.background_co2_ppm,
        obstacles=config.obstacles,
        speedup=config.speedup,
        seed=config.seed,
        ready_after_s=config.ready_after_s,
        faults=config.faults,
        clock=clock,
        places=None if radio is None else radio.places,
        truth=None if directory is None else str(truth_file(directory)),
    )
    return Draft(
        fleet,
        tuple(_drones(survey, addresses, clock, radio_path)),
        _ground(survey, addresses, clock, radio_path),
        radio,
        _tls(addresses.keys, LAUNCHER),
    )


def _radio(survey: Survey, directory: pathlib.Path) -> SharedRadio | None:
    config = survey.config
    if config.radio == RadioModel():
        return None
    placed: tuple[int | str, ...] = tuple(drone.id for drone in survey.drones)
    if config.ground_ned_m is not None:
        placed = (*placed, GROUND_STATION)
    places = str(places_file(directory)) if config.radio.places_matter else None
    return SharedRadio(
        model=config.radio, seed=config.seed, places=places, placed=placed if places is not None else ()
    )


def _vehicle(
    drone: SurveyDrone, own: DroneAddresses, ground_mavlink: str, range_finder: RangeFinderConfig | None
) -> VehicleSpec:
    return VehicleSpec(
        id=drone.id,
        flavour=drone.flavour,
        home_north_m=drone.home_north_m,
        home_east_m=drone.home_east_m,
        links=(f"udpout:{own.companion}", f"udpout:{ground_mavlink}"),
        instruments=tuple(
            EmulatedInstrument(name=i.name, type=i.type, port=port)
            for i, port in zip(drone.instruments or (), own.instruments, strict=True)
        ),
        range_finder=range_finder,
        quiet=True,  # a real PX4's unasked streams would cost as much as everything else in a simulated swarm
        parameters=drone.parameters,
    )


def _drones(
    survey: Survey, addresses: Addresses, clock: str | None, radio: str | None
) -> Iterator[DroneConfig]:
    config, directory = survey.config, addresses.directory
    members = tuple(drone.id for drone in survey.drones)
    for index, (drone, own) in enumerate(zip(survey.drones, addresses.drones, strict=True)):
        one = DroneConfig(
            drone=drone.id,
            swarm=SwarmConfig(
                name=config.name,
                members=members,
                listen=(own.endpoint,),
                connect=addresses.endpoints,
                tls=_tls(addresses.keys, common_name(drone.id)),
            ),
            origin=config.origin,
            autopilot=AutopilotConfig(
                link=f"udpin:{own.companion}",
                flavour=drone.flavour,
                parameters=_failsafe_parameters(survey, drone),
            ),
            instruments=tuple(
                InstrumentConfig(name=i.name, type=i.type, port=f"socket://{port}", options=i.options)
                for i, port in zip(drone.instruments or (), own.instruments, strict=True)
            ),
            filters=FiltersConfig(wind={"drag": {"linear_per_s": DRAG_PER_S}}),  # its airframe is known
            formation=config.formation,
            limits=config.limits,
            geofence=survey.geofence,
            obstacles=known_obstacles(config.obstacles),
            strategy=config.strategy,
            seed=config.seed,
            speedup=config.speedup,
            clock=None if clock is None else SharedClockConfig(file=clock, slot=2 + index),
        )
        if directory is not None:
            one = msgspec.structs.replace(one, record_to=str(directory / agent_name(drone.id)), radio=radio)
        yield one


def _ground(survey: Survey, addresses: Addresses, clock: str | None, radio: str | None) -> GroundConfig:
    config, directory = survey.config, addresses.directory
    ground = GroundConfig(
        station=GROUND_STATION,
        swarm=SwarmConfig(
            name=config.name,
            members=tuple(drone.id for drone in survey.drones),
            listen=(addresses.ground_endpoint,),
            connect=addresses.endpoints,
            tls=_tls(addresses.keys, GROUND_STATION),
        ),
        origin=config.origin,
        mavlink=MavlinkConfig(links=(f"udpin:{addresses.ground_mavlink}",)),
        geofence=survey.geofence,
        alarms=AlarmLimits(
            ceiling_above_home_m=config.limits.ceiling_above_home_m,
            # Starting the agents takes the machine's time, which is short in simulated time.
            absent_s=AGENT_START_WALL_S * config.speedup,
        ),
        clock=None if clock is None else SharedClockConfig(file=clock, slot=1),
        speedup=config.speedup,
    )
    if directory is None:
        return ground
    return msgspec.structs.replace(ground, record_to=str(directory), radio=radio)


def _tls(keys: pathlib.Path | None, node: str) -> TlsConfig | None:
    """What the node of this name in its certificate shows to the others, and which stations it listens to."""
    if keys is None:
        return None
    own = keys / node
    return TlsConfig(
        authority=str(own / f"{AUTHORITY}.pem"),
        certificate=str(own / f"{node}.pem"),
        private_key=str(own / f"{node}.key"),
        stations=STATIONS,
    )


def _failsafe_parameters(survey: Survey, drone: SurveyDrone) -> dict[str, float]:
    """What the agent sets on its autopilot for the time when there is no agent any more.

    Each drone returns at an altitude of its own (`flightstack.flight.layers`), also from nearby, and does not wait
    over home; an ArduPilot follows the last velocity for 1 s instead of 3, a PX4 comes home when its agent dies. What
    the survey's file says of them for this drone is taken as meant.
    """
    config, members = survey.config, [one.id for one in survey.drones]
    above_home_m = layers_of(drone.id, members, config.formation, config.limits).autopilot_above_home_m
    if drone.flavour == "ardupilot":
        centimetres = round(above_home_m * 100.0)
        set_so = {"RTL_ALT": centimetres, "RTL_CONE_SLOPE": 0.0, "RTL_LOIT_TIME": 0.0, "GUID_TIMEOUT": 1.0}
    else:
        set_so = {"RTL_RETURN_ALT": above_home_m, "RTL_DESCEND_ALT": above_home_m}
        set_so |= {"RTL_CONE_ANG": 0.0, "COM_OBL_RC_ACT": 3.0}
    return set_so | {name: value for name, value in drone.parameters.items() if name in set_so}
