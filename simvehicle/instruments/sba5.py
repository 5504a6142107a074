"""A PP Systems SBA-5 (see `sensors.instruments.sba5` for its protocol and the sources)."""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np

from simvehicle.instruments.physics import GasCell, GasResponse, Ticker
from simvehicle.world.air import Air

_STRING_COMMAND = re.compile(rb"([A-Y])(\d+)\r")


class Sba5Emulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    lag_s: float = 1.5
    noise_ppm: float = 1.0
    range_ppm: float = 100_000.0
    drift_ppm_per_sqrt_hour: float = 2.0
    warm_up_s: float = 0.0
    """0: it has been on for long, and was zeroed."""
    zero_steps: int = 25
    status: int = 0
    """A status code to report with every reading."""


class Sba5Emulator:
    def __init__(self, rng: np.random.Generator, options: Sba5Emulation | None = None) -> None:
        self.options = options or Sba5Emulation()
        self._cell = GasCell(
            GasResponse(
                self.options.lag_s,
                self.options.noise_ppm,
                self.options.range_ppm,
                0.01,
                drift_ppm_per_sqrt_hour=self.options.drift_ppm_per_sqrt_hour,
            ),
            rng,
        )
        self._commands = bytearray()
        self._display: Ticker | None = Ticker(1.0)
        self._zero_ticker: Ticker | None = None
        self._zero_step = 0
        self._zero_every_s = math.inf
        self._zeroed_s: float | None = None
        self._on_s: float | None = None
        self._pump = True
        self._was_warming = self.options.warm_up_s > 0.0

    def receive(self, now_s: float, data: bytes) -> None:  # noqa: ARG002 (answered in the next step)
        self._commands += data
        del self._commands[:-4096]

    def step(self, now_s: float, air: Air) -> bytes:
        if self._on_s is None:
            self._on_s = self._zeroed_s = now_s
        self._cell.breathe(now_s, air.co2_ppm if self._pump else 420.0)
        warming = now_s - self._on_s < self.options.warm_up_s
        if self._was_warming and not warming:
            self._was_warming = False
            self._begin_zero()  # the first thing that a warm SBA-5 does
        said = [self._obey(now_s, air, warming)]
        if self._display is not None:
            said += [self._reading(now_s, air, warming) for _ in range(self._display.passed(now_s))]
        if self._zeroed_s is not None and now_s - self._zeroed_s > self._zero_every_s:
            self._begin_zero()
        said.append(self._zero(now_s))
        return b"".join(said)

    def _obey(self, now_s: float, air: Air, warming: bool) -> bytes:
        """Single letters act at once, strings at their CR; the rest of an unfinished string waits."""
        said = b""
        while self._commands:
            string = _STRING_COMMAND.match(self._commands)
            if string is not None:
                said += self._set(string[1], int(string[2]))
                del self._commands[: string.end()]
                continue
            letter = bytes(self._commands[:1])
            if letter in b"ACP" and b"\r" not in self._commands[:8] and len(self._commands) < 8:
                break
            del self._commands[:1]
            if letter == b"!":
                self._display = None
            elif letter == b"Z" and not warming:
                self._begin_zero()
            elif letter == b"M":
                said += self._reading(now_s, air, warming)
        return said

    def _set(self, letter: bytes, value: int) -> bytes:
        if letter == b"P":
            self._pump = value != 0
        elif letter == b"A":
            self._zero_every_s = 60.0 * value if value else math.inf
        return letter + str(value).encode() + b"\r\nOK\r\n"

    def _begin_zero(self) -> None:
        if self._zero_ticker is None:
            self._zero_ticker, self._zero_step = Ticker(1.0), 0

    def _zero(self, now_s: float) -> bytes:
        said = b""
        if self._zero_ticker is None:
            return said
        for _ in range(self._zero_ticker.passed(now_s)):
            self._zero_step += 1
            said += b"Z,%d of %d\r\n" % (self._zero_step, self.options.zero_steps)
            if self._zero_step >= self.options.zero_steps:
                self._zero_ticker, self._zeroed_s = None, now_s
                self._cell.zero()
                break
        return said

    def _reading(self, now_s: float, air: Air, warming: bool) -> bytes:
        if warming:
            warmed = (now_s - (self._on_s or now_s)) / self.options.warm_up_s
            return b"W,%.1f\r\n" % (air.temperature_c + (55.0 - air.temperature_c) * warmed)
        if self._zero_ticker is not None:
            return b""
        ppm = self._cell.reading_ppm()
        zero_counts = 50_885
        counts = round(zero_counts * math.exp(-1.126e-4 * ppm))  # Beer-Lambert with the example's numbers
        return b"M %d %d %.2f 55.0 0.0 0.0 %d 55.0 55.0 %02d\r\n" % (
            zero_counts,
            counts,
            ppm,
            round(air.pressure_pa / 100.0),
            self.options.status,
        )
