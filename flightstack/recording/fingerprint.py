"""One number for what left the drone in a tick."""

from __future__ import annotations

import zlib

import msgspec

from flightstack.agent import Outputs


def fingerprint(outputs: Outputs) -> int:
    """Differs where what two ticks send differs. The agent's status stays on the drone and does not count."""
    sent = (outputs.autopilot, outputs.ports, outputs.peers, outputs.events)
    return zlib.crc32(msgspec.msgpack.encode(sent))
