"""A simulated survey as its file says it: SURVEY.yaml, typed and checked before anything is started."""

from __future__ import annotations

import itertools
import math
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from flightstack.config import (
    AutopilotConfig,
    DroneConfig,
    DroneId,
    FormationConfig,
    InstrumentConfig,
    LimitsConfig,
    Positive,
    Section,
    StrategyConfig,
    SwarmConfig,
)
from flightstack.config_file import cautions, problems
from flightstack.flight.guard import SEPARATION_MARGIN_M
from flightstack.obstacle_checks import launch_problem
from flightstack.transport.radio_model import RadioModel
from mission.documents.fence_section import FenceChoice, read_section
from mission.documents.yaml_file import DocumentError, line_of, parse, read_text
from mission.geometry.frames import LocalFrame, Vector3
from mission.geometry.geofence import Geofence, LocalFence
from mission.geometry.known_obstacles import KnownObstacle
from sensors.instruments.sensor_error import SensorError
from simvehicle.autopilot.parameters import Parameters, UnknownParameterError
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FARTHEST_HOME_M
from simvehicle.fleet.fleet_problems import what_does_not_fit
from simvehicle.instruments import make_emulator
from simvehicle.survey.fault_options import fault_option
from simvehicle.vehicle.range_finder import RangeFinderConfig
from simvehicle.world.configured import make_world
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.world_config import GaussianPlume, Obstacle, WorldConfig
from simvehicle.world.world_problems import problems as world_problems
from simvehicle.world.world_problems import shut_in, sources

GROUND_STATION = "ground"
"""The ground station's name among the nodes of the swarm."""
WAY_M = 2.0
"""Width of a way between obstacles that counts as free for a drone."""
Flavour = Literal["ardupilot", "px4"]


class InstrumentChoice(Section, frozen=True, kw_only=True):
    """An instrument that a simulated drone carries; it is emulated byte by byte."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]+$")]
    type: str
    options: dict[str, Any] = msgspec.field(default_factory=dict)
    """What the agent's driver of this type is told."""


class SurveyDrone(Section, frozen=True, kw_only=True):
    id: DroneId
    flavour: Flavour = "ardupilot"
    home_north_m: float = 0.0
    home_east_m: float = 0.0
    instruments: tuple[InstrumentChoice, ...] | None = None
    """None: those of the survey."""
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    """Parameters of its autopilot that differ from the flavour's defaults."""


class LaunchLine(Section, frozen=True, kw_only=True):
    """Drones 1 to `count` in a line: a short way to say where all of them stand."""

    count: Annotated[int, Meta(ge=1, le=250)]
    flavour: Flavour = "ardupilot"
    spacing_m: Positive = 6.0
    north_m: float = 0.0
    """Where the middle of the line is."""
    east_m: float = 0.0
    towards_deg: Annotated[float, Meta(ge=0.0, le=360.0)] = 90.0
    """Bearing of the line, degrees clockwise from north."""

    def drones(self) -> Iterator[SurveyDrone]:
        bearing_rad = math.radians(self.towards_deg)
        for index in range(self.count):
            along_m = (index - (self.count - 1) / 2.0) * self.spacing_m
            yield SurveyDrone(
                id=index + 1,
                flavour=self.flavour,
                home_north_m=round(self.north_m + along_m * math.cos(bearing_rad), 3),
                home_east_m=round(self.east_m + along_m * math.sin(bearing_rad), 3),
            )


class SurveyConfig(WorldConfig, frozen=True, kw_only=True):
    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]+$")]
    """Names the swarm and the output directory."""
    drones: tuple[SurveyDrone, ...] = ()
    launch_line: LaunchLine | None = None
    """Instead of `drones`."""
    instruments: tuple[InstrumentChoice, ...] = (InstrumentChoice(name="co2", type="sba5"),)
    range_finder: RangeFinderConfig | None = None
    """Every drone carries one; None: nobody."""
    formation: FormationConfig = FormationConfig()
    limits: LimitsConfig = LimitsConfig()
    geofence: FenceChoice = None
    strategy: StrategyConfig = StrategyConfig()
    speedup: Annotated[float, Meta(gt=0.0, le=20.0)] = 5.0
    """How many times faster than real time everything runs; a busy machine needs a lower one."""
    time_limit_s: Positive = 1800.0
    """Simulated seconds after the first take-off at which everybody is called home."""
    ready_after_s: Annotated[float, Meta(ge=0.0)] = 41.0
    """How long the simulated autopilots need from power-up until they let themselves be armed."""
    faults: tuple[FaultSpec, ...] = ()
    radio: RadioModel = RadioModel()
    """How good the radio between drones and ground station is."""
    ground_ned_m: Vector3 | None = None
    """Where the ground station's radio stands; None: it reaches everybody."""


