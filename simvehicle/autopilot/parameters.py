"""Parameters as the two autopilots keep them and as MAVLink carries them.

https://mavlink.io/en/services/parameter.html: PARAM_VALUE has one float field. PX4 puts an integer's bytes into
it, ArduPilot casts it to a float.
"""

from __future__ import annotations

import dataclasses
import math
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot import parameter_tables, px4_parameter_table
from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler

_TYPES = {
    "I8": (mavlink.MAV_PARAM_TYPE_INT8, -(2**7), 2**7 - 1),
    "I16": (mavlink.MAV_PARAM_TYPE_INT16, -(2**15), 2**15 - 1),
    "I32": (mavlink.MAV_PARAM_TYPE_INT32, -(2**31), 2**31 - 1),
    "F32": (mavlink.MAV_PARAM_TYPE_REAL32, -math.inf, math.inf),
}
_TABLES = {"ardupilot": (parameter_tables.ARDUPILOT, False), "px4": (px4_parameter_table.PX4, True)}
"""By flavour: the parameters, and whether integers travel byte by byte."""
_UNGROUPED = frozenset(parameter_tables.ARDUPILOT_UNGROUPED.split())
_CUT_OFF = 0.01
"""What ArduPilot adds to a float's amount before it makes an integer of it (AP_Param::set_float)."""
_ALIKE = 1e-4
"""A value that differs from the default by less than this part is taken for the default and not saved."""
HASH = "_HASH_CHECK"
UNASKED = 65535
"""param_index of a PARAM_VALUE that answers no request for an index."""


class UnknownParameterError(ValueError):
    """A name that this flavour does not have."""


class Parameters:
    """One vehicle's parameters by name; numbers are kept as floats that fit the declared type."""

    def __init__(self, flavour: Literal["ardupilot", "px4"], overrides: Mapping[str, float]) -> None:
        table, self._bytewise = _TABLES[flavour]
        self._types: dict[str, tuple[int, float, float]] = {}
        self._values: dict[str, float] = {}
        self._defaults: dict[str, float] = {}
        """Of what is not in the storage: ArduPilot keeps there only what was once set to something else."""
        for entry in table.split():
            name, _, rest = entry.partition("=")
            number, _, kind = rest.partition(":")
            self._types[name] = _TYPES[kind]
            self._values[name] = float(number)
        self.names = list(self._values)
        self._index = {name: index for index, name in enumerate(self.names)}
        for name, value in overrides.items():
            if name not in self._values:
                raise UnknownParameterError(
                    f"parameters.{name}: the simulated {flavour} has no such parameter"
                )
            self.set(name, value)
        if not self._bytewise:
            self._defaults = {name: self._values[name] for name in self._values if name not in overrides}

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> None:
        """Store a value as the declared type holds it: floats single precision, integers cut off and limited."""
        kind, least, most = self._types[name]
        if kind == mavlink.MAV_PARAM_TYPE_REAL32:
            self._values[name] = struct.unpack("<f", struct.pack("<f", value))[0]
        else:
            whole = math.trunc(value + math.copysign(_CUT_OFF, value))
            self._values[name] = float(max(least, min(most, whole)))

    def encoded(self, name: str) -> tuple[float, int]:
        """The float field and the type field of PARAM_VALUE."""
        kind = self._types[name][0]
        value = self._values[name]
        if self._bytewise and kind != mavlink.MAV_PARAM_TYPE_REAL32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return value, kind

    def decoded(self, name: str, value: float, kind: int) -> float | None:
        """What a PARAM_SET means; None for a type that does not fit or a number that is none."""
        if self._bytewise:
            if kind != self._types[name][0]:
                return None
            if kind != mavlink.MAV_PARAM_TYPE_REAL32:
                return float(struct.unpack("<i", struct.pack("<f", value))[0])
        return value if math.isfinite(value) else None

    def told_unsaved(self, name: str) -> tuple[float, int] | None:
        """ArduPilot's answer to a PARAM_SET of a default that was never anything else: the default, and for members
        of a group the group's type, which MAVLink does not know and calls REAL32 (AP_Param::save_sync). None where
        the parameter is saved and told as it is, from now on.
        """
        default = self._defaults.get(name)
        if default is None:
            return None
        kind, value = self._types[name][0], self._values[name]
        alike = kind != mavlink.MAV_PARAM_TYPE_INT32 and abs(value - default) < _ALIKE * abs(value)
        if value != default and not alike:
            del self._defaults[name]
            return None
        grouped = name not in _UNGROUPED
        return default, mavlink.MAV_PARAM_TYPE_REAL32 if grouped else kind

    def message(self, name: str, index: int | None = None, told: tuple[float, int] | None = None) -> Any:
        """PARAM_VALUE; `told`: a value and a type to tell instead of the parameter's own."""
        value, kind = told or self.encoded(name)
        return mavlink.MAVLink_param_value_message(
            name.encode(), value, kind, len(self.names), self._index[name] if index is None else index
        )

    def hash_message(self) -> Any:
        """The sum over names and values by which a ground station knows that it has them all already."""
        total = 0
        for name in self.names:
            total = zlib.crc32(struct.pack("<f", self.encoded(name)[0]), zlib.crc32(name.encode(), total))
        value = struct.unpack("<f", struct.pack("<I", total))[0]
        return mavlink.MAVLink_param_value_message(
            HASH.encode(), value, mavlink.MAV_PARAM_TYPE_UINT32, len(self.names), UNASKED
        )


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterStyle:
    """How an autopilot answers about its parameters."""

    named_index: int | None
    """param_index of an answer by name; None: the parameter's own."""
    unknown: Callable[[Channel, ChannelPeer, str], None]
    """Somebody asked for a name ("#17": an index) that does not exist."""
    list_requested: Callable[[], None]
    corrects_types: bool = True
    """A PARAM_SET of another type than the parameter's is answered with the value that stays; else with nothing."""
    has_hash: bool = False
    """A sum over all parameters goes before their list, as if it were one."""


