"""The filter stage of the agent: instruments' bytes and the vehicle's motion to CO2 and wind estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import msgspec

from flightstack.config import FiltersConfig, InstrumentConfig
from mission.estimation.estimates import Scalar, Wind
from sensors.filters.co2_filter import Co2Filter, Co2FilterConfig
from sensors.filters.filter_settings import co2_filter_config
from sensors.filters.wind_config import UNCALIBRATED_DRAG_SCALE_SD
from sensors.filters.wind_filter import VehicleMotion, WindFilter, WindFilterConfig
from sensors.instruments.registry import instrument_type, make_instrument
from sensors.instruments.samples import Instrument, InstrumentState, Sample
from sensors.instruments.sensor_error import SensorError


class PortInput(msgspec.Struct, frozen=True, array_like=True):
    """What happened at an instrument's port since the last tick."""

    instrument: str
    data: bytes = b""
    connected: bool = False
    """The port was opened (again) before `data` came."""
    lost: str | None = None
    """Why the port was lost, after `data` came."""


class Sensed(msgspec.Struct, frozen=True):
    co2_ppm: float | None
    excess_co2_ppm: Scalar | None
    wind: Wind | None
    notes: tuple[str, ...]
    """Why an instrument or an estimate is not as it should be."""
    to_ports: tuple[tuple[str, bytes], ...]


class Sensing:
    """All instruments and filters of one drone. `step` is called once a tick."""

    def __init__(self, instruments: Sequence[InstrumentConfig], filters: FiltersConfig) -> None:
        self._instruments: dict[str, Instrument] = {
            item.name: make_instrument(item.type, item.name, dict(item.options))
            for item in instruments
            if item.port != "mavlink"
        }
        self._co2 = Co2Filter(co2_settings(instruments, filters))
        self._wind = WindFilter(wind_settings(filters))
        self._latest: dict[str, Sample] = {}

    def step(
        self,
        now_s: float,
        events: Sequence[PortInput],
        vehicle_samples: Sequence[Sample],
        motion: VehicleMotion | None,
    ) -> Sensed:
        samples: list[Sample] = list(vehicle_samples)
        to_ports: list[tuple[str, bytes]] = []
        for event in events:
            instrument = self._instruments[event.instrument]
            if event.connected:
                to_ports.append((event.instrument, instrument.connected(now_s)))
            if event.data:
                samples += instrument.receive(now_s, event.data)
            if event.lost is not None:
                samples += instrument.disconnected(now_s, event.lost)
        for name, instrument in self._instruments.items():
            data, late = instrument.poll(now_s)
            to_ports.append((name, data))
            samples += late
        for sample in samples:
            self._latest[sample.instrument] = sample
        co2 = self._co2.step(now_s, samples)
        wind = self._wind.step(now_s, samples, motion) if motion is not None else None
        notes = [
            f"{name}: {sample.state}" + (f", {sample.reason}" if sample.reason else "")
            for name, sample in sorted(self._latest.items())
            if sample.state is not InstrumentState.MEASURING
        ]
        excess = None
        if co2 is not None:
            if co2.health == "bad":
                notes.append(f"CO2 estimate: {co2.reason}")
            else:
                excess = Scalar(co2.excess_co2_ppm, co2.variance_ppm2, co2.age_s)
        return Sensed(
            co2.co2_ppm if co2 is not None else None,
            excess,
            None
            if wind is None or wind.health == "bad"
            else Wind(wind.wind_ned_mps, wind.variance_m2ps2, wind.age_s),
            tuple(notes),
            tuple((name, data) for name, data in to_ports if data),
        )


def co2_settings(instruments: Sequence[InstrumentConfig], filters: FiltersConfig) -> Co2FilterConfig:
    """The CO2 filter's settings: of the first CO2 instrument's make, and what the drone's file knows better.

    `SensorError` for a setting that the filter does not have.
    """
    for item in instruments:
        if instrument_type(item.type).co2 is not None:
            return _changed(co2_filter_config(item.type, item.name), filters.co2, "filters.co2")
    return _changed(Co2FilterConfig(), filters.co2, "filters.co2")


def wind_settings(filters: FiltersConfig) -> WindFilterConfig:
    """The wind filter's settings; a drag that the drone's file does not give is hardly known.

    `SensorError` for a setting that the filter does not have.
    """
    usual = WindFilterConfig()
    if "drag" not in filters.wind:
        usual = WindFilterConfig(drag_scale_sd=UNCALIBRATED_DRAG_SCALE_SD)
    return _changed(usual, filters.wind, "filters.wind")


S = TypeVar("S", bound=msgspec.Struct)


def _changed(settings: S, changes: Mapping[str, Any], field: str) -> S:
    try:
        return msgspec.convert({**msgspec.to_builtins(settings), **changes}, type(settings))
    except msgspec.ValidationError as error:
        known = ", ".join(settings.__struct_fields__)
        raise SensorError(f"{field}: {error}; its settings are: {known}") from error