class Survey(msgspec.Struct, frozen=True):
    """A survey that passed its checks, with what was resolved on the way."""

    config: SurveyConfig
    drones: tuple[SurveyDrone, ...]
    """Every drone with its own instruments filled in."""
    geofence: Geofence | None
    warnings: tuple[str, ...]


def load(
    path: str | pathlib.Path,
    *,
    speedup: float | None = None,
    seed: int | None = None,
    drones: int | None = None,
    radio_loss: float | None = None,
    extra_faults: tuple[FaultSpec, ...] = (),
) -> Survey:
    """Read and check a survey file; the options are what the command line gives instead or on top.

    `DocumentError` says in one line what is wrong, where, and how to mend it.
    """
    return parse_survey(
        read_text(path),
        str(path),
        speedup=speedup,
        seed=seed,
        drones=drones,
        radio_loss=radio_loss,
        extra_faults=extra_faults,
    )


def parse_survey(
    text: str,
    file: str,
    *,
    speedup: float | None = None,
    seed: int | None = None,
    drones: int | None = None,
    radio_loss: float | None = None,
    extra_faults: tuple[FaultSpec, ...] = (),
) -> Survey:
    """As `load`, from the text; `file` stands in the errors, and a fence's own file is looked for beside it."""
    config = parse(text, SurveyConfig, file)
    if drones is not None and config.drones:
        raise DocumentError(f"--drones {drones}", f"{file} lists its drones; give it a launch_line instead")
    if drones is not None and config.launch_line is not None:
        line = msgspec.structs.replace(config.launch_line, count=drones)
        config = msgspec.structs.replace(config, launch_line=line)
    config = msgspec.structs.replace(
        config,
        speedup=config.speedup if speedup is None else speedup,
        seed=config.seed if seed is None else seed,
        faults=(*config.faults, *extra_faults),
    )
    if radio_loss is not None:
        radio = msgspec.structs.replace(config.radio, loss=radio_loss)
        config = msgspec.structs.replace(config, radio=radio)
    if config.radio.bandwidth_bytes_per_s is not None:
        field = "radio.bandwidth_bytes_per_s"
        problem = "processes of one machine send as much as they like; only scenarios have it"
        raise DocumentError(file, problem, line=line_of(text, field), field=field)
    return check(config, text, file, extra_faults=extra_faults)


def check(config: SurveyConfig, text: str, file: str, *, extra_faults: tuple[FaultSpec, ...] = ()) -> Survey:
    """What was read from `text` as a survey that can be flown; `DocumentError` for one that cannot.

    `extra_faults`: those of `config` that the command line added.
    """
    return _Checks(file, text, config, extra_faults).run()


def known_obstacles(obstacles: Sequence[Obstacle]) -> tuple[KnownObstacle, ...]:
    """What the drones are told of the obstacles of a world."""
    return tuple(
        KnownObstacle(corners_north_east_m=one.outline(), top_above_home_m=one.top_above_home_m)
        for one in obstacles
        if not one.unknown
    )


