"""The table of instrument types, and how one is made by the name of its type."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from sensors.instruments import ft205, gss, k30, li850, mavlink_readings, sba5, trisonica, windsonic
from sensors.instruments.anemometers import Mounting
from sensors.instruments.calibrated import CalibratedInstrument, Calibration
from sensors.instruments.samples import Instrument, Quantity
from sensors.instruments.sensor_error import SensorError


@dataclasses.dataclass(frozen=True)
class Co2Traits:
    """What the filter must know of a make of CO2 instrument, from its data sheet; `tune` measures a unit's
    own."""

    lag_s: float
    """Time constant of the response, taken as first order: 63 % of a step."""
    noise_ppm: float
    """Standard deviation of a reading in clean air."""
    resolution_ppm: float
    period_s: float = 0.1
    """Time between two readings."""


@dataclasses.dataclass(frozen=True)
class InstrumentType:
    name: str
    description: str
    quantity: Quantity
    baud: int | None
    """The usual rate; None where the readings do not come over a serial port."""
    options: type[msgspec.Struct]
    make: Callable[[str, Any], Instrument]
    co2: Co2Traits | None = None
    aliases: tuple[str, ...] = ()


INSTRUMENTS: dict[str, InstrumentType] = {
    t.name: t
    for t in (
        InstrumentType(
            "sba5",
            "PP Systems SBA-5 infrared CO2 analyser with pump and zero valve",
            Quantity.CO2,
            sba5.BAUD,
            sba5.Sba5Options,
            sba5.Sba5,
            Co2Traits(lag_s=1.5, noise_ppm=1.0, resolution_ppm=0.01),
        ),
        InstrumentType(
            "k30",
            "Senseair K30 infrared CO2 sensor, Modbus RTU",
            Quantity.CO2,
            k30.BAUD,
            k30.K30Options,
            k30.K30,
            Co2Traits(lag_s=20.0, noise_ppm=3.0, resolution_ppm=1.0, period_s=2.0),
            aliases=("senseairk30",),
        ),
        InstrumentType(
            "cozir",
            "GSS CozIR infrared CO2 sensor, ASCII Z and z lines",
            Quantity.CO2,
            gss.BAUD,
            gss.GssOptions,
            gss.cozir,
            Co2Traits(lag_s=15.0, noise_ppm=10.0, resolution_ppm=1.0, period_s=0.5),
            aliases=("gsscozir", "coziramb", "cozira"),
        ),
        InstrumentType(
            "sprintir",
            "GSS SprintIR high-speed infrared CO2 sensor, ASCII Z and z lines",
            Quantity.CO2,
            gss.BAUD,
            gss.GssOptions,
            gss.sprintir,
            Co2Traits(lag_s=1.0, noise_ppm=30.0, resolution_ppm=10.0, period_s=0.05),
            aliases=("gsssprintir", "sprintirw", "gss"),
        ),
        InstrumentType(
            "li850",
            "LI-COR LI-850 CO2/H2O analyser (also LI-820, LI-830, LI-840), XML-like stream",
            Quantity.CO2,
            li850.BAUD,
            li850.Li850Options,
            li850.Li850,
            Co2Traits(lag_s=1.5, noise_ppm=0.5, resolution_ppm=0.01, period_s=0.5),
            aliases=("li820", "li830", "li840", "licorli850"),
        ),
        InstrumentType(
            "mavlink",
            "CO2 readings that the autopilot relays as NAMED_VALUE_FLOAT",
            Quantity.CO2,
            None,
            mavlink_readings.MavlinkOptions,
            mavlink_readings.MavlinkReadings,
            Co2Traits(lag_s=1.5, noise_ppm=1.0, resolution_ppm=0.01),
            aliases=("namedvaluefloat",),
        ),
        InstrumentType(
            "trisonica",
            "LI-COR LI-550 TriSonica Mini, three-dimensional ultrasonic anemometer",
            Quantity.WIND,
            trisonica.BAUD,
            Mounting,
            trisonica.Trisonica,
            aliases=("li550", "trisonicamini", "li550trisonicamini"),
        ),
        InstrumentType(
            "ft205",
            "FT Technologies FT205 (also FT702, FT722, FT742) acoustic wind sensor",
            Quantity.WIND,
            ft205.BAUD,
            ft205.Ft205Options,
            ft205.Ft205,
            aliases=("ft205ev", "ft702", "ft722", "ft742"),
        ),
        InstrumentType(
            "windsonic",
            "Gill WindSonic two-axis ultrasonic anemometer: polar, U V or NMEA",
            Quantity.WIND,
            windsonic.BAUD,
            Mounting,
            windsonic.WindSonic,
            aliases=("gill", "gillwindsonic"),
        ),
    )
}


def instrument_type(type_name: str) -> InstrumentType:
    """The type called `type_name`, upper or lower case, with or without dashes. `SensorError` if there is
    none."""
    plain = "".join(c for c in type_name.lower() if c.isalnum())
    for entry in INSTRUMENTS.values():
        if plain in (entry.name, *entry.aliases):
            return entry
    near = difflib.get_close_matches(plain, INSTRUMENTS, n=1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise SensorError(f"unknown instrument type {type_name!r}{hint}; known are: {', '.join(INSTRUMENTS)}")


def make_instrument(
    type_name: str, name: str | None = None, options: Mapping[str, Any] | None = None
) -> Instrument:
    """The protocol of an instrument of this type, called `name` in its samples (by default as its type).

    Beside its own, every CO2 instrument has the option `calibration` (see `sensors.calibration.side_by_side`).
    `SensorError` for an unknown type, an option that the type does not have, or a value that cannot be.
    """
    entry = instrument_type(type_name)
    label = name or entry.name
    given = dict(options or {})
    measures_co2 = entry.quantity is Quantity.CO2
    try:
        calibration = given.pop("calibration", None) if measures_co2 else None
        corrected = None if calibration is None else msgspec.convert(calibration, Calibration)
        instrument = entry.make(label, msgspec.convert(given, entry.options))
    except msgspec.ValidationError as error:
        known = ", ".join((*entry.options.__struct_fields__, *(("calibration",) if measures_co2 else ())))
        raise SensorError(f"instrument {label} ({entry.name}): {error}; its options are: {known}") from error
    return instrument if corrected is None else CalibratedInstrument(instrument, corrected)
