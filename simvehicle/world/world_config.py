"""What a configuration file says of the world: its place, wind, gas, obstacles and seed."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
from msgspec import Meta

from mission.geometry.frames import Geodetic

Metres = Annotated[float, Meta(ge=-1e5, le=1e5)]


class WindConfig(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="uniform", tag_field="type"
):
    """The same wind everywhere: a mean and gusts. What a `wind` without a type is."""

    speed_mps: Annotated[float, Meta(ge=0.0, le=30.0)] = 3.0
    from_deg: Annotated[float, Meta(ge=0.0, le=360.0)] = 90.0
    """Where the mean wind comes from, degrees clockwise from north."""
    gust_sd_mps: Annotated[float, Meta(ge=0.0)] = 0.3
    gust_time_s: Annotated[float, Meta(ge=0.1)] = 5.0


class ThermalsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Columns of rising air over sunlit ground, which drift with the wind; between them the air sinks."""

    convective_mps: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.5
    """Convective velocity scale of the day: 1 weak, 2.5 and more strong."""
    mixed_layer_m: Annotated[float, Meta(ge=100.0, le=5000.0)] = 1000.0
    """How high thermals reach above home."""
    life_s: Annotated[float, Meta(ge=60.0, le=36000.0)] = 1200.0


class BoundaryLayerWindConfig(
    msgspec.Struct,
    frozen=True,
    forbid_unknown_fields=True,
    kw_only=True,
    tag="boundary-layer",
    tag_field="type",
):
    """Wind as it is over open ground: it grows with the height, and gusts and thermals drift with it."""

    speed_mps: Annotated[float, Meta(ge=0.0, le=30.0)] = 3.0
    """10 m above home."""
    from_deg: Annotated[float, Meta(ge=0.0, le=360.0)] = 90.0
    """Where the mean wind comes from, degrees clockwise from north."""
    roughness_m: Annotated[float, Meta(ge=1e-5, le=1.0)] = 0.03
    """Aerodynamic roughness of the ground: 0.005 bare soil, 0.03 grass, 0.1 crops and rocks, 1 forest."""
    gustiness: Annotated[float, Meta(ge=0.0, le=3.0)] = 1.0
    """Times the gusts that the model makes of the wind; 0: none."""
    thermals: ThermalsConfig | None = None


Regime = Literal["laminar", "transitional", "turbulent"]
REGIMES: Final[dict[Regime, tuple[float, float]]] = {
    "laminar": (0.15, 0.1),
    "transitional": (0.5, 0.3),
    "turbulent": (1.0, 0.6),
}
"""Spread and noise of the corners as shares of the mean speed, in the fluxotaxis experiments' regimes of flow."""


class GridWindConfig(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="grid", tag_field="type"
):
    """A wind that flows: it varies over the area and in time, and is slowed down beside what stands there."""

    speed_mps: Annotated[float, Meta(ge=0.0, le=30.0)] = 3.0
    from_deg: Annotated[float, Meta(ge=0.0, le=360.0)] = 90.0
    """Where the mean wind comes from, degrees clockwise from north."""
    centre_north_m: Metres = 0.0
    centre_east_m: Metres = 0.0
    length_m: Annotated[float, Meta(ge=1.0, le=1e5)] = 200.0
    """Of the square's sides. Beyond it the wind is that of its edge."""
    cells: Annotated[int, Meta(ge=4, le=1000)] = 60
    """Along a side."""
    regime: Regime = "transitional"
    """How unsteady it is: what `corner_spread` and `corner_noise` are where they are not given."""
    corner_spread: Annotated[float, Meta(ge=0.0, le=5.0)] | None = None
    """Standard deviation of each corner's steady wind from the mean, each axis, as a share of the mean speed."""
    corner_noise: Annotated[float, Meta(ge=0.0, le=5.0)] | None = None
    """Standard deviation of what varies in time in each corner, each axis, as a share of the mean speed."""
    diffusivity_m2ps: Annotated[float, Meta(gt=0.0, le=1e5)] = 3.0
    """At least: where the wind is fast and cells are wide the solver mixes more."""
    noise_bandwidth_radps: Annotated[float, Meta(ge=1e-6, le=2.0)] = 0.01
    noise_damping: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.5
    roughness_m: Annotated[float, Meta(gt=0.0, le=3.0)] | None = None
    """Aerodynamic roughness of the ground: the speed grows with the logarithm of the height, and `speed_mps` is that
    10 m above home. None: the same at every height."""
    step_s: Annotated[float, Meta(gt=0.0, le=60.0)] | None = None
    """Of the solver; None: the longest that is safely stable."""

    @property
    def spacing_m(self) -> float:
        return self.length_m / self.cells

    @property
    def spread_mps(self) -> float:
        share = REGIMES[self.regime][0] if self.corner_spread is None else self.corner_spread
        return share * self.speed_mps

    @property
    def noise_mps(self) -> float:
        share = REGIMES[self.regime][1] if self.corner_noise is None else self.corner_noise
        return share * self.speed_mps


