"""How a command of the operator joins the swarm: by the ground station's file, or by a name and an endpoint."""

from __future__ import annotations

import dataclasses
import pathlib
import secrets
import socket
from collections.abc import Sequence

from flightstack.config import TlsConfig
from flightstack.recording.clock import WallClock
from flightstack.swarm.topics import TOPICS
from flightstack.transport import Transport
from gcs.errors import GroundError
from gcs.plans.checks import load_fence
from gcs.station_config import AlarmLimits, GroundConfig, load
from mission.geometry.frames import LocalFrame
from mission.geometry.geofence import Geofence, LocalFence

RECEIVED = tuple(TOPICS.values())
"""What a ground station listens to."""


@dataclasses.dataclass(frozen=True)
class Connection:
    """Everything that a short-lived command needs to know of the swarm."""

    swarm: str
    members: tuple[int, ...]
    connect: tuple[str, ...]
    tls: TlsConfig | None = None
    frame: LocalFrame | None = None
    fence: Geofence | None = None
    alarms: AlarmLimits = dataclasses.field(default_factory=AlarmLimits)
    speedup: float = 1.0
    name: str = "ground"
    station_listens: tuple[str, ...] = ()
    """Endpoints of the running station on this machine: its network is ours."""
    unresolved: tuple[str, ...] = ()
    """Of endpoints whose host has no address now, one sentence each: nobody is reached there."""
    site: str | None = None
    """Where this machine is, if a router joins several sites."""

    def local_fence(self) -> LocalFence | None:
        if self.fence is None or self.frame is None:
            return None
        return LocalFence(self.frame, self.fence)

    def clock(self) -> WallClock:
        return WallClock(self.speedup)

    def node(self, purpose: str) -> str:
        """A name that no other node has: several operators may watch and command at once."""
        return f"{self.name}-{purpose}-{secrets.token_hex(3)}"

    def open(self, node: str) -> Transport:
        """Join the swarm. `TransportError` says what is wrong with the endpoints."""
        from flightstack.transport.zenoh_transport import ZenohTransport

        return ZenohTransport(
            self.swarm, node, self.listen(), self.connect, RECEIVED, self.tls, self.members, self.site
        )

    def listen(self) -> tuple[str, ...]:
        """Where this short-lived node can be reached, at ports that the system chooses.

        It must listen: of two peers that learn of each other by gossip only one connects to the other.
        """
        own = [own_endpoint(endpoint) for endpoint in (self.station_listens or self.connect)]
        return tuple(dict.fromkeys(endpoint for endpoint in own if endpoint is not None))


def from_options(config: pathlib.Path | None, swarm: str | None, connect: Sequence[str]) -> Connection:
    """By `--config`, or by `--swarm` and `--connect`; `--connect` adds to a file's endpoints."""
    if config is not None:
        if swarm is not None:
            raise GroundError("--swarm: give either --config or --swarm with --connect, not both")
        return from_config(load(config), config, _resolved(connect))
    if swarm is None:
        raise GroundError("which swarm? give --config ground.yaml, or --swarm NAME --connect tcp/HOST:PORT")
    if not connect:
        raise GroundError("--connect: give at least one endpoint of the swarm, as tcp/HOST:PORT")
    return Connection(swarm, (), _resolved(connect))


def _resolved(connect: Sequence[str]) -> tuple[str, ...]:
    """What was given on the command line; `GroundError` where there is no such host."""
    for endpoint in connect:
        problem = _host_problem(endpoint)
        if problem is not None:
            raise GroundError(f"--connect {endpoint}: {problem}")
    return tuple(connect)


def _host_problem(endpoint: str) -> str | None:
    """Why the host of an endpoint has no address; None where it has one, or where it is no endpoint at all."""
    host, _, port = _host_and_port(endpoint)
    if not host or not port.isdecimal():
        return None
    try:
        socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)
    except (OSError, ValueError) as error:  # a name with an empty or overlong label is a UnicodeError
        reason = getattr(error, "strerror", None) or "it is no name of a host"
        return f"no host is called {host!r} ({reason})"
    return None


def _host_and_port(endpoint: str) -> tuple[str, str, str]:
    """Host, protocol and port as they are written."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
    return host.strip("[]"), protocol, port


def from_config(config: GroundConfig, file: pathlib.Path, connect: Sequence[str] = ()) -> Connection:
    """The running station owns `swarm.listen`; a command connects to it there, and to all others."""
    endpoints = (*map(reachable, config.swarm.listen), *config.swarm.connect, *connect)
    if not endpoints:
        raise GroundError(
            f"{file}: swarm: no endpoint to reach the swarm at; add swarm.connect or swarm.listen"
        )
    problems = {endpoint: _host_problem(endpoint) for endpoint in endpoints}
    return Connection(
        config.swarm.name,
        config.swarm.members,
        tuple(dict.fromkeys(endpoints)),
        config.swarm.tls,
        LocalFrame(config.origin),
        load_fence(config, file),
        config.alarms,
        config.speedup,
        config.station,
        config.swarm.listen,
        tuple(f"{file}: {endpoint}: {problem}" for endpoint, problem in problems.items() if problem),
        config.swarm.site,
    )


def own_endpoint(endpoint: str) -> str | None:
    """An endpoint of this machine, port chosen by the system, in the network that leads to `endpoint`.

    None where no way leads there: what cannot be reached cannot connect to us either.
    """
    host, protocol, port = _host_and_port(endpoint)
    if host in ("0.0.0.0", "::"):  # noqa: S104 (the station's own choice, repeated)
        return f"{protocol}/{_bracketed(host)}:0"
    try:
        family, _, _, _, target = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect(target)  # sends nothing: only asks the routing table
            return f"{protocol}/{_bracketed(str(probe.getsockname()[0]))}:0"
    except (OSError, ValueError):
        return None


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def reachable(endpoint: str) -> str:
    """The endpoint to connect to where a node of this machine listens at `endpoint`."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
