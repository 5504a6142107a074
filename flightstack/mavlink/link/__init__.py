"""Byte links to an autopilot or a ground station: UDP, TCP, serial, and a pair in memory.

A link is read and written once a tick and never waits. What breaks is opened again by itself, with growing pauses;
`problem` says what is wrong meanwhile. What the operating system does not take now waits in a small buffer, and what
does not fit there is dropped whole and counted.
"""

from __future__ import annotations

from flightstack.mavlink.link.byte_link import ByteLink, LinkError
from flightstack.mavlink.link.named_link import check_link, open_link

__all__ = ["ByteLink", "LinkError", "check_link", "open_link"]
