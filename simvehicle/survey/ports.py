"""Ports for the parts of a simulated survey."""

from __future__ import annotations

import random
import socket
import sys
from typing import Final

from mission.documents.yaml_file import DocumentError

LOOPBACK: Final = "127.0.0.1"

_PORTS: Final = range(20_000, 32_000)
"""Below the ports that Linux hands out by itself (net.ipv4.ip_local_port_range: from 32768)."""
_reservations: set[int] = set()


def free_ports(kind: socket.SocketKind, count: int) -> list[int]:
    """Ports that are free on the loopback interface now, all different, for programs that take seconds to open them.

    They are not those that the operating system would choose: it gives those to whoever asks next. On Linux they are
    reserved against every other caller of this function until this process ends.
    """
    ports: list[int] = []
    for port in random.SystemRandom().sample(_PORTS, len(_PORTS)):
        if len(ports) == count:
            return ports
        if _reserved(port) and _is_free(kind, port):
            ports.append(port)
    raise DocumentError(LOOPBACK, f"has no {count} free ports from {_PORTS.start}; end other surveys")


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """One of `free_ports`."""
    return free_ports(kind, 1)[0]


def _reserved(port: int) -> bool:
    """Reserve a port, of any kind; False if it is reserved already. A name without a file goes with its process."""
    if sys.platform != "linux":
        return True
    if port in _reservations:
        return False
    name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        name.bind(f"\0flightstack-port-{port}")
    except OSError:
        name.close()
        return False
    name.detach()  # it stays open until the process ends
    _reservations.add(port)
    return True


def _is_free(kind: socket.SocketKind, port: int) -> bool:
    with socket.socket(socket.AF_INET, kind) as one:
        try:
            one.bind((LOOPBACK, port))
        except OSError:
            return False
    return True
