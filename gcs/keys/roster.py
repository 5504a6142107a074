"""Who belongs to a fleet, and where: the file `fleet.yaml` of its directory."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from flightstack.config import DroneId, NodeName, Section, SiteName
from flightstack.transport import TransportError
from flightstack.transport.access_rules import common_name, name_clashes
from flightstack.transport.endpoints import check_endpoint
from gcs.errors import GroundError

AUTHORITY = "authority"
"""The name of the bundle that stays on the ground; nobody else may have it."""
ROUTER_FILE = "zenohd.json5"
"""In the router's bundle, in the place of `swarm.yaml`."""
Host = Annotated[str, Meta(min_length=1)]
"""Name or IP address at which a node is reached."""
_LONGEST_NAME = 48
"""Of a common name's 64 letters, less what stands before it in the authority's."""
Port = Annotated[int, Meta(ge=1, le=65535)]


class FleetNode(Section, frozen=True, kw_only=True):
    name: NodeName
    """As in its certificate: "drone-3", or a station's name."""
    host: Host
    """Address at which the others reach it."""
    site: SiteName | None = None


class Site(Section, frozen=True, kw_only=True):
    """Nodes that reach each other directly."""

    router: Host
    """Address at which they reach the router to the other sites."""
    nodes: tuple[NodeName, ...]
    """As in their certificates: "drone-3", "ground"."""


class FleetRoster(Section, frozen=True, kw_only=True):
    """Who belongs to a fleet; drones in the order in which they take the formation's slots."""

    swarm: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]+$")]
    drones: dict[DroneId, Host]
    """Id: address at which the others reach it."""
    stations: dict[NodeName, Host]
    port: Port = 7447
    router: NodeName | None = None
    """Joins the `sites`, to one of which every node belongs then."""
    router_port: Port = 7448
    """Another than the nodes', so that it can run beside a ground station."""
    sites: dict[SiteName, Site] = msgspec.field(default_factory=dict)

    def nodes(self) -> list[FleetNode]:
        """Everybody, in the order in which connections are made (`swarm.connect`)."""
        named = [*self.stations.items(), *((common_name(drone), host) for drone, host in self.drones.items())]
        return [FleetNode(name=name, host=host, site=self.site_of(name)) for name, host in named]

    def site_of(self, name: str) -> str | None:
        return next((site for site, facts in self.sites.items() if name in facts.nodes), None)

    def everybody(self) -> list[str]:
        """The names of all who have a bundle."""
        return [*(node.name for node in self.nodes()), *([self.router] if self.router is not None else [])]

    def with_nodes(
        self, drones: dict[int, str], stations: dict[str, str], site: str | None, router_host: str | None
    ) -> FleetRoster:
        """The same with more nodes, all at one `site`. `router_host`: where a new site reaches the router; as the
        first one does if None."""
        sites = dict(self.sites)
        if site is not None:
            known = self.sites.get(site) or Site(
                router=router_host or next(iter(self.sites.values())).router, nodes=()
            )
            names = (*known.nodes, *map(common_name, drones), *stations)
            sites[site] = Site(router=router_host or known.router, nodes=names)
        return msgspec.structs.replace(
            self, drones=self.drones | drones, stations=self.stations | stations, sites=sites
        )


def check_fleet(fleet: FleetRoster) -> None:
    for problem in name_clashes(
        list(fleet.stations), [AUTHORITY, *([fleet.router] if fleet.router is not None else [])]
    ):
        raise GroundError(f"stations and routers: {problem}")
    if len(fleet.swarm) > _LONGEST_NAME:
        raise GroundError(
            f"the swarm's name is longer than {_LONGEST_NAME} letters; certificates hold no more"
        )
    for name in fleet.everybody():
        if len(name) > _LONGEST_NAME:
            raise GroundError(f"{name} is longer than {_LONGEST_NAME} letters; certificates hold no more")
    if not fleet.drones:
        raise GroundError("a fleet has at least one drone")
    _check_sites(fleet)
    hosts: dict[tuple[str | None, str], str] = {}
    for node in fleet.nodes():
        other = hosts.setdefault((node.site, node.host), node.name)
        if other != node.name:
            raise GroundError(f"{other} and {node.name} have the same address {node.host}; give each its own")
        _check_host(node.name, node.host)


def _check_sites(fleet: FleetRoster) -> None:
    if fleet.router is None:
        if fleet.sites:
            raise GroundError("several sites are joined by a router; name it")
        return
    for name, site in fleet.sites.items():
        _check_host(f"the router of site {name}", site.router)
    known = [node.name for node in fleet.nodes()]
    placed = [name for site in fleet.sites.values() for name in site.nodes]
    for name in known:
        if placed.count(name) != 1:
            raise GroundError(
                f"{name} is at {placed.count(name)} sites; with a router every node is at one (--site)"
            )
    for name in placed:
        if name not in known:
            raise GroundError(f"{name} is at a site, but not in this fleet")


def _check_host(name: str, host: str) -> None:
    try:
        check_endpoint("connect", f"tcp/{bracketed(host)}:1", None)
    except TransportError as error:
        raise GroundError(f"{name}: {host!r} is no address of a host") from error


def bracketed(host: str) -> str:
    """As it stands in an endpoint."""
    return f"[{host}]" if ":" in host else host
