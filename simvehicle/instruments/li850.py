"""A LI-COR LI-850 (see `sensors.instruments.li850` for its protocol and the sources)."""

from __future__ import annotations

import re

import msgspec
import numpy as np

from simvehicle.instruments.physics import GasCell, GasResponse, Ticker
from simvehicle.world.air import Air

_OUTRATE = re.compile(rb"<outrate>([0-9.]{1,6})</outrate>", re.IGNORECASE)


class Li850Emulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    lag_s: float = 1.5
    noise_ppm: float = 0.5
    range_ppm: float = 20_000.0
    drift_ppm_per_sqrt_hour: float = 0.4
    warm_up_s: float = 0.0


class Li850Emulator:
    def __init__(self, rng: np.random.Generator, options: Li850Emulation | None = None) -> None:
        o = self.options = options or Li850Emulation()
        response = GasResponse(
            o.lag_s, o.noise_ppm, o.range_ppm, 1e-4, drift_ppm_per_sqrt_hour=o.drift_ppm_per_sqrt_hour
        )
        self._cell = GasCell(response, rng)
        self._rng = rng
        self._received = b""
        self._ticker = Ticker(1.0)
        self._on_s: float | None = None

    def receive(self, now_s: float, data: bytes) -> None:  # noqa: ARG002 (answered in the next step)
        self._received = (self._received + data)[-4096:]

    def step(self, now_s: float, air: Air) -> bytes:
        self._on_s = now_s if self._on_s is None else self._on_s
        self._cell.breathe(now_s, air.co2_ppm)
        *commands, self._received = self._received.split(b"\n")
        said = b""
        for command in commands:
            rate = _OUTRATE.search(command)
            if rate is not None:
                self._ticker = Ticker(max(float(rate[1]), 0.5))
            good = command.strip().lower().endswith(b"</li850>")
            said += b"<li850><ack>%s</ack></li850>\r\n" % (b"TRUE" if good else b"FALSE")
        for _ in range(self._ticker.passed(now_s)):
            said += self._record(now_s, air)
        return said

    def _record(self, now_s: float, air: Air) -> bytes:
        warm = 1.0
        if self.options.warm_up_s > 0.0:
            warm = min((now_s - (self._on_s or 0.0)) / self.options.warm_up_s, 1.0)
        cell_c = air.temperature_c + (51.3 - air.temperature_c) * warm + float(self._rng.normal(0.0, 0.01))
        return (
            f"<li850><data><celltemp>{_exponential(cell_c)}</celltemp>"
            f"<cellpres>{_exponential(air.pressure_pa / 1000.0)}</cellpres>"
            f"<co2>{_exponential(self._cell.reading_ppm())}</co2><h2o>{_exponential(8.1)}</h2o>"
            "</data></li850>\r\n"
        ).encode()


def _exponential(value: float) -> str:
    """A float as the analyser writes it: 4.1234567e2."""
    mantissa, _, exponent = f"{value:.7e}".partition("e")
    return f"{mantissa}e{int(exponent)}"
