"""The instruments of one drone and the serial lines that they are at the end of."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mission.geometry.frames import Vector3
from sensors.instruments.registry import instrument_type
from sensors.instruments.samples import Quantity
from simvehicle.drone.drone_spec import EmulatedInstrument
from simvehicle.instruments import Air, Emulator, make_emulator
from simvehicle.vehicle.dynamics import in_body

_STREAM = 0x1457
"""Of the random numbers: an instrument's noise stays the same whatever else draws more or fewer."""


class InstrumentLines:
    """Emulated instruments by name; a line can be unplugged, and the instrument goes on measuring.

    Raises `SensorError` for a type that cannot be emulated.
    """

    def __init__(self, instruments: Iterable[EmulatedInstrument], drone: int, seed: int) -> None:
        listed = tuple(instruments)
        self._emulators: dict[str, Emulator] = {
            item.name: make_emulator(
                item.type, np.random.default_rng([seed & 0xFFFFFFFF, drone, _STREAM, index])
            )
            for index, item in enumerate(listed)
        }
        self.feel_wind = any(instrument_type(item.type).quantity is Quantity.WIND for item in listed)
        """Some of them need to be told the wind that the airframe feels."""
        self._unplugged: set[str] = set()
        self._stuck: dict[str, Air | None] = {}
        """Instruments that go on measuring the same air, and which that is, once it is known."""
        self._lying_ppm: dict[str, float] = {}
        self._said: dict[str, bytearray] = {}

    def __len__(self) -> int:
        return len(self._emulators)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._emulators)

    def is_plugged(self, name: str) -> bool:
        return name not in self._unplugged

    def set_plugged(self, name: str, plugged: bool) -> None:
        if plugged:
            self._unplugged.discard(name)
        else:
            self._unplugged.add(name)
            self._said.pop(name, None)

    def set_stuck(self, name: str, stuck: bool) -> None:
        """Whether an instrument goes on measuring the air of this moment, as one with a blocked inlet does."""
        if stuck:
            self._stuck.setdefault(name, None)
        else:
            self._stuck.pop(name, None)

    def set_lying(self, name: str, by_ppm: float) -> None:
        """How much more CO2 than there is an instrument measures."""
        self._lying_ppm[name] = by_ppm

    def receive(self, name: str, now_s: float, data: bytes) -> None:
        """Bytes from the other end of a line."""
        if data and name not in self._unplugged:
            self._emulators[name].receive(now_s, data)

    def step(self, now_s: float, air: Air) -> None:
        for name, emulator in self._emulators.items():
            said = emulator.step(now_s, self._measured(name, air))
            if said and name not in self._unplugged:
                self._said.setdefault(name, bytearray()).extend(said)

    def _measured(self, name: str, air: Air) -> Air:
        """What an instrument makes of the air before its own errors."""
        if name in self._stuck:
            air = self._stuck[name] = self._stuck[name] or air
        by_ppm = self._lying_ppm.get(name)
        return air._replace(co2_ppm=max(0.0, air.co2_ppm + by_ppm)) if by_ppm else air

    def drain(self) -> dict[str, bytes]:
        """What the plugged instruments said since the last call."""
        said, self._said = self._said, {}
        return {name: bytes(data) for name, data in said.items()}


def felt_wind_mps(wind_ned_mps: Vector3, velocity_ned_mps: Vector3, attitude_rad: Vector3) -> Vector3:
    """The air's velocity relative to a vehicle, body frame (forward, right, down): what an anemometer feels."""
    wind, own = wind_ned_mps, velocity_ned_mps
    return in_body((wind[0] - own[0], wind[1] - own[1], wind[2] - own[2]), attitude_rad)
