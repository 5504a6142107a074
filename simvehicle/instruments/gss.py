"""A GSS CozIR or SprintIR (see `sensors.instruments.gss` for the protocol and the sources)."""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np

from simvehicle.instruments.physics import GasCell, GasResponse, Ticker
from simvehicle.world.air import Air

_COMMAND = re.compile(rb"([A-Za-z.])(?: +(\d+))?")


class CozirEmulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    lag_s: float = 15.0
    noise_ppm: float = 10.0
    range_ppm: float = 10_000.0
    drift_ppm_per_sqrt_hour: float = 5.0
    multiplier: int = 1
    rate_hz: float = 2.0
    filter_s: float = 2.0
    """Time constant of the sensor's own digital filter, which Z has and z has not."""


class SprintirEmulation(CozirEmulation, frozen=True, forbid_unknown_fields=True, kw_only=True):
    lag_s: float = 0.5
    noise_ppm: float = 70.0
    range_ppm: float = 200_000.0
    multiplier: int = 10
    rate_hz: float = 20.0
    filter_s: float = 0.5


class GssEmulator:
    def __init__(self, rng: np.random.Generator, options: CozirEmulation | None = None) -> None:
        o = self.options = options or CozirEmulation()
        response = GasResponse(
            o.lag_s,
            o.noise_ppm,
            o.range_ppm,
            float(o.multiplier),
            drift_ppm_per_sqrt_hour=o.drift_ppm_per_sqrt_hour,
        )
        self._cell = GasCell(response, rng)
        self._received = b""
        self._mask = 4 + 2
        self._streams = True
        self._ticker = Ticker(1.0 / o.rate_hz)
        self._filtered_ppm: float | None = None

    def receive(self, now_s: float, data: bytes) -> None:  # noqa: ARG002 (answered in the next step)
        self._received = (self._received + data)[-512:]

    def step(self, now_s: float, air: Air) -> bytes:
        self._cell.breathe(now_s, air.co2_ppm)
        *commands, self._received = self._received.replace(b"\r", b"\n").split(b"\n")
        said = b"".join(self._obey(c.strip()) for c in commands if c.strip())
        for _ in range(self._ticker.passed(now_s)):
            line = self._line()
            said += line if self._streams else b""
        return said

    def _obey(self, command: bytes) -> bytes:
        found = _COMMAND.fullmatch(command)
        if found is None:
            return b"?\r\n"
        letter, value = found[1], int(found[2] or 0)
        if letter == b".":
            value = self.options.multiplier
        elif letter == b"M":
            self._mask = value
        elif letter == b"K":
            self._streams = value == 1
        elif letter == b"Z":
            return self._line()
        elif letter not in (b"A", b"a"):
            return b"?\r\n"
        return b" %s %05d\r\n" % (letter, value)

    def _line(self) -> bytes:
        raw_ppm = self._cell.reading_ppm()
        previous_ppm = raw_ppm if self._filtered_ppm is None else self._filtered_ppm
        blend = -math.expm1(-1.0 / (self.options.rate_hz * self.options.filter_s))
        self._filtered_ppm = previous_ppm + (raw_ppm - previous_ppm) * blend
        counts = [(4, b"Z", self._filtered_ppm), (2, b"z", raw_ppm)]
        fields = [
            b" %s %05d" % (letter, min(round(ppm / self.options.multiplier), 99_999))
            for bit, letter, ppm in counts
            if self._mask & bit
        ]
        return b"".join(fields) + b"\r\n" if fields else b""
