"""Host names and ports to addresses, and sockets that wait on them."""

from __future__ import annotations

import socket

from flightstack.mavlink.link.byte_link import LinkError


def resolve(
    text: str, host: str, port: int, kind: socket.SocketKind
) -> tuple[socket.AddressFamily, tuple[str, int]]:
    """Address family and address of `host`. Asked once: a name server may take seconds."""
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except OSError as error:
        raise LinkError(f"link {text!r}: no host is called {host!r} ({error.strerror})") from error
    # "localhost" may be ::1 first, where no autopilot waits.
    family, _, _, _, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, (str(address[0]), int(address[1]))


def bound_socket(text: str, host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    """A non-blocking socket that waits on `host`:`port`."""
    family, address = resolve(text, host, port, kind)
    bound = socket.socket(family, kind)
    try:
        if kind is socket.SOCK_STREAM:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
    except OSError as error:
        bound.close()
        raise LinkError(
            f"link {text!r}: cannot wait on port {port}: {error.strerror}; "
            "end the other process or choose another port or address"
        ) from error
    bound.setblocking(False)
    return bound
