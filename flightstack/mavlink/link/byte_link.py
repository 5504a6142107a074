"""What every byte link promises, and the error of one that cannot be opened as it is written."""

from __future__ import annotations

from typing import Final, Protocol

from flightstack.errors import FlightstackError

READ_AT_MOST_BYTES: Final = 1 << 20
"""Of one call: a flood must not hold the tick."""
CHUNK_BYTES: Final = 1 << 16
"""Of one call of the operating system."""


class LinkError(FlightstackError):
    """A link that cannot be opened as it is written; one line that says what, and how to mend it."""


class ByteLink(Protocol):
    """A two-way stream of bytes that may lose some. None of its methods waits."""

    @property
    def describe(self) -> str:
        """The link as its owner wrote it."""
        ...

    @property
    def problem(self) -> str:
        """Why nothing can go through now, for a person; empty when all is well."""
        ...

    @property
    def reconnects(self) -> int:
        """How often the link was made again after it had been lost."""
        ...

    @property
    def dropped_bytes(self) -> int:
        """What could not be sent and was thrown away."""
        ...

    def read(self) -> bytes:
        """All that has come since the last call, at most 1 MiB."""
        ...

    def write(self, data: bytes) -> None:
        """Send, or keep for a moment, or drop all of `data` and count it."""
        ...

    def close(self) -> None: ...
