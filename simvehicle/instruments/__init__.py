"""Emulated instruments: the same bytes as the real ones, from the world's plume and wind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from sensors.instruments.registry import instrument_type
from sensors.instruments.sensor_error import SensorError
from simvehicle.instruments.anemometers import (
    AnemometerEmulation,
    Ft205Emulation,
    Ft205Emulator,
    TrisonicaEmulator,
    WindSonicEmulation,
    WindSonicEmulator,
)
from simvehicle.instruments.gss import CozirEmulation, GssEmulator, SprintirEmulation
from simvehicle.instruments.k30 import K30Emulation, K30Emulator
from simvehicle.instruments.li850 import Li850Emulation, Li850Emulator
from simvehicle.instruments.physics import Emulator
from simvehicle.instruments.sba5 import Sba5Emulation, Sba5Emulator
from simvehicle.world.air import Air

__all__ = ["EMULATORS", "Air", "Emulator", "make_emulator"]

EMULATORS: dict[str, tuple[Callable[[np.random.Generator, Any], Emulator], type[msgspec.Struct]]] = {
    "sba5": (Sba5Emulator, Sba5Emulation),
    "k30": (K30Emulator, K30Emulation),
    "cozir": (GssEmulator, CozirEmulation),
    "sprintir": (GssEmulator, SprintirEmulation),
    "li850": (Li850Emulator, Li850Emulation),
    "trisonica": (TrisonicaEmulator, AnemometerEmulation),
    "ft205": (Ft205Emulator, Ft205Emulation),
    "windsonic": (WindSonicEmulator, WindSonicEmulation),
}
"""For every instrument type that has a line of its own: its emulator and the emulator's options."""


def make_emulator(spec_type: str, rng: np.random.Generator, **options: Any) -> Emulator:
    """An emulated instrument of this type, warm and zeroed unless `options` say otherwise.

    `SensorError` for an unknown type, one without a serial line, or an option that its emulator does not
    have.
    """
    name = instrument_type(spec_type).name
    if name not in EMULATORS:
        raise SensorError(f"instrument type {name} has no line of its own to emulate")
    emulator, kind = EMULATORS[name]
    try:
        checked = msgspec.convert(options, kind)
    except msgspec.ValidationError as error:
        known = ", ".join(kind.__struct_fields__)
        raise SensorError(f"emulated {name}: {error}; its options are: {known}") from error
    return emulator(rng, checked)
