"""Which device or port every address in a configuration file takes: none can be had twice.

Links are written as pymavlink does, instruments' ports as pyserial does, endpoints of the network as zenoh does.
"""

from __future__ import annotations

import os
import re
import urllib.parse
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

_LINK: Final = re.compile(r"(udpin|udpout|tcp|tcpin):(.+):(\d{1,5})")
_ENDPOINT: Final = re.compile(r"(tcp|udp|tls|quic)/(.+):(\d{1,5})(?:[?#].*)?")
_EVERYWHERE: Final = ("", "0.0.0.0", "::")  # noqa: S104 (looked for, not bound)
_WRAPPED: Final = ("spy://", "alt://")
"""pyserial's URLs around a device's path."""


class Claim(NamedTuple):
    field: str
    """Of the configuration file."""
    written: str
    kind: str
    """What is taken: "device", a waiting "udp" or "tcp" port, or the "server" at the other end."""
    host: str
    place: str
    """The device's path or the port's number."""

    def clashes(self, other: Claim) -> bool:
        if (self.kind, self.place) != (other.kind, other.place):
            return False
        waits = self.kind in ("udp", "tcp")
        return self.host == other.host or (waits and bool({self.host, other.host} & set(_EVERYWHERE)))


def link_claim(field: str, link: str) -> Iterator[Claim]:
    """What an autopilot's link takes."""
    if match := _LINK.fullmatch(link):
        kind = {"udpin": "udp", "tcpin": "tcp"}.get(match[1], "server")
        yield from _socket(field, link, kind, match[2], match[3])
    elif link.partition(",")[0]:
        yield _device(field, link, link.partition(",")[0])


def port_claim(field: str, port: str) -> Iterator[Claim]:
    """What an instrument's port takes."""
    if port == "mavlink" or port.startswith("loop://"):
        return
    if port.startswith(("socket://", "rfc2217://")):
        parts = urllib.parse.urlsplit(port)
        yield from _socket(field, port, "server", parts.hostname or "", str(parts.port))
    elif port.startswith(_WRAPPED):
        yield _device(field, port, port.partition("://")[2].partition("?")[0])
    else:
        yield _device(field, port, port)


def endpoint_claim(field: str, endpoint: str) -> Iterator[Claim]:
    """What listening on an endpoint of the network takes."""
    if match := _ENDPOINT.fullmatch(endpoint):
        kind = "tcp" if match[1] in ("tcp", "tls") else "udp"
        yield from _socket(field, endpoint, kind, match[2], match[3])


def clashes(claims: Iterable[Claim]) -> Iterator[tuple[str, str]]:
    """(field, what is wrong and how to mend it) of every claim of what another has already."""
    before: list[Claim] = []
    for claim in claims:
        other = next((one for one in before if claim.clashes(one)), None)
        if other is not None:
            what = "device" if claim.kind == "device" else "port"
            how = (
                "stands twice" if claim.written == other.written else f"is the same {what} as {other.written}"
            )
            yield (
                claim.field,
                f"{claim.written} {how}: {other.field} has that {what} already; give each its own",
            )
        before.append(claim)


def _device(field: str, written: str, path: str) -> Claim:
    # Two names of one device: by symbolic links (/dev/serial/by-id/…) where they are there, else by their spelling.
    return Claim(field, written, "device", "", os.path.realpath(path) if "/" in path else path.upper())


def _socket(field: str, written: str, kind: str, host: str, port: str) -> Iterator[Claim]:
    if int(port) == 0:  # whichever is free
        return
    host = host.strip("[]").lower()
    yield Claim(field, written, kind, "127.0.0.1" if host in ("localhost", "::1") else host, str(int(port)))
