"""A drone's configuration file, typed. Unknown keys are refused; every limit has its unit in its name."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from mission.geometry.frames import Geodetic
from mission.geometry.geofence import Geofence
from mission.geometry.known_obstacles import KnownObstacle

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
DroneId = Annotated[int, Meta(ge=1, le=250)]
"""Also the MAVLink system id of the drone's autopilot."""
NodeName = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
"""Of a node that is no drone; it must not look like a drone's number."""
SiteName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of a configuration file."""


class SwarmConfig(Section, frozen=True, kw_only=True):
    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]+$")]
    members: Annotated[tuple[DroneId, ...], Meta(min_length=1)]
    """All drones of the survey in the order in which they take the formation's slots."""
    listen: tuple[str, ...] = ()
    """zenoh endpoints that this node listens on: "tcp/10.0.0.3:7447"."""
    connect: tuple[str, ...] = ()
    """zenoh endpoints to connect to, for ever. Best is one list of all nodes', ground stations included, the same on
    every node: each pair then has one connection that is made again whatever happens (docs/decisions/0002)."""
    tls: TlsConfig | None = None
    site: SiteName | None = None
    """Where this node is, if a zenoh router joins several sites; its endpoint then stands first in `connect`
    (docs/sites.md)."""


class TlsConfig(Section, frozen=True, kw_only=True):
    """Mutual TLS between the nodes: each has a certificate signed by the swarm's own authority, and may speak in no
    other name than the certificate's. Paths in a file are relative to its directory."""

    authority: str
    certificate: str
    """Its common name says who this is: "drone-3", or a station's name."""
    private_key: str
    stations: tuple[NodeName, ...] = ("ground",)
    """Ground stations that are listened to."""
    routers: tuple[NodeName, ...] = ()
    """Routers that are believed to relay what others say."""


class AutopilotConfig(Section, frozen=True, kw_only=True):
    link: str
    """As pymavlink writes it: "/dev/ttypixhawk,115200", "udpin:127.0.0.1:14541", "tcp:127.0.0.1:5760"."""
    signing_key: str | None = None
    """File with the key that MAVLink is signed with on this link, its path relative to this file's directory. None:
    nothing is signed, and everything is believed."""
    flavour: Literal["auto", "ardupilot", "px4"] = "auto"
    """"auto" believes the autopilot's own heartbeat."""
    ready_timeout_s: Positive = 180.0
    """How long to wait until the autopilot is ready to arm; a cold GPS takes minutes."""
    answer_timeout_s: Positive = 60.0
    """How long (real seconds) the autopilot may be silent at start before the agent gives up with an error."""
    parameters: dict[str, float] = {}
    """Autopilot parameters to set and read back before the first arming."""


class InstrumentConfig(Section, frozen=True, kw_only=True):
    name: str
    type: str
    """"sba5", "trisonica", …: `flightstack sensors list` names them."""
    port: str
    """As pyserial's serial_for_url takes it ("/dev/ttysba5", "socket://127.0.0.1:9001"); "mavlink" for
    instruments whose readings come through the autopilot."""
    baud: int | None = None
    """None: the instrument's usual rate."""
    options: dict[str, Any] = {}
    """What only this type knows, checked by its driver."""


class FiltersConfig(Section, frozen=True, kw_only=True):
    """What the filters know better than the data sheets: values that `flightstack sensors tune` printed."""

    co2: dict[str, Any] = {}
    """Fields of `sensors.filters.co2_model.Co2FilterConfig`: lag_s, noise_ppm, background_co2_ppm, …"""
    wind: dict[str, Any] = {}
    """Fields of `sensors.filters.wind_config.WindFilterConfig`: drag, gust_sd_mps, anemometer_arms_body_m, …"""


class FormationConfig(Section, frozen=True, kw_only=True):
    layout: Literal["hexagonal", "rings"] = "hexagonal"
    spacing_m: Positive = 10.0
    """Distance between tree neighbours (the paper's r_max); the radio must reach it."""
    radio_range_m: Positive | None = None
    """How far the radio reaches for certain; None: `spacing_m`."""
    above_home_m: Positive = 10.0
    """The common altitude of the formation over the origin of the swarm's frame."""
    layer_gap_m: Positive = 5.0
    """Vertical distance between drones that cross each other's way while forming up and going home."""
    layers: Annotated[int, Meta(ge=1)] | None = None
    """How many altitudes they share for it; None: each drone has its own (`flightstack.flight.layers`)."""


