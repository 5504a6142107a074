"""A Senseair K30 (see `sensors.instruments.k30` for its protocol and the sources)."""

from __future__ import annotations

import msgspec
import numpy as np

from sensors.instruments.checksums import modbus_crc
from simvehicle.instruments.physics import GasCell, GasResponse
from simvehicle.world.air import Air

_REQUEST_BYTES = 8


class K30Emulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    lag_s: float = 20.0
    noise_ppm: float = 3.0
    range_ppm: float = 10_000.0
    drift_ppm_per_sqrt_hour: float = 5.0
    period_s: float = 2.0
    """Between two measurements; a request in between gets the last one again."""
    warm_up_s: float = 0.0
    """It reports "out of range" until then."""
    status: int = 0


class K30Emulator:
    def __init__(self, rng: np.random.Generator, options: K30Emulation | None = None) -> None:
        o = self.options = options or K30Emulation()
        self._cell = GasCell(
            GasResponse(
                o.lag_s, o.noise_ppm, o.range_ppm, 1.0, drift_ppm_per_sqrt_hour=o.drift_ppm_per_sqrt_hour
            ),
            rng,
        )
        self._received = bytearray()
        self._on_s: float | None = None
        self._measured_s: float | None = None
        self._reading = 0

    def receive(self, now_s: float, data: bytes) -> None:  # noqa: ARG002 (answered in the next step)
        self._received += data
        del self._received[:-256]

    def step(self, now_s: float, air: Air) -> bytes:
        self._on_s = now_s if self._on_s is None else self._on_s
        self._cell.breathe(now_s, air.co2_ppm)
        if self._measured_s is None or now_s - self._measured_s >= self.options.period_s - 1e-6:
            self._measured_s, self._reading = now_s, round(self._cell.reading_ppm())
        said = b""
        while len(self._received) >= _REQUEST_BYTES:
            request = bytes(self._received[:_REQUEST_BYTES])
            if modbus_crc(request[:-2]) == request[-2:]:
                said += self._answer(now_s, request)
                del self._received[:_REQUEST_BYTES]
            else:
                del self._received[:1]
        return said

    def _answer(self, now_s: float, request: bytes) -> bytes:
        function, first, count = (
            request[1],
            int.from_bytes(request[2:4], "big"),
            int.from_bytes(request[4:6], "big"),
        )
        warming = now_s - (self._on_s or 0.0) < self.options.warm_up_s
        registers = (self.options.status | (0x20 if warming else 0), 0, 0, self._reading)
        if function != 0x04:
            body = bytes((request[0], function | 0x80, 1))
        elif not 1 <= count <= len(registers) - first:
            body = bytes((request[0], function | 0x80, 2))
        else:
            words = registers[first : first + count]
            body = bytes((request[0], function, 2 * count)) + b"".join(w.to_bytes(2, "big") for w in words)
        return body + modbus_crc(body)