class GaussianPlume(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="gaussian", tag_field="type"
):
    """The physical plume: stack height, reflection at the ground, spread growing downwind from a vent."""

    source_north_m: float
    source_east_m: float
    source_above_home_m: Annotated[float, Meta(ge=0.0)] = 10.0
    """Effective release height: the vent's height plus the plume's rise."""
    emission_kgps: Annotated[float, Meta(gt=0.0)] = 1.0
    vent_sd_m: Annotated[float, Meta(ge=0.001, le=1000.0)] = 4.0
    """Standard deviation of the plume's cross-section at the vent."""


class LocusGridPlume(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="locus-grid", tag_field="type"
):
    """The plume of the LoCUS paper's experiments: a 200 m by 40 m grid of values in [0, 1], downwind to the north."""

    source_north_m: float
    source_east_m: float
    perturbed: bool = False
    peak_ppm: Annotated[float, Meta(gt=0.0)] = 1000.0
    """What a value of 1 stands for."""


class FilamentSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    north_m: Metres
    east_m: Metres
    above_home_m: Annotated[float, Meta(ge=0.0, le=1e4)] = 0.0
    emission_kgps: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0
    moving_north_mps: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0
    """It is at `north_m`, `east_m` at time 0."""
    moving_east_mps: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0


class FilamentPlume(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="filaments", tag_field="type"
):
    """Puffs that the wind carries, shakes and widens (Farrell et al. 2002): a plume that meanders and has gaps."""

    sources: Annotated[tuple[FilamentSource, ...], Meta(min_length=1, max_length=100)]
    puffs_per_s: Annotated[float, Meta(gt=0.0, le=1e5)] = 2.0
    """Of each source."""
    initial_radius_m: Annotated[float, Meta(ge=0.01, le=1e3)] = 1.0
    growth: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.05
    """Of the radius to the power of 2/3, m^(2/3)/s: r(t) = (r0^(2/3) + growth t)^(3/2)."""
    shaking: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.1
    """Random walk of each puff to the north and the east: standard deviation of each after one second, m/s^(1/2)."""
    vertical_shaking: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.05
    rise_mps: Annotated[float, Meta(ge=0.0, le=50.0)] = 0.0
    """Of a fresh puff, by its buoyancy; it fades with `rise_time_s`: in all it rises by their product."""
    rise_time_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 10.0
    reach_m: Annotated[float, Meta(gt=0.0, le=1e5)] = 1000.0
    """A puff that is farther than this from its source, to the north or the east, is gone."""
    lifetime_s: Annotated[float, Meta(gt=0.0, le=1e5)] = 600.0
    """So is one that is older than this: in calm air none would ever leave."""
    head_start_s: Annotated[float, Meta(ge=0.0, le=1e5)] = 120.0
    """How long the sources have been open at time 0, in the wind of time 0."""
    step_s: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.2


class FlatFilamentSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    north_m: Metres
    east_m: Metres
    strength: Annotated[float, Meta(gt=0.0, le=1e12)] = 1.0
    """Q of each puff, in the plume's own unit."""
    moving_north_mps: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0
    moving_east_mps: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0


class FlatFilamentPlume(
    msgspec.Struct,
    frozen=True,
    forbid_unknown_fields=True,
    kw_only=True,
    tag="flat-filaments",
    tag_field="type",
):
    """The puffs of the fluxotaxis experiments: in one plane, the same at every height, in a unit of their own.

    The fields that `FilamentPlume` has too mean the same.
    """

    sources: Annotated[tuple[FlatFilamentSource, ...], Meta(min_length=1, max_length=100)]
    puffs_per_s: Annotated[float, Meta(gt=0.0, le=1e5)] = 0.5
    initial_radius_m: Annotated[float, Meta(ge=0.01, le=1e3)] = 0.3
    growth: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.02
    shaking: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.1
    reach_m: Annotated[float, Meta(gt=0.0, le=1e5)] = 1000.0
    lifetime_s: Annotated[float, Meta(gt=0.0, le=1e5)] = 3600.0
    head_start_s: Annotated[float, Meta(ge=0.0, le=1e5)] = 0.0
    step_s: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.2
    ppm_per_unit: Annotated[float, Meta(gt=0.0, le=1e12)] = 1.0
    """What a density of 1 is to instruments that read ppm."""


Plume: TypeAlias = GaussianPlume | LocusGridPlume | FilamentPlume | FlatFilamentPlume


class RectangularObstacle(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="rectangle", tag_field="type"
):
    """A block with its sides to the north and the east."""

    centre_north_m: Metres
    centre_east_m: Metres
    length_north_m: Annotated[float, Meta(gt=0.0, le=1e4)]
    length_east_m: Annotated[float, Meta(gt=0.0, le=1e4)]
    top_above_home_m: Annotated[float, Meta(gt=0.0, le=1e4)] | None = None
    """None: nothing flies over the obstacle."""
    unknown: bool = False
    """The drones are not told of it: they have to see it."""

    def outline(self) -> tuple[tuple[float, float], ...]:
        """(north_m, east_m) of its corners."""
        half_n, half_e = 0.5 * self.length_north_m, 0.5 * self.length_east_m
        north, east = self.centre_north_m, self.centre_east_m
        return (
            (north - half_n, east - half_e),
            (north - half_n, east + half_e),
            (north + half_n, east + half_e),
            (north + half_n, east - half_e),
        )


class PolygonalObstacle(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="polygon", tag_field="type"
):
    """A prism over a simple outline of either winding, which may be concave."""

    corners_north_east_m: Annotated[tuple[tuple[Metres, Metres], ...], Meta(min_length=3, max_length=1000)]
    top_above_home_m: Annotated[float, Meta(gt=0.0, le=1e4)] | None = None
    unknown: bool = False

    def outline(self) -> tuple[tuple[float, float], ...]:
        return self.corners_north_east_m


Obstacle: TypeAlias = RectangularObstacle | PolygonalObstacle
AnyWindConfig: TypeAlias = WindConfig | GridWindConfig | BoundaryLayerWindConfig


class WorldConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that a world depends on: equal values make equal worlds. Files of fleets and surveys extend it."""

    origin: Geodetic
    """Origin of the local frame, at the height of the launch points."""
    wind: AnyWindConfig = WindConfig()
    plume: Plume | None = None
    """None: clean air."""
    background_co2_ppm: Annotated[float, Meta(ge=0.0)] = 420.0
    obstacles: Annotated[tuple[Obstacle, ...], Meta(max_length=1000)] = ()
    seed: int = 0

    @classmethod
    def completed(cls, raw: dict[str, Any]) -> dict[str, Any]:
        """What a file says, with what it may leave out: a wind without a type is a uniform one."""
        wind = raw.get("wind")
        if isinstance(wind, dict) and "type" not in wind:
            return raw | {"wind": {"type": "uniform"} | wind}
        return raw
