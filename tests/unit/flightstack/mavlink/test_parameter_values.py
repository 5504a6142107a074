"""Types of parameters: what fits them, and how a value travels."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_values import (
    INTEGER_TYPES,
    decode,
    encode,
    is_same,
    number_text,
    single,
    value_problem,
)

INT8, INT32, REAL32 = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_REAL32,
)
BOTH = (Flavour.ARDUPILOT, Flavour.PX4)


@pytest.mark.parametrize("kind", INTEGER_TYPES)
@pytest.mark.parametrize("flavour", BOTH)
def test_an_integer_that_has_no_problem_arrives_as_it_is(flavour, kind):
    _, _, least, most = INTEGER_TYPES[kind]
    for value in (least, least + 1, -1, 0, 1, 5, most - 1, most):
        if value_problem(flavour, kind, value) is None:
            carried = single(encode(flavour, kind, value))
            # A byte-wise integer may look like a NaN, of which only the bytes count.
            assert struct.pack("<f", carried) == struct.pack("<f", encode(flavour, kind, value))
            assert decode(flavour, kind, carried) == value
    for beyond in (least - 1, most + 1):
        assert "is within" in str(value_problem(flavour, kind, beyond))


@pytest.mark.parametrize(
    ("flavour", "kind", "value", "says"),
    [
        (Flavour.ARDUPILOT, INT8, 300.0, "cannot be 300: it is within -128 to 127 (int8)"),
        (Flavour.PX4, INT32, 3e9, "cannot be 3000000000: it is within -2147483648 to 2147483647 (int32)"),
        (Flavour.ARDUPILOT, INT32, 16_777_217.0, "carries 24 bits, and would become 16777216"),
        (Flavour.ARDUPILOT, INT32, 99_999_999.0, "would become 100000000"),
        (Flavour.ARDUPILOT, REAL32, 16_777_217.0, "would become 16777216"),
        (Flavour.PX4, REAL32, 16_777_217.0, "would become 16777216"),
        (Flavour.ARDUPILOT, INT8, 0.5, "is an integer (int8) and cannot be 0.5"),
        (Flavour.PX4, INT32, 0.5, "is an integer (int32) and cannot be 0.5"),
        (Flavour.ARDUPILOT, REAL32, 1e39, "ends at 3.4e38"),
        (Flavour.ARDUPILOT, REAL32, 1e-60, "does not tell that from 0"),
        (Flavour.PX4, INT32, -5_000_000.0, "its bytes do not survive the way"),
        (Flavour.ARDUPILOT, REAL32, math.nan, "cannot be nan"),
        (Flavour.PX4, INT32, -math.inf, "cannot be -inf"),
    ],
)
def test_what_a_type_does_not_take_is_said(flavour, kind, value, says):
    assert says in str(value_problem(flavour, kind, value))


def test_what_a_type_takes_is_no_problem():
    assert value_problem(Flavour.PX4, INT32, 16_777_217.0) is None, "byte by byte all 32 bits arrive"
    assert value_problem(Flavour.ARDUPILOT, INT32, 16_777_216.0) is None
    assert value_problem(Flavour.ARDUPILOT, INT32, 2.0**30) is None, "large, but of few bits"
    assert value_problem(Flavour.ARDUPILOT, REAL32, 0.1) is None, "fractions are rounded as everywhere"


def test_integers_are_the_same_only_if_they_are():
    assert not is_same(INT32, 16_777_216.0, 16_777_217.0)
    assert is_same(REAL32, 0.1, single(0.1))
    assert not is_same(REAL32, 0.1, 0.10001)


@pytest.mark.parametrize(
    ("value", "text"),
    [(single(0.1), "0.1"), (2147483647.0, "2147483647"), (1e8, "100000000"), (-1.0, "-1"),
     (single(2.15593e-05), "2.15593e-05"), (single(95460.1), "95460.1"), (single(1e20), "1e+20")],
)  # fmt: skip
def test_numbers_are_written_as_short_as_they_are_exact(value, text):
    assert number_text(value) == text


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_every_number_is_read_back(value):
    assert single(float(number_text(value))) == value
