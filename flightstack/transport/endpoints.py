"""What a zenoh endpoint looks like in a configuration file; checked without zenoh, before anything is opened."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from flightstack.config import SwarmConfig, TlsConfig
from flightstack.transport import TransportError

_ENDPOINT: Final = re.compile(
    r"(?P<protocol>tcp|udp|tls|quic)/(?:\[[0-9a-fA-F:.%\w]+\]|[^\s/:#?\[\]]+):(?P<port>\d{1,5})(?:[?#]\S*)?"
)


def check_endpoint(field: str, endpoint: str, tls: TlsConfig | None) -> None:
    """`TransportError` if `endpoint`, of the list `swarm.FIELD`, cannot be used as it is written."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or int(match["port"]) > 65535:
        raise TransportError(f'swarm.{field}: {endpoint!r} is no endpoint; write it as "tcp/10.0.0.3:7447"')
    if tls is not None and match["protocol"] != "tls":
        raise TransportError(
            f'swarm.{field}: {endpoint} is not encrypted although swarm.tls is set; write "tls/…"'
        )
    if tls is None and match["protocol"] in ("tls", "quic"):
        raise TransportError(f"swarm.{field}: {endpoint} needs swarm.tls with the certificates")


def endpoint_problems(swarm: SwarmConfig) -> Iterator[tuple[str, str]]:
    """What is wrong with the endpoints of a configuration file: (field, what, how to mend it)."""
    for field, endpoints in (("listen", swarm.listen), ("connect", swarm.connect)):
        for index, endpoint in enumerate(endpoints):
            try:
                check_endpoint(field, endpoint, swarm.tls)
            except TransportError as error:
                yield f"swarm.{field}[{index}]", str(error).removeprefix(f"swarm.{field}: ")


def faulty_field(error: TransportError) -> str:
    """The field of a configuration file that is to blame where the network cannot be joined."""
    return "swarm.tls" if str(error).startswith("swarm.tls") else "swarm.listen"
