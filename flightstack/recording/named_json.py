"""Messages as JSON that names every field, and back.

On the wire a message is an array of values, because every byte costs. In a recording it is an object with field
names, so that a person and Foxglove can read it and a later version of the software still knows what was meant.
Bytes are base64; numbers come back exactly as they were, except NaN and infinities, which JSON has as null.
"""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec
from msgspec import inspect

T = TypeVar("T")

_encoder = msgspec.json.Encoder()
_known_fields: dict[type, tuple[tuple[str, str], ...]] = {}
_PLAIN = (str, int, float, bytes, bool, type(None))


def encode(message: msgspec.Struct | dict[str, Any]) -> bytes:
    """`message` as a JSON object."""
    return _encoder.encode(_named(message))


def restore(message: Any, kind: type[T]) -> T:
    """The `kind` that `message`, decoded JSON made by `encode`, was made from."""
    return msgspec.convert(_arrays(message, inspect.type_info(kind)), kind)


def _named(value: Any) -> Any:
    kind = type(value)
    if kind in _PLAIN:
        return value
    if kind in (tuple, list):
        return [_named(item) for item in value]
    if kind is dict:
        return {key: _named(item) for key, item in value.items()}
    if isinstance(value, msgspec.Struct):
        return {key: _named(getattr(value, name)) for name, key in _fields(kind)}
    return value  # an enum, a date: what msgspec writes by itself


def _fields(kind: type[msgspec.Struct]) -> tuple[tuple[str, str], ...]:
    """Attribute and encoded name of every field."""
    fields = _known_fields.get(kind)
    if fields is None:
        fields = tuple(zip(kind.__struct_fields__, kind.__struct_encode_fields__, strict=True))
        _known_fields[kind] = fields
    return fields


def _arrays(value: Any, kind: inspect.Type) -> Any:
    """`value` with the objects that stand for array-like structs turned into arrays again."""
    if isinstance(kind, inspect.UnionType):
        return _arrays(value, _member(value, kind))
    if isinstance(kind, inspect.StructType) and isinstance(value, dict):
        named = {
            field.encode_name: _arrays(value[field.encode_name], field.type)
            for field in kind.fields
            if field.encode_name in value
        }
        # A field that an older recording does not have ends the array: fields are only appended, with defaults.
        tag = [] if kind.tag is None else [kind.tag]
        return [*tag, *named.values()] if kind.array_like else named
    if isinstance(kind, inspect.VarTupleType | inspect.ListType) and isinstance(value, list):
        return [_arrays(item, kind.item_type) for item in value]
    if isinstance(kind, inspect.TupleType) and isinstance(value, list):
        return [_arrays(item, item_kind) for item, item_kind in zip(value, kind.item_types, strict=True)]
    if isinstance(kind, inspect.DictType) and isinstance(value, dict):
        return {key: _arrays(item, kind.value_type) for key, item in value.items()}
    return value


def _member(value: Any, union: inspect.UnionType) -> inspect.Type:
    """The member of a union that `value` can be; unions here are "X or None" or differ in their JSON type."""
    for kind in union.types:
        if isinstance(kind, inspect.StructType | inspect.DictType) and isinstance(value, dict):
            return kind
        if isinstance(kind, inspect.VarTupleType | inspect.ListType | inspect.TupleType) and isinstance(
            value, list
        ):
            return kind
    return inspect.AnyType()
