"""What a simulated drone is made of, as it stands in a fleet's file."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from flightstack.config import Section
from mission.geometry.frames import Vector3
from simvehicle.vehicle.range_finder import RangeFinderConfig


class EmulatedInstrument(Section, frozen=True, kw_only=True):
    name: str
    type: str
    port: str
    """"HOST:PORT" of the TCP socket that the instrument's bytes come out of (agents open socket://HOST:PORT)."""


class VehicleSpec(Section, frozen=True, kw_only=True):
    id: Annotated[int, Meta(ge=1, le=250)]
    flavour: Literal["ardupilot", "px4"] = "ardupilot"
    home_north_m: float = 0.0
    home_east_m: float = 0.0
    links: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Each as pymavlink writes it, seen from the vehicle: "udpout:127.0.0.1:14541", "udpin:…", "tcpin:…"."""
    signing_key: str | None = None
    """File with the key that its autopilot was given, its path relative to this file's directory: it signs, and
    believes nothing that is not signed. None: it signs nothing until it is given one."""
    usb_links: tuple[int, ...] = ()
    """Which of `links` (0 is the first) are cables at the autopilot's USB port, where it needs no signature."""
    instruments: tuple[EmulatedInstrument, ...] = ()
    range_finder: RangeFinderConfig | None = None
    """A sensor that sees obstacles around it, and says on the first link what it sees."""
    quiet: bool = False
    """A PX4 sends its companion (the first link) 18 kB/s that nobody asked for. Quiet: 1 kB/s, as on other links."""
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    """Parameters that differ from the flavour's defaults."""

    @property
    def home_ned_m(self) -> Vector3:
        return self.home_north_m, self.home_east_m, 0.0
