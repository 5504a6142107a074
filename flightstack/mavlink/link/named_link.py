"""Links by the text that a person writes."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable

from flightstack.mavlink.link.byte_link import ByteLink, LinkError
from flightstack.mavlink.link.serial_link import SerialLink
from flightstack.mavlink.link.tcp_link import TcpClientLink, TcpServerLink
from flightstack.mavlink.link.udp_link import UdpInLink, UdpOutLink


def open_link(text: str) -> ByteLink:
    """The link that `text` names, as pymavlink writes it; `LinkError` where that cannot be.

    `udpin:HOST:PORT` waits for datagrams and answers to those who sent lately; `udpout:HOST:PORT` sends first;
    `tcp:HOST:PORT` connects, as often as needed; `tcpin:HOST:PORT` waits for one client, the newest;
    `PATH,BAUD` is a serial port, which must be there at the start and may come and go later.
    """
    return _opener(text)()


def check_link(text: str) -> None:
    """`LinkError` if `text` names no link; nothing is opened."""
    _opener(text)


def _opener(text: str) -> Callable[[], ByteLink]:
    if match := re.fullmatch(r"(\w+):(.+):(\d{1,5})", text):
        kinds: dict[str, Callable[[str, str, int], ByteLink]] = {
            "udpin": UdpInLink,
            "udpout": UdpOutLink,
            "tcp": TcpClientLink,
            "tcpin": TcpServerLink,
        }
        kind, host, port = match[1], match[2].strip("[]"), int(match[3])
        if kind in kinds and 0 <= port <= 65535:
            return functools.partial(kinds[kind], text, host, port)
        if kind == "udp":
            raise LinkError(
                f"link {text!r}: say udpin:{host}:{port} to wait there, udpout:{host}:{port} to send"
            )
    elif match := re.fullmatch(r"([^,:]+),(\d{1,8})", text):
        return functools.partial(SerialLink, text, match[1], int(match[2]))
    elif text.startswith("/dev/"):
        raise LinkError(f"link {text!r}: the baud rate is missing; write it as {text.rstrip(',')},57600")
    raise LinkError(
        f"link {text!r} is none of udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, PATH,BAUD"
    )