class StagesConfig(Section, frozen=True, kw_only=True):
    """How long a stage of a survey may last. The battery ends most of them before; these are for what it does not."""

    forming_s: Positive = 300.0
    """A drone that is not in its slot by then goes home; so does a swarm that has not begun to search."""
    searching_s: Positive = 1800.0
    """All the search for contact together: then the root gives up for the whole swarm."""
    tracking_s: Positive = 1800.0
    """The same for all the following of a plume together."""
    holding_s: Positive = 1800.0
    """A paused drone goes home then."""
    returning_s: Positive | None = None
    """A drone that is not over its home by then lands where it is. None: 300 s, and three times what the way from the
    farthest corner of the geofence takes at `speed_mps`; 900 s without a geofence."""
    landing_s: Positive = 180.0
    """A drone that is not on the ground by then needs somebody: that is told, there is no more to do."""


class LimitsConfig(Section, frozen=True, kw_only=True):
    speed_mps: Positive = 5.0
    climb_mps: Positive = 2.0
    descent_mps: Positive = 1.5
    acceleration_mps2: Positive = 2.0
    separation_m: Positive = 4.0
    """No two flying drones may come nearer than this (the paper's r_min)."""
    floor_above_home_m: NotNegative = 2.0
    ceiling_above_home_m: Positive = 60.0
    fence_margin_m: NotNegative = 3.0
    """The guard keeps this distance from every fence line."""
    obstacle_margin_m: NotNegative = 3.0
    """And this one from every obstacle that is known, beside it and above it."""
    peer_suspected_s: Positive = 0.8
    """Silence after which a member is missed; it counts as lost half a second later, unless it objects."""
    peer_lost_s: Positive = 3.0
    """Silence of several members at once after which the swarm counts as come apart."""
    ground_lost_s: Positive | None = None
    """Silence of the ground station after which the survey is aborted; None: the swarm goes on without it."""
    position_stale_s: Positive = 1.0
    """Age of the own position above which the drone holds."""
    battery_return_fraction: Fraction = 0.25
    """The drone announces its own failure and goes home below this."""
    stages: StagesConfig = StagesConfig()


class StrategyConfig(Section, frozen=True, kw_only=True):
    name: str = "locus"
    parameters: dict[str, Any] = {}
    """Keyword arguments of the strategy, checked by it; `docs/simulate.md` lists them."""


class SharedClockConfig(Section, frozen=True, kw_only=True):
    """The clock of a simulated flight; see `flightstack.recording.shared_clock`."""

    file: str
    slot: Annotated[int, Meta(ge=1)]


class DroneConfig(Section, frozen=True, kw_only=True):
    drone: DroneId
    swarm: SwarmConfig
    origin: Geodetic
    """Origin of the swarm's local frame, the same for all members; altitudes "above home" are above it."""
    autopilot: AutopilotConfig
    instruments: tuple[InstrumentConfig, ...] = ()
    filters: FiltersConfig = FiltersConfig()
    formation: FormationConfig = FormationConfig()
    limits: LimitsConfig = LimitsConfig()
    geofence: Geofence | None = None
    obstacles: Annotated[tuple[KnownObstacle, ...], Meta(max_length=1000)] = ()
    """What is known to stand there; the guard keeps clear of it."""
    strategy: StrategyConfig = StrategyConfig()
    seed: int = 0
    """Seed of the strategy's randomness; all members share it."""
    record_to: str = "flights"
    """Directory for recordings and logs, made if absent."""
    speedup: Positive = 1.0
    """1 in real flights. Simulated flights may run faster; all processes must be given the same."""
    clock: SharedClockConfig | None = None
    """Simulated flights only: the time that all their processes share, instead of each one's own."""
    radio: str | None = None
    """Simulated flights only: the file of the radio that all their processes share
    (`flightstack.transport.shared_radio`); refused without their clock."""
    tick_hz: Positive = 10.0
