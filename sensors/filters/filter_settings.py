"""The filters' configuration for a given instrument."""

from __future__ import annotations

import msgspec

from sensors.filters.co2_model import Co2FilterConfig
from sensors.instruments.registry import instrument_type
from sensors.instruments.sensor_error import SensorError


def co2_filter_config(type_name: str, instrument: str | None = None) -> Co2FilterConfig:
    """The CO2 filter's configuration for a make of instrument, from its data sheet (see `INSTRUMENTS`).

    `instrument` limits the filter to the samples of the instrument of that name. `SensorError` for a type
    that does not measure CO2.
    """
    entry = instrument_type(type_name)
    traits = entry.co2
    if traits is None:
        raise SensorError(f"instrument type {entry.name} does not measure CO2")
    usual = Co2FilterConfig()
    coarse = traits.resolution_ppm >= 0.1 * traits.noise_ppm
    return msgspec.structs.replace(
        usual,
        lag_s=traits.lag_s,
        noise_ppm=traits.noise_ppm,
        resolution_ppm=traits.resolution_ppm,
        fresh_s=max(usual.fresh_s, 2.5 * traits.period_s),
        lost_s=max(usual.lost_s, 5.0 * traits.period_s),
        stuck_s=max(usual.stuck_s, (100.0 if coarse else 30.0) * traits.period_s),
        late_s=max(usual.late_s, 2.0 * traits.period_s),
        instrument=instrument,
    )
