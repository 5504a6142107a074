"""A link on which only signed frames go in and out: around any other, for who need not know of signatures.

Frames come out of it as they came in, with their signatures: whoever reads them steps over those.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Final

from flightstack.mavlink.framing import V2_MAGIC, FrameFinder, pack_frame
from flightstack.mavlink.link.byte_link import ByteLink
from flightstack.mavlink.signing import SignatureVerdict
from flightstack.mavlink.signing_store import SigningStore

log = logging.getLogger(__name__)

OLD_FOR_S: Final = 10.0
"""Old timestamps end when the sender hears ours; if they do not, it is told."""
_TOLD_AT_MOST: Final = 64


class SignedLink:
    """A `ByteLink`. Who is not believed is told once for each system and reason, in one line."""

    def __init__(
        self,
        link: ByteLink,
        store: SigningStore,
        number: int,
        *,
        tells: bool = True,
        real_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`number` (0 to 255) is another one for each link and program that signs as our system and component.
        `tells`: in the log; it stands in `problem` in any case until somebody is believed."""
        self._link = link
        self._store = store
        self._number = number
        self._tells = tells
        self._real_s = real_s
        self._incoming, self._outgoing = FrameFinder(known_only=True), FrameFinder(known_only=True)
        self._told: set[tuple[int, SignatureVerdict]] = set()
        self._old_since_s: dict[int, float] = {}
        self._complaint = ""
        self._believed = False

    @property
    def describe(self) -> str:
        return self._link.describe

    @property
    def problem(self) -> str:
        return self._link.problem or ("" if self._believed else self._complaint)

    @property
    def reconnects(self) -> int:
        return self._link.reconnects

    @property
    def dropped_bytes(self) -> int:
        return self._link.dropped_bytes

    def read(self) -> bytes:
        data = self._link.read()
        if not data:
            return b""
        self._store.advance()
        believed = bytearray()
        for frame in self._incoming.find(data):
            verdict = self._store.signing.judge(frame)
            if verdict.is_good:
                believed += frame.data
                self._believed = self._believed or verdict is SignatureVerdict.SIGNED
                self._old_since_s.pop(frame.system, None)
            elif self._is_to_be_told(frame.system, verdict):
                self._tell(frame.system, verdict)
        return bytes(believed)

    def write(self, data: bytes) -> None:
        """Whole frames, or pieces of them: each goes out once it is whole, but for what the dialect does not know."""
        self._store.advance()
        signed = bytearray()
        for frame in self._outgoing.find(data):
            kind, sequence, system, component, payload, plain = frame
            if plain[0] != V2_MAGIC:  # MAVLink 1 has no place for a signature
                plain = pack_frame(kind, sequence, system, component, payload)
            signed += self._store.signing.sign(plain, self._number)
        if signed:
            self._link.write(bytes(signed))

    def close(self) -> None:
        self._link.close()
        self._store.release()

    def _is_to_be_told(self, system: int, verdict: SignatureVerdict) -> bool:
        if (system, verdict) in self._told or len(self._told) >= _TOLD_AT_MOST:
            return False
        if verdict in (SignatureVerdict.UNSIGNED, SignatureVerdict.OTHER_KEY):
            return True
        return self._real_s() - self._old_since_s.setdefault(system, self._real_s()) > OLD_FOR_S

    def _tell(self, system: int, verdict: SignatureVerdict) -> None:
        self._told.add((system, verdict))
        text = f"{self.describe}: system {system} {_REASONS[verdict].format(key=self._store.path, system=system)}"
        self._complaint = self._complaint or text
        if self._tells:
            log.warning("link %s", text)


_MENDED: Final = "gcs signing setup {key} --drone {system} --link PATH,BAUD"
_OLD: Final = (
    "signs with timestamps that are past, and is ignored: somebody repeats what was recorded, or it does not hear us "
    "and its clock is behind"
)
_REASONS: Final = {
    SignatureVerdict.UNSIGNED: (
        f"does not sign, and is ignored; if it is ours, give it the key over a cable: {_MENDED}"
    ),
    SignatureVerdict.OTHER_KEY: (
        "signs with another key than {key}, and is ignored; if it is ours, copy its key's file, or give it this key "
        f"over a cable: {_MENDED} --old-key FILE"
    ),
    SignatureVerdict.REPEATED: _OLD,
    SignatureVerdict.STALE: _OLD,
}
