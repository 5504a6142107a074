"""A pair of links inside one process, for simulations and tests."""

from __future__ import annotations

from flightstack.mavlink.link.byte_link import READ_AT_MOST_BYTES


class _Pipe:
    """What is under way in one direction of a pair."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.closed = False


class MemoryLink:
    """One end of a pair inside one process, for simulations and tests."""

    def __init__(self, name: str, incoming: _Pipe, outgoing: _Pipe, capacity_bytes: int) -> None:
        self.describe = name
        self.reconnects = 0
        self.dropped_bytes = 0
        self._incoming = incoming
        self._outgoing = outgoing
        self._capacity_bytes = capacity_bytes

    @property
    def problem(self) -> str:
        return f"{self.describe}: an end is closed" if self._outgoing.closed else ""

    def read(self) -> bytes:
        data = bytes(self._incoming.data[:READ_AT_MOST_BYTES])
        del self._incoming.data[: len(data)]
        return data

    def write(self, data: bytes) -> None:
        if self._outgoing.closed or len(self._outgoing.data) + len(data) > self._capacity_bytes:
            self.dropped_bytes += len(data)
        else:
            self._outgoing.data += data

    def close(self) -> None:
        self._incoming.closed = self._outgoing.closed = True
        self._incoming.data.clear()


def memory_pair(capacity_bytes: int = READ_AT_MOST_BYTES) -> tuple[MemoryLink, MemoryLink]:
    """Two ends: what is written to one is read from the other; more than `capacity_bytes` unread is dropped."""
    there, back = _Pipe(), _Pipe()
    return (
        MemoryLink("memory:near", back, there, capacity_bytes),
        MemoryLink("memory:far", there, back, capacity_bytes),
    )