class _Checks:
    """The checks of one survey, each raising the first problem that it finds."""

    def __init__(
        self, file: str, text: str, config: SurveyConfig, extra_faults: tuple[FaultSpec, ...]
    ) -> None:
        """`extra_faults`: those of `config` that the command line added."""
        self._file = file
        self._text = text
        self._config = config
        self._extra_faults = extra_faults
        self._frame = LocalFrame(config.origin)
        self._warnings: list[str] = []

    def run(self) -> Survey:
        drones = self._drones()
        self._launch_points(drones)
        for field, problem in world_problems(self._config):
            raise self._fail(field, problem)
        fence = self._geofence()
        self._in_the_fence(drones, fence)
        self._between_obstacles(drones, fence)
        self._as_agents_see_it(drones, fence)
        self._emulated(drones)
        self._plume()
        self._faults(drones)
        self._radio(drones)
        return Survey(self._config, drones, fence, tuple(self._warnings))

    def _as_agents_see_it(self, drones: tuple[SurveyDrone, ...], fence: Geofence | None) -> None:
        """What each agent would refuse of its own file is refused here, before any process is started."""
        config = self._config
        swarm = SwarmConfig(name=config.name, members=tuple(d.id for d in drones))
        for index, drone in enumerate(drones):
            seen = DroneConfig(
                drone=drone.id,
                swarm=swarm,
                origin=config.origin,
                autopilot=AutopilotConfig(link="udpin:127.0.0.1:0", flavour=drone.flavour),
                instruments=tuple(
                    InstrumentConfig(name=i.name, type=i.type, port="socket://127.0.0.1:0", options=i.options)
                    for i in drone.instruments or ()
                ),
                formation=config.formation,
                limits=config.limits,
                geofence=fence,
                obstacles=known_obstacles(config.obstacles),
                strategy=config.strategy,
                seed=config.seed,
            )
            for field, problem in problems(seen):
                own = field.startswith("instruments") and self._has_own_instruments(index)
                raise self._fail(f"drones[{index}].{field}" if own else self._own_field(field), problem)
            problem = launch_problem(seen, (drone.home_north_m, drone.home_east_m))
            if problem:
                raise self._fail(
                    self._place(index, "home_north_m"), f"drone {drone.id}'s launch point {problem}"
                )
            if index == 0:  # they are about what is the same for all
                for field, caution in cautions(seen):
                    self._warnings.append(str(self._fail(self._own_field(field), caution)))

    def _own_field(self, field: str) -> str:
        """Where this file has what an agent's file has in a field: agents are not told of all obstacles."""
        name, _, rest = field.partition("[")
        if name != "obstacles":
            return field
        known = [index for index, one in enumerate(self._config.obstacles) if not one.unknown]
        return f"obstacles[{known[int(rest.rstrip(']'))]}]"

    def _has_own_instruments(self, index: int) -> bool:
        return bool(self._config.drones) and self._config.drones[index].instruments is not None

    def _fail(self, field: str, problem: str) -> DocumentError:
        return DocumentError(self._file, problem, line=line_of(self._text, field), field=field)

    def _drones(self) -> tuple[SurveyDrone, ...]:
        config = self._config
        if (config.launch_line is None) == (not config.drones):
            raise self._fail("drones", "give either drones (a list) or launch_line, one of them")
        drones = tuple(config.launch_line.drones()) if config.launch_line else config.drones
        first: dict[int, int] = {}
        for index, drone in enumerate(drones):
            if drone.id in first:
                raise self._fail(
                    f"drones[{index}].id",
                    f"drones[{first[drone.id]}] has the id {drone.id} too; every drone needs its own",
                )
            first[drone.id] = index
        return tuple(
            msgspec.structs.replace(
                d, instruments=config.instruments if d.instruments is None else d.instruments
            )
            for d in drones
        )

    def _place(self, index: int, field: str) -> str:
        return f"drones[{index}].{field}" if self._config.drones else "launch_line"

    def _launch_points(self, drones: tuple[SurveyDrone, ...]) -> None:
        separation_m = self._config.limits.separation_m
        for index, drone in enumerate(drones):
            if max(abs(drone.home_north_m), abs(drone.home_east_m)) > FARTHEST_HOME_M:
                raise self._fail(
                    self._place(index, "home_north_m"),
                    f"drone {drone.id} starts more than {FARTHEST_HOME_M / 1000:g} km from the origin",
                )
        close: list[str] = []
        apart_deaf_m = separation_m + 2.0 * SEPARATION_MARGIN_M
        for (_, a), (index, b) in itertools.combinations(enumerate(drones), 2):
            apart_m = math.hypot(a.home_north_m - b.home_north_m, a.home_east_m - b.home_east_m)
            if apart_m < separation_m:
                raise self._fail(
                    self._place(index, "home_north_m"),
                    f"drones {a.id} and {b.id} start {apart_m:.1f} m apart, less than "
                    f"limits.separation_m = {separation_m:g} m; move one of them",
                )
            if apart_m < apart_deaf_m - 0.01:  # places are given in whole millimetres
                close.append(f"{a.id} and {b.id}")
        if close:
            self._warnings.append(
                f"{self._file}: drones {', '.join(close)} start less than {apart_deaf_m:g} m apart: "
                "two that land without hearing each other may come nearer than limits.separation_m"
            )

    def _emulated(self, drones: tuple[SurveyDrone, ...]) -> None:
        for index, drone in enumerate(drones):
            field = f"drones[{index}].instruments" if self._has_own_instruments(index) else "instruments"
            for place, instrument in enumerate(drone.instruments or ()):
                try:
                    make_emulator(instrument.type, np.random.default_rng(0))
                except SensorError as error:
                    raise self._fail(f"{field}[{place}].type", str(error)) from error
            try:
                Parameters(drone.flavour, drone.parameters)
            except UnknownParameterError as error:
                raise self._fail(f"drones[{index}].parameters", str(error)) from error

    def _plume(self) -> None:
        if not isinstance(self._config.plume, GaussianPlume):
            return
        gas = make_world(self._config).gas
        most_ppm = gas.excess_co2_ppm(gas.source_ned_m, 0.0)
        if most_ppm > 1e6:
            raise self._fail(
                "plume.vent_sd_m",
                f"{most_ppm:.3g} ppm at the vent is more than pure CO2; give it a wider vent or a smaller emission",
            )

    def _geofence(self) -> Geofence | None:
        fence, warnings = read_section(self._config.geofence, self._file, self._text)
        self._warnings += warnings
        return fence

    def _in_the_fence(self, drones: tuple[SurveyDrone, ...], fence: Geofence | None) -> None:
        if fence is None:
            return
        local = LocalFence(self._frame, fence)
        margin_m = self._config.limits.fence_margin_m
        for index, drone in enumerate(drones):
            clearance_m = local.clearance_m(drone.home_north_m, drone.home_east_m)
            if clearance_m < margin_m:
                where = (
                    f"{-clearance_m:.0f} m outside the geofence"
                    if clearance_m < 0.0
                    else f"{clearance_m:.1f} m from the geofence, limits.fence_margin_m is {margin_m:g} m"
                )
                raise self._fail(
                    self._place(index, "home_north_m"),
                    f"drone {drone.id}'s launch point is {where}; move it or widen the fence",
                )
        aims = sources(self._config)
        if aims and not any(local.contains(*place[:2]) for _, place in aims):
            self._warnings.append(
                f"{self._file}: plume: its source lies outside the geofence: the swarm cannot reach it"
            )

    def _between_obstacles(self, drones: tuple[SurveyDrone, ...], fence: Geofence | None) -> None:
        """Nobody starts in or beside one, and there is a way for everybody to every source."""
        config = self._config
        if not config.obstacles:
            return
        homes = [(drone.home_north_m, drone.home_east_m, 0.0) for drone in drones]
        obstacles = Obstacles(config.obstacles)
        for index, drone in enumerate(drones):
            away_m = obstacles.clearance_m(homes[index])
            if away_m < 0.5 * WAY_M:
                where = "inside an obstacle" if away_m < 0.0 else f"{away_m:.1f} m from an obstacle"
                raise self._fail(
                    self._place(index, "home_north_m"),
                    f"drone {drone.id}'s launch point is {where}; move one of them, at least {0.5 * WAY_M:g} m apart",
                )
        local = LocalFence(self._frame, fence) if fence else None
        # Of sources outside the fence a warning has told already.
        aims = [aim for aim in sources(config) if local is None or local.contains(*aim[1][:2])]
        shut = shut_in(
            [*homes, *(place for _, place in aims)],
            config.obstacles,
            way_m=WAY_M,
            ceiling_m=config.limits.ceiling_above_home_m,
            bounds=None if local is None else local.area,
        )
        way = f"no way of {WAY_M:g} m between the obstacles, below the ceiling and inside the fence, leads"
        for index, drone in enumerate(drones):
            if shut[index]:
                raise self._fail(
                    self._place(index, "home_north_m"),
                    f"{way} from drone {drone.id}'s launch point to the others",
                )
        for (field, _), closed in zip(aims, shut[len(homes) :], strict=True):
            if closed:
                raise self._fail(field, f"{way} from the launch points to the source")

    def _faults(self, drones: tuple[SurveyDrone, ...]) -> None:
        by_id = {drone.id: drone for drone in drones}
        own = len(self._config.faults) - len(self._extra_faults)
        for index, fault in enumerate(self._config.faults):
            looks_around = self._config.range_finder is not None
            for field, problem in _fault_problems(fault, by_id, looks_around=looks_around):
                if index >= own:
                    raise DocumentError(f"--fault {fault_option(fault)}", problem)
                raise self._fail(f"faults[{index}].{field}", problem)

    def _radio(self, drones: tuple[SurveyDrone, ...]) -> None:
        nodes = [drone.id for drone in drones]
        for index, link in enumerate(self._config.radio.dead_links):
            for problem in _dead_link_problems(link, nodes):
                raise self._fail(f"radio.dead_links[{index}]", problem)


def _dead_link_problems(link: tuple[int | str, int | str], drones: list[int]) -> Iterator[str]:
    for node in link:
        if node not in (*drones, GROUND_STATION):
            yield f'there is no {node!r} to hear or be heard, but "{GROUND_STATION}" and drones {drones}'
    if link[0] == link[1]:
        yield f"{link[0]} hears itself; write [sender, who does not hear it]"


def _fault_problems(
    fault: FaultSpec, drones: Mapping[int, SurveyDrone], *, looks_around: bool
) -> Iterator[tuple[str, str]]:
    if fault.drone not in drones:
        yield "drone", f"there is no drone {fault.drone}, but {list(drones)}"
        return
    types = {i.name: i.type for i in drones[fault.drone].instruments or ()}
    yield from what_does_not_fit(fault, f"drone {fault.drone}", types, looks_around=looks_around)
    if fault.until_s is not None and fault.until_s <= fault.at_s:
        yield "until_s", f"it breaks at {fault.at_s:g} s, so it cannot mend at {fault.until_s:g} s"
