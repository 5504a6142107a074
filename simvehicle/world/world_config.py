"""What a configuration file says of the world: its place, wind, gas and seed."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mission.geometry.frames import Geodetic


class WindConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    speed_mps: Annotated[float, Meta(ge=0.0, le=30.0)] = 3.0
    from_deg: Annotated[float, Meta(ge=0.0, le=360.0)] = 90.0
    """Where the mean wind comes from, degrees clockwise from north."""
    gust_sd_mps: Annotated[float, Meta(ge=0.0)] = 0.3
    gust_time_s: Annotated[float, Meta(ge=0.1)] = 5.0


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


class WorldConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that a world depends on: equal values make equal worlds. Files of fleets and surveys extend it."""

    origin: Geodetic
    """Origin of the local frame, at the height of the launch points."""
    wind: WindConfig = WindConfig()
    plume: GaussianPlume | LocusGridPlume | None = None
    """None: clean air."""
    background_co2_ppm: Annotated[float, Meta(ge=0.0)] = 420.0
    seed: int = 0
