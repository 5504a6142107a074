"""The table of instrument types, and how one is made by the name of its type."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from sensors.errors import SensorError
from sensors.samples import Instrument, Quantity
from sensors.sba5 import BAUD as SBA5_BAUD
from sensors.sba5 import Sba5, Sba5Options


@dataclasses.dataclass(frozen=True)
class Co2Traits:
    """What the filter must know of a make of CO2 instrument, from its data sheet; `tune` measures a unit's
    own."""

    lag_s: float
    """Time constant of the response, taken as first order: 63 % of a step."""
    noise_ppm: float
    """Standard deviation of a reading in clean air."""
    resolution_ppm: float


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
    wind_sd_mps: float | None = None
    """Standard deviation per axis of an anemometer, from its data sheet."""


INSTRUMENTS: dict[str, InstrumentType] = {
    t.name: t
    for t in (
        InstrumentType(
            "sba5",
            "PP Systems SBA-5 infrared CO2 analyser with pump and zero valve",
            Quantity.CO2,
            SBA5_BAUD,
            Sba5Options,
            Sba5,
            Co2Traits(lag_s=1.5, noise_ppm=1.0, resolution_ppm=0.01),
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
    raise SensorError(f"unknown instrument type {type_name!r}{hint} Known are: {', '.join(INSTRUMENTS)}")


def make_instrument(
    type_name: str, name: str | None = None, options: Mapping[str, Any] | None = None
) -> Instrument:
    """The protocol of an instrument of this type, called `name` in its samples (by default as its type).

    `SensorError` for an unknown type, an option that the type does not have, or a value that cannot be.
    """
    entry = instrument_type(type_name)
    label = name or entry.name
    try:
        checked = msgspec.convert(dict(options or {}), entry.options)
    except msgspec.ValidationError as error:
        known = ", ".join(entry.options.__struct_fields__) or "none"
        raise SensorError(f"instrument {label} ({entry.name}): {error}; its options are: {known}") from error
    return entry.make(label, checked)
