"""The messages that are spoken here: pymavlink's dialect, and what PX4 speaks that is not in it.

PX4 tells an onboard computer by EVENT what it tells a ground station by STATUSTEXT
(https://mavlink.io/en/services/events.html), and its modes by AVAILABLE_MODES and CURRENT_MODE
(https://mavlink.io/en/services/standard_modes.html). Layouts and check-sum bytes are those of MAVLink's common.xml.
"""

from __future__ import annotations

import re
import struct
from typing import Any, ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class AddedMessage(mavlink.MAVLink_message):  # type: ignore[misc]  # pymavlink is not typed
    """One message, in the form of pymavlink's generated classes. The fields are keyword arguments in any order."""

    id: ClassVar[int]
    msgname: ClassVar[str]
    crc_extra: ClassVar[int]
    unpacker: ClassVar[struct.Struct]
    ordered_fieldnames: ClassVar[list[str]]
    """As they lie in the payload."""
    fieldnames: ClassVar[list[str]]
    lengths: ClassVar[list[int]]
    """How many values of each the unpacker gives."""
    array_lengths: ClassVar[list[int]]
    """0 for a number."""

    def __init_subclass__(cls) -> None:
        """The rest follows from the layout: "40B" is an array of forty numbers, "35s" one text of as many bytes."""
        layout = [
            (int(count or 0), code) for count, code in re.findall(r"(\d*)([A-Za-z])", cls.unpacker.format)
        ]
        cls.fieldnames = cls.ordered_fieldnames
        cls.lengths = [1 if code == "s" else max(count, 1) for count, code in layout]
        cls.array_lengths = [count for count, _ in layout]

    def __init__(self, **fields: Any) -> None:
        """Numbers, tuples for arrays of numbers, bytes for texts."""
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._values = [fields[name] for name in self.ordered_fieldnames]
        self.__dict__.update(fields)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        flat: list[Any] = []
        for value in self._values:
            flat += value if isinstance(value, tuple) else (value,)
        packed: bytes = self._pack(mav, self.crc_extra, self.unpacker.pack(*flat), force_mavlink1)
        return packed


class EventMessage(AddedMessage):
    """EVENT: something that happened, told by a number and its arguments; `sequence` counts them."""

    id = 410
    msgname = "EVENT"
    crc_extra = 160
    unpacker = struct.Struct("<IIHBBB40B")
    ordered_fieldnames: ClassVar[list[str]] = [
        "id",
        "event_time_boot_ms",
        "sequence",
        "destination_component",
        "destination_system",
        "log_levels",
        "arguments",
    ]


class CurrentEventSequenceMessage(AddedMessage):
    """CURRENT_EVENT_SEQUENCE: the newest event's number, every few seconds, so that losses are noticed."""

    id = 411
    msgname = "CURRENT_EVENT_SEQUENCE"
    crc_extra = 106
    unpacker = struct.Struct("<HB")
    ordered_fieldnames: ClassVar[list[str]] = ["sequence", "flags"]


class RequestEventMessage(AddedMessage):
    """REQUEST_EVENT: send these events again."""

    id = 412
    msgname = "REQUEST_EVENT"
    crc_extra = 33
    unpacker = struct.Struct("<HHBB")
    ordered_fieldnames: ClassVar[list[str]] = [
        "first_sequence",
        "last_sequence",
        "target_system",
        "target_component",
    ]


class ResponseEventErrorMessage(AddedMessage):
    """RESPONSE_EVENT_ERROR: an event that was asked for is not kept any more."""

    id = 413
    msgname = "RESPONSE_EVENT_ERROR"
    crc_extra = 77
    unpacker = struct.Struct("<HHBBB")
    ordered_fieldnames: ClassVar[list[str]] = [
        "sequence",
        "sequence_oldest_available",
        "target_system",
        "target_component",
        "reason",
    ]


class AvailableModesMessage(AddedMessage):
    """AVAILABLE_MODES: one of an autopilot's modes."""

    id = 435
    msgname = "AVAILABLE_MODES"
    crc_extra = 134
    unpacker = struct.Struct("<IIBBB35s")
    ordered_fieldnames: ClassVar[list[str]] = [
        "custom_mode",
        "properties",
        "number_modes",
        "mode_index",
        "standard_mode",
        "mode_name",
    ]


class CurrentModeMessage(AddedMessage):
    """CURRENT_MODE: the mode, and the one that was asked for."""

    id = 436
    msgname = "CURRENT_MODE"
    crc_extra = 193
    unpacker = struct.Struct("<IIB")
    ordered_fieldnames: ClassVar[list[str]] = ["custom_mode", "intended_custom_mode", "standard_mode"]


MESSAGES: Final[dict[int, Any]] = mavlink.mavlink_map | {
    message.id: message
    for message in (
        EventMessage,
        CurrentEventSequenceMessage,
        RequestEventMessage,
        ResponseEventErrorMessage,
        AvailableModesMessage,
        CurrentModeMessage,
    )
}
"""Every message that can be read and written, by its id."""
