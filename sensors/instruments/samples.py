"""What instruments say, whatever their make."""

from __future__ import annotations

import enum
from typing import Protocol

import msgspec

from mission.geometry.frames import Vector3


class InstrumentState(enum.StrEnum):
    SILENT = "silent"
    """Nothing has come for longer than the instrument's period allows, or its port is gone."""
    WARMING = "warming"
    ZEROING = "zeroing"
    MEASURING = "measuring"
    ERROR = "error"


class Quantity(enum.StrEnum):
    """What an instrument measures. Samples without a value carry it too: a filter must know whose trouble it
    is."""

    CO2 = "co2"
    WIND = "wind"


class Sample(msgspec.Struct, frozen=True):
    """One message of an instrument. Values are present only where they are valid (`state` measuring)."""

    time_s: float
    """When it was made, on the receiver's clock, as far as that is known: when it was asked for, else when it
    was received."""
    instrument: str
    """The configured name of the instrument, "co2" or "anemometer_top"."""
    state: InstrumentState
    status: str = ""
    """The instrument's own status code, as sent."""
    reason: str = ""
    """Why there is no value, in words an operator understands; empty where there is one."""
    co2_ppm: float | None = None
    wind_body_mps: Vector3 | None = None
    """Where the air goes relative to the airframe: forward, right, down. The drone's own motion is still in
    it."""
    wind_down_measured: bool = True
    """False: the anemometer is flat, and the third number of `wind_body_mps` says nothing."""
    wind_ned_mps: Vector3 | None = None
    """Where the air goes relative to the ground, from sources that already removed the drone's motion."""
    wind_sd_mps: float | None = None
    """Standard deviation per horizontal axis, where the source states it."""
    pressure_pa: float | None = None
    temperature_c: float | None = None
    quantity: Quantity | None = None
    """What the instrument measures; None only where the sample's maker did not say."""
    co2_at_least_ppm: float | None = None
    """The end of the instrument's range where the reading stands at it: no value, but a lower bound."""


class Instrument(Protocol):
    """The sans-IO side of an instrument: bytes in, samples out, bytes to send. It never opens anything.

    Any byte string in any chunking must be accepted: garbage gives no sample, or one whose state and reason
    tell what is wrong, never a wrong number.
    """

    name: str
    kind: str

    def connected(self, now_s: float) -> bytes:
        """The port was opened (again): forget partial input; returns what to send first."""
        ...

    def disconnected(self, now_s: float, reason: str) -> list[Sample]:
        """The port is gone: returns a sample in state SILENT that tells why."""
        ...

    def receive(self, now_s: float, data: bytes) -> list[Sample]: ...

    def ended(self, now_s: float) -> list[Sample]:
        """A recording is over: what its last bytes say, or that they say nothing."""
        ...

    def poll(self, now_s: float) -> tuple[bytes, list[Sample]]:
        """Called every tick: bytes to send now, and samples that time alone causes (SILENT after a
        time-out)."""
        ...