class ParameterServer:
    """Answers PARAM_REQUEST_READ, _LIST and PARAM_SET; a list goes out some per step, so as not to flood a link."""

    PER_STEP = 20

    def __init__(
        self,
        parameters: Parameters,
        style: ParameterStyle,
        channels: Sequence[Channel],
        changed: Callable[[str], None],
    ) -> None:
        """`changed`: called with the name of a parameter that somebody set."""
        self._parameters = parameters
        self._style = style
        self._channels = channels
        self._changed = changed
        self._sending: dict[int, int] = {}
        """Link -> index of the next parameter of the list that it asked for."""

    def handlers(self) -> dict[str, Handler]:
        return {
            "PARAM_REQUEST_LIST": self._request_list,
            "PARAM_REQUEST_READ": self._request_read,
            "PARAM_SET": self._set,
        }

    def set(self, name: str, value: float) -> None:
        """Set a parameter that exists, as by a message."""
        self._parameters.set(name, value)
        self._changed(name)

    def step(self) -> None:
        if not self._sending:
            return
        for link, first in list(self._sending.items()):
            names = self._parameters.names[first : first + self.PER_STEP]
            for name in names:
                self._channels[link].send(self._parameters.message(name))
            if first + len(names) >= len(self._parameters.names):
                del self._sending[link]
            else:
                self._sending[link] = first + len(names)

    def _request_list(self, channel: Channel, _peer: ChannelPeer, _message: Any) -> None:
        self._sending[channel.link] = 0
        if self._style.has_hash:
            channel.send(self._parameters.hash_message())
        self._style.list_requested()

    def _request_read(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        names = self._parameters.names
        if message.param_index >= 0:
            if message.param_index >= len(names):
                self._style.unknown(channel, peer, f"#{message.param_index}")
            else:
                channel.send(self._parameters.message(names[message.param_index]))
            return
        name = str(message.param_id)
        if self._style.has_hash and name == HASH:
            channel.send(self._parameters.hash_message())
        elif name in self._parameters:
            channel.send(self._parameters.message(name, self._style.named_index))
        else:
            self._style.unknown(channel, peer, name)

    def _set(self, channel: Channel, peer: ChannelPeer, message: Any) -> None:
        name = str(message.param_id)
        if name not in self._parameters:
            self._style.unknown(channel, peer, name)
            return
        value = self._parameters.decoded(name, message.param_value, message.param_type)
        if value is None and not self._style.corrects_types:
            return
        told = None
        if value is not None:
            self.set(name, value)
            told = self._parameters.told_unsaved(name)
        answer = self._parameters.message(name, self._style.named_index, told)
        for each in self._channels:
            each.send(answer)
