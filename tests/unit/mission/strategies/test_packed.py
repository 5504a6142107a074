"""What strategies tell each other as bytes, and what a broken or strange node cannot make them believe."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.estimation.estimates import Reading
from mission.strategies.contract import Neighbour, Order, Stage, neighbour_arrays
from mission.strategies.locus.note import LocusNote, note_of, noted
from mission.strategies.packed import Packed

READING = Reading(2, 7, (1.0, 2.0, -10.0), 40.0, 4.0)
NOTE = LocusNote(12.5, (3.0, 4.0, -10.0), READING, 3)
ORDER = Order(7, Stage.TRACK, (1.0, 2.0, -10.0), 0.5)
NAN, INF = math.nan, math.inf


class Stranger(msgspec.Struct, frozen=True, array_like=True, tag="stranger"):
    radius_m: float = 1.0


class Untagged(msgspec.Struct, frozen=True, array_like=True):
    radius_m: float = 1.0


def test_a_note_comes_back_from_the_order_that_carries_it() -> None:
    assert note_of(noted(ORDER, NOTE)) == NOTE
    assert len(noted(ORDER, NOTE).note) < 150
    assert note_of(ORDER) == LocusNote()


def test_a_struct_needs_a_tag_to_be_packed() -> None:
    with pytest.raises(TypeError, match="Untagged needs a tag"):
        Packed(Untagged)


def test_one_strategy_does_not_read_anothers_bytes() -> None:
    assert Packed(Stranger).unpack(noted(ORDER, NOTE).note) is None
    assert Packed(LocusNote).unpack(Packed(Stranger).pack(Stranger())) is None
    assert Packed(Stranger).unpack(Packed(Stranger).pack(Stranger(2.0))) == Stranger(2.0)


@pytest.mark.parametrize(
    "fields",
    [
        (INF, None, None, 0),
        (NAN, None, None, 0),
        (5.0, (0.0, 1e9, 0.0), None, 0),
        (5.0, None, READING, -(2**62)),
        (5.0, None, msgspec.structs.replace(READING, excess_co2_ppm=0.0), 0),
        (5.0, None, msgspec.structs.replace(READING, variance_ppm2=INF), 0),
        (5.0, None, msgspec.structs.replace(READING, variance_ppm2=NAN), 0),
        (5.0, None, msgspec.structs.replace(READING, position_ned_m=(0.0, NAN, 0.0)), 0),
    ],
)
def test_a_note_that_cannot_be_is_none(fields: tuple[object, ...]) -> None:
    order = msgspec.structs.replace(ORDER, note=msgspec.msgpack.encode(("locus", *fields)))
    assert note_of(order) == LocusNote()


@given(st.binary(max_size=200))
def test_any_bytes_are_a_note_or_none(data: bytes) -> None:
    assert isinstance(note_of(msgspec.structs.replace(ORDER, note=data)), LocusNote)


def test_neighbours_as_arrays() -> None:
    neighbours = (
        Neighbour(2, (1.0, 2.0, -10.0), (0.1, 0.2, 0.0), 0.3, True),
        Neighbour(5, (4.0, 5.0, -11.0), (0.0, 0.0, 0.5), 0.6, False),
    )
    arrays = neighbour_arrays(neighbours)
    assert arrays.drone.tolist() == [2, 5]
    np.testing.assert_array_equal(arrays.position_ned_m, [[1.0, 2.0, -10.0], [4.0, 5.0, -11.0]])
    np.testing.assert_array_equal(arrays.velocity_ned_mps, [[0.1, 0.2, 0.0], [0.0, 0.0, 0.5]])
    assert arrays.age_s.tolist() == [0.3, 0.6]
    assert neighbour_arrays(()).position_ned_m.shape == (0, 3)
