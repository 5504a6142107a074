"""Flight recordings: MCAP files of JSON messages, and MAVLink `.tlog` files.

Both are only ever appended to, one whole record after the other, so that what a killed process or a crashed drone
leaves behind can be read up to the last record written. MCAP: https://mcap.dev/spec; tlog: eight bytes of
big-endian microseconds since 1970, then the frame, as Mission Planner, QGroundControl and MAVProxy write it.
"""

from __future__ import annotations

import dataclasses
import itertools
import logging
import os
import pathlib
import struct
import time
from collections.abc import Iterator
from typing import Any, Final

import msgspec
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from flightstack.recording import named_json
from flightstack.recording.background_file import BackgroundFile, RecordingError

__all__ = [
    "GAP",
    "FlightRecorder",
    "Record",
    "RecordingError",
    "TlogWriter",
    "read_recording",
    "restore",
    "unused",
]

log = logging.getLogger(__name__)

restore = named_json.restore
_TIME_FIELD: Final = "_time_s"
"""The exact time of a record: MCAP's own, whole nanoseconds, is not always the float that the agent got."""
GAP: Final = "/gap"
"""Topic that says that records are missing before this one."""
_AROUND_BYTES: Final = 1024
"""More than a record has around its message, with the topic's own record if it is the first of it."""
_RECORD_AT_MOST_BYTES: Final = 64 << 20
_READ_ERRORS: Final = (McapError, struct.error, msgspec.MsgspecError, ValueError, EOFError, OverflowError)
"""What mcap's reader raises on a record that is cut short or overwritten."""


def unused(path: pathlib.Path) -> pathlib.Path:
    """`path`, or the first of name-2, name-3, … that is not there yet: an old file never stops a new flight."""
    names = itertools.chain((path,), (path.with_stem(f"{path.stem}-{n}") for n in itertools.count(2)))
    return next(name for name in names if not os.path.lexists(name))


class FlightRecorder:
    """Writes messages to an MCAP file, a channel a topic. Nothing in it waits for the disk."""

    def __init__(self, path: pathlib.Path | str) -> None:
        """A new file at `path`, or next to it if one is there already; `RecordingError` if none can be made."""
        self._file = BackgroundFile(path)
        # No chunks: a chunk is lost whole when its end is missing, and compression would need another library.
        self._writer = Writer(self._file, compression=CompressionType.NONE, use_chunking=False)  # type: ignore[arg-type]
        self._writer.start(library="flightstack")
        self._channels: dict[str, int] = {}
        self._schema: int | None = None
        self._sequence = 0
        self._missing = 0
        """Records since a disk that fell behind took the last one."""
        self._closed = False

    @property
    def path(self) -> pathlib.Path:
        return self._file.path

    @property
    def problem(self) -> str:
        """Why nothing is recorded now; empty when all is well."""
        return self._file.problem

    def record(self, topic: str, time_s: float, message: msgspec.Struct | dict[str, Any]) -> None:
        """Append `message` to `topic` ("/state/3") at `time_s` of the flight's clock; the wall's is added.

        Behind a stretch that the disk could not take stands a record of `GAP` with the number of what is missing.
        """
        if self._closed:
            return
        body = named_json.encode(message)
        if not self._file.takes(len(body) + _AROUND_BYTES):
            self._missing += 1
            return
        missing, self._missing = self._missing, 0
        if missing:
            self.record(GAP, time_s, {"records": missing})
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._register(topic)
        self._sequence += 1
        separator = b"," if len(body) > 2 else b""
        data = b'{"%s":%s%s' % (_TIME_FIELD.encode(), msgspec.json.encode(time_s), separator) + body[1:]
        self._writer.add_message(channel, round(time_s * 1e9), data, time.time_ns(), self._sequence)

    def close(self) -> None:
        """Write what is left and the file's index."""
        if not self._closed:
            self._closed = True
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()

    def _register(self, topic: str) -> int:
        if self._schema is None:
            # Any object: what the fields mean is said by flightstack.wire, and Foxglove asks for some schema.
            self._schema = self._writer.register_schema("flightstack", "jsonschema", b'{"type":"object"}')
        return self._writer.register_channel(topic, "json", self._schema)


@dataclasses.dataclass(frozen=True)
class Record:
    """One message of a recording."""

    topic: str
    time_s: float
    """The flight's clock, exactly as it was given."""
    wall_s: float
    """The machine's clock when it was recorded, seconds since 1970."""
    message: dict[str, Any]
    """Decoded JSON; `restore(record.message, DroneState)` makes the struct of it again."""


def read_recording(path: pathlib.Path | str) -> Iterator[Record]:
    """All records of the MCAP file at `path`, in the order of writing, up to the first that is not whole.

    `RecordingError` if it cannot be read or is no MCAP file.
    """
    try:
        stream = pathlib.Path(path).open("rb")  # noqa: SIM115 (closed by the `with` below, where reading may fail)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    with stream:
        records = _decoded(StreamReader(stream, record_size_limit=_RECORD_AT_MOST_BYTES))
        try:
            next(records)
        except (*_READ_ERRORS, StopIteration) as error:
            raise RecordingError(f"{path}: is no MCAP file, or not even its first record is whole") from error
        try:
            for record in records:
                if record is not None:
                    yield record
        except _READ_ERRORS:
            log.warning("%s: the recording breaks off; what comes after cannot be read", path)


def _decoded(reader: StreamReader) -> Iterator[Record | None]:
    """The messages in order; None for the file's other records."""
    topics: dict[int, str] = {}
    for record in reader.records:
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        if isinstance(record, Message) and record.channel_id in topics:
            yield _decode(topics[record.channel_id], record)
        else:
            yield None


def _decode(topic: str, record: Message) -> Record:
    message = msgspec.json.decode(record.data, type=dict[str, Any])
    time_s = msgspec.convert(message.pop(_TIME_FIELD, record.log_time / 1e9), float)
    return Record(topic, time_s, record.publish_time / 1e9, message)


class TlogWriter:
    """Writes the MAVLink frames of one link to a `.tlog` file. Nothing in it waits for the disk."""

    def __init__(self, path: pathlib.Path | str, unix_at_zero_s: float | None = None) -> None:
        """`unix_at_zero_s`: seconds since 1970 when the flight's clock was 0; None: as the first frame tells."""
        self._file = BackgroundFile(path)
        self._unix_at_zero_s = unix_at_zero_s

    @property
    def problem(self) -> str:
        """Why nothing is recorded now; empty when all is well."""
        return self._file.problem

    def write(self, time_s: float, frame: bytes) -> None:
        """Append one whole MAVLink frame that was sent or received at `time_s` of the flight's clock."""
        if self._unix_at_zero_s is None:
            self._unix_at_zero_s = time.time() - time_s
        microseconds = max(0, round((self._unix_at_zero_s + time_s) * 1e6))
        self._file.write(struct.pack(">Q", microseconds) + frame)

    def close(self) -> None:
        self._file.close()
