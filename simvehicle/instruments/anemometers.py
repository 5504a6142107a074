"""A TriSonica Mini, an FT205 and a Gill WindSonic (see their modules in `sensors` for protocols and
sources)."""

from __future__ import annotations

import math
from typing import Literal

import msgspec
import numpy as np

from mission.geometry.frames import Vector3
from sensors.instruments.checksums import xor_checksum
from simvehicle.instruments.physics import Ticker
from simvehicle.world.air import Air


class AnemometerEmulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the three have in common; each has its own defaults."""

    sd_mps: float = 0.15
    """Noise of one reading per axis."""
    bias_mps: float = 0.1
    """Standard deviation of the error per axis that a unit keeps."""
    mount_yaw_deg: float = 0.0
    """From the drone's nose to the instrument's north mark, clockwise seen from above."""
    rate_hz: float = 5.0


class Ft205Emulation(AnemometerEmulation, frozen=True, forbid_unknown_fields=True, kw_only=True):
    sd_mps: float = 0.25


class WindSonicEmulation(AnemometerEmulation, frozen=True, forbid_unknown_fields=True, kw_only=True):
    format: Literal["polar", "uv", "nmea"] = "polar"
    rate_hz: float = 4.0


class _Head:
    """The transducers: wind in the instrument's own axes (north mark, east mark, up), with its errors."""

    def __init__(self, options: AnemometerEmulation, rng: np.random.Generator) -> None:
        self._options = options
        self._rng = rng
        self._bias_mps = rng.normal(0.0, options.bias_mps, 3)

    def feel(self, wind_body_mps: Vector3) -> tuple[float, float, float]:
        forward, right, down = wind_body_mps
        turn = math.radians(self._options.mount_yaw_deg)
        north = forward * math.cos(turn) + right * math.sin(turn)
        east = right * math.cos(turn) - forward * math.sin(turn)
        errors = self._bias_mps + self._rng.normal(0.0, self._options.sd_mps, 3)
        north_error, east_error, up_error = errors.tolist()
        return north + north_error, east + east_error, -down + up_error


def _from_deg(north_mps: float, east_mps: float) -> int:
    """Direction that the wind comes from, whole degrees from 0 to 359."""
    return round(math.degrees(math.atan2(-east_mps, -north_mps))) % 360


class TrisonicaEmulator:
    def __init__(self, rng: np.random.Generator, options: AnemometerEmulation | None = None) -> None:
        self.options = options or AnemometerEmulation()
        self._head = _Head(self.options, rng)
        self._ticker = Ticker(1.0 / self.options.rate_hz)

    def receive(self, now_s: float, data: bytes) -> None:
        """It streams whatever it is told; its menu (Ctrl-C) is not for flight."""

    def step(self, now_s: float, air: Air) -> bytes:
        return b"".join(self._line(air) for _ in range(self._ticker.passed(now_s)))

    def _line(self, air: Air) -> bytes:
        north, east, up = self._head.feel(air.wind_body_mps)
        flat = math.hypot(north, east)
        rise_deg = round(math.degrees(math.atan2(up, flat)))
        return (
            f"S {math.hypot(flat, up):05.2f} S2 {flat:05.2f} D {_from_deg(north, east):03d} DV {rise_deg:03d} "
            f"U {east:05.2f} V {north:05.2f} W {up:05.2f} T {air.temperature_c:.2f} H 40.00 "
            f"P {air.pressure_pa / 100.0:.2f}\r\n"
        ).encode()


class Ft205Emulator:
    def __init__(self, rng: np.random.Generator, options: Ft205Emulation | None = None) -> None:
        self.options = options or Ft205Emulation()
        self._head = _Head(self.options, rng)
        self._received = b""

    def receive(self, now_s: float, data: bytes) -> None:  # noqa: ARG002 (answered in the next step)
        self._received = (self._received + data)[-512:]

    def step(self, now_s: float, air: Air) -> bytes:  # noqa: ARG002 (it speaks only when asked)
        *commands, self._received = self._received.split(b"\n")
        return b"".join(self._answer(air) for c in commands if b"WV?" in c)

    def _answer(self, air: Air) -> bytes:
        north, east, _ = self._head.feel(air.wind_body_mps)
        speed = math.hypot(north, east)
        status = "2" if speed > 75.0 else "0"
        body = f"WI,WVP={min(speed, 75.0):05.1f},{_from_deg(north, east):03d},{status}".encode()
        return b"$%s*%02X\r\n" % (body, xor_checksum(body))


class WindSonicEmulator:
    def __init__(self, rng: np.random.Generator, options: WindSonicEmulation | None = None) -> None:
        self.options = options or WindSonicEmulation()
        self._head = _Head(self.options, rng)
        self._ticker = Ticker(1.0 / self.options.rate_hz)

    def receive(self, now_s: float, data: bytes) -> None:
        """It streams as it is configured."""

    def step(self, now_s: float, air: Air) -> bytes:
        return b"".join(self._message(air) for _ in range(self._ticker.passed(now_s)))

    def _message(self, air: Air) -> bytes:
        north, east, _ = self._head.feel(air.wind_body_mps)
        speed = math.hypot(north, east)
        if self.options.format == "nmea":
            body = f"WIMWV,{_from_deg(north, east):03d},R,{speed:06.2f},M,A".encode()
            return b"$%s*%02X\r\n" % (body, xor_checksum(body))
        if self.options.format == "uv":
            body = f"Q,{north:+07.2f},{-east:+07.2f},M,00,".encode()
        else:
            direction = f"{_from_deg(north, east):03d}" if speed >= 0.05 else ""
            body = f"Q,{direction},{speed:06.2f},M,00,".encode()
        return b"\x02%s\x03%02X\r\n" % (body, xor_checksum(body))
