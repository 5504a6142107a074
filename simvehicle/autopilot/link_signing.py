"""A vehicle's signing key, the same on all of its links: as in ArduPilot (GCS_Signing.cpp).

The vehicle has no clock of the calendar: its timestamps go on from the newest that it has used or heard.
"""

from __future__ import annotations

from typing import Any

from flightstack.mavlink.framing import MavlinkFrame
from flightstack.mavlink.signing import Signing


class LinkSigning:
    def __init__(self, signing: Signing | None, usb_links: tuple[int, ...]) -> None:
        """`usb_links` are cables at an autopilot's USB port: what comes there is believed without a signature."""
        self._signing = signing
        self._usb_links = frozenset(usb_links)

    @property
    def key(self) -> bytes | None:
        return None if self._signing is None else self._signing.key

    def believes(self, link: int, frame: MavlinkFrame) -> bool:
        """Whether a frame that came on a link counts; each is to be shown once."""
        signing = self._signing
        return signing is None or signing.judge(frame).is_good or link in self._usb_links

    def sign(self, link: int, frame: bytes) -> bytes:
        """One of the vehicle's own frames as it goes out."""
        return frame if self._signing is None else self._signing.sign(frame, link)

    def setup(self, message: Any) -> None:
        """A SETUP_SIGNING with these fields; all zeros take the key away."""
        key, stamp = bytes(message.secret_key), int(message.initial_timestamp)
        self._signing = Signing(key, stamp) if stamp or any(key) else None
