"""zenoh's configuration of a swarm's nodes and of the router between its sites, by path.

zenoh calls a site a region. In a region everybody is connected to everybody, and a router passes on only what comes
from one region to the others: what a node says is heard once, whether by a connection of its own or through the
router. A router that is told of no regions takes all its peers for one and passes nothing on between them.

Source: https://zenoh.io/docs/getting-started/deployment/ and zenoh's DEFAULT_CONFIG.json5, 1.9 and later.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from flightstack.config import TlsConfig
from flightstack.transport.access_rules import access_rules
from flightstack.transport.endpoints import check_endpoint

LEASE_S: Final = 1.0
"""Silence of a connection after which a peer's host counts as unreachable."""
_LARGEST_MESSAGE_BYTES: Final = 1 << 17
_SENDING_BYTES: Final = 1 << 16
"""A slow radio shall drop old states, not queue seconds of them in the kernel."""


def peer_options(
    listen: Sequence[str], connect: Sequence[str], tls: TlsConfig | None = None, site: str | None = None
) -> dict[str, Any]:
    """Of a drone or a ground station. `TransportError` for an endpoint that cannot be used."""
    for field, endpoints in (("listen", listen), ("connect", connect)):
        for endpoint in endpoints:
            check_endpoint(field, endpoint, tls)
    options: dict[str, Any] = {
        "mode": "peer",
        "listen": {"endpoints": list(listen), "timeout_ms": 0, "exit_on_failure": True},
        "connect": {
            "endpoints": _once_a_pair(listen, connect),
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 250, "period_max_ms": 1000, "period_increase_factor": 2},
        },
        "scouting/gossip": {
            "enabled": not any(endpoint in listen for endpoint in connect),
            "autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
        },
        "scouting/delay": 0,
        "open/return_conditions": {"connect_scouted": False, "declares": False},
    }
    if site is not None:
        options["region_name"] = site
    return options | _links(tls)


def router_options(
    listen: Sequence[str],
    sites: Iterable[str],
    swarm: str,
    members: Iterable[int] = (),
    tls: TlsConfig | None = None,
) -> dict[str, Any]:
    """Of a router that joins the sites of one swarm. With `tls` it believes each node only what is the node's to say.

    `TransportError` for an endpoint that cannot be used.
    """
    for endpoint in listen:
        check_endpoint("listen", endpoint, tls)
    options: dict[str, Any] = {
        "mode": "router",
        "listen": {"endpoints": list(listen)},
        "connect": {"endpoints": []},
        "timestamping/enabled": False,
        "gateway": {"south": [{"filters": [{"region_names": [site]}]} for site in sites]},
    }
    if tls is not None:
        options["access_control"] = access_rules(swarm, members, tls)
    return options | _links(tls)


def _links(tls: TlsConfig | None) -> dict[str, Any]:
    """What a connection is like at both of its ends."""
    options: dict[str, Any] = {
        "scouting/multicast/enabled": False,
        "transport/unicast/open_timeout": 3000,
        "transport/unicast/accept_timeout": 3000,
        "transport/link/tx/lease": round(LEASE_S * 1000.0),
        "transport/link/tx/queue/congestion_control": {
            "drop": {"wait_before_drop": 0},
            "block": {"wait_before_close": 1_000_000},
        },
        "transport/link/tcp": {"so_sndbuf": _SENDING_BYTES},
        "transport/link/rx/max_message_size": _LARGEST_MESSAGE_BYTES,
        "transport/shared_memory/enabled": False,  # a killed process would leave files in /dev/shm
    }
    if tls is not None:
        options["transport/link/protocols"] = ["tls"]
        options["transport/link/tls"] = {
            "root_ca_certificate": tls.authority,
            "listen_private_key": tls.private_key,
            "listen_certificate": tls.certificate,
            "connect_private_key": tls.private_key,
            "connect_certificate": tls.certificate,
            "enable_mtls": True,
            # Members are known by the authority that signed them; their addresses change with the network.
            "verify_name_on_connect": False,
            "so_sndbuf": _SENDING_BYTES,
        }
    return options


def _once_a_pair(listen: Sequence[str], connect: Sequence[str]) -> list[str]:
    """Where to connect to. A list that names this node itself is every node's: the later ones connect to the earlier.

    Two nodes that connect to each other have two connections, and after one of them hung the other's new
    connection can be taken for a part of the hung one's old session, whose declarations are then missing
    (https://github.com/eclipse-zenoh/zenoh/issues/1886). With one connection a pair that cannot be.
    """
    own = [index for index, endpoint in enumerate(connect) if endpoint in listen]
    return list(connect[: own[0]] if own else connect)


def as_document(options: dict[str, Any]) -> dict[str, Any]:
    """The same as zenoh reads it from a file: a level for each word of a path."""
    document: dict[str, Any] = {}
    for path, value in options.items():
        *levels, last = path.split("/")
        place = document
        for level in levels:
            place = place.setdefault(level, {})
        place[last] = value
    return document
