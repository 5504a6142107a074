"""What the nodes of a fleet are configured with: a drone's or station's `swarm` section, and the router's file."""

from __future__ import annotations

import json

import msgspec
import yaml

from flightstack.config import TlsConfig
from flightstack.transport.zenoh_options import as_document, router_options
from gcs.keys.roster import AUTHORITY, FleetNode, FleetRoster, bracketed


def swarm_section(fleet: FleetRoster, node: FleetNode) -> str:
    """The `swarm` section of a node's configuration file, YAML."""
    endpoints = [_endpoint(other.host, fleet.port) for other in fleet.nodes() if other.site == node.site]
    section: dict[str, object] = {"name": fleet.swarm, "members": list(fleet.drones)}
    if node.site is not None:
        section["site"] = node.site
        # First: of the list each node connects to those before itself.
        endpoints.insert(0, _endpoint(fleet.sites[node.site].router, fleet.router_port))
    section |= {
        "listen": [_endpoint(node.host, fleet.port)],
        "connect": endpoints,
        "tls": msgspec.to_builtins(_files(fleet, node.name)),
    }
    return yaml.safe_dump({"swarm": section}, sort_keys=False, default_flow_style=None, width=110)


def router_file(fleet: FleetRoster, name: str) -> str:
    """The configuration file of the fleet's router, JSON5."""
    listen = (f"tls/[::]:{fleet.router_port}",)  # an address at which others reach it need not be its own
    options = router_options(listen, fleet.sites, fleet.swarm, fleet.drones, _files(fleet, name))
    return (
        "// Of a zenoh router, 1.9 or later: zenohd -c zenohd.json5, started in this directory.\n"
        "// gcs fleet writes it anew when the fleet changes; the router has to be started again then.\n"
        f"{json.dumps(as_document(options), indent=2)}\n"
    )


def _files(fleet: FleetRoster, name: str) -> TlsConfig:
    """`swarm.tls` of a node whose files lie beside each other."""
    return TlsConfig(
        authority=f"{AUTHORITY}.pem",
        certificate=f"{name}.pem",
        private_key=f"{name}.key",
        stations=tuple(fleet.stations),
        routers=() if fleet.router in (None, name) else (str(fleet.router),),
    )


def _endpoint(host: str, port: int) -> str:
    return f"tls/{bracketed(host)}:{port}"
