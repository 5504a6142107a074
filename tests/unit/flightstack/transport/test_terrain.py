"""Ridges: who is hidden from whom."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.transport.terrain import Ridge
from mission.geometry.frames import Vector3

WALL = Ridge(crest_ned_m=((0.0, -10.0, -20.0), (0.0, 10.0, -20.0)))
"""20 m high, along the east axis."""


@pytest.mark.parametrize(
    ("a", "b", "hidden"),
    [
        ((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), True),
        ((-5.0, 0.0, -19.9), (5.0, 0.0, -19.9), True),
        ((-5.0, 0.0, -20.0), (5.0, 0.0, -20.0), False),  # along the top
        ((-5.0, 0.0, -30.0), (5.0, 0.0, -12.0), False),  # 21 m high where it crosses
        ((-5.0, 0.0, -30.0), (5.0, 0.0, -8.0), True),  # 19 m
        ((-5.0, 0.0, 0.0), (-1.0, 0.0, 0.0), False),  # both on this side
        ((-5.0, 11.0, 0.0), (5.0, 11.0, 0.0), False),  # round its end
        ((-5.0, 10.0, 0.0), (5.0, 10.0, 0.0), True),  # at its end
        ((0.0, -20.0, 0.0), (0.0, 20.0, 0.0), True),  # along it
        ((0.0, -20.0, -40.0), (0.0, 20.0, -2.0), True),  # along it, above its middle, below its end
        ((0.0, -20.0, -40.0), (0.0, 20.0, -20.0), False),
        ((0.0, 11.0, 0.0), (0.0, 20.0, 0.0), False),  # along it, behind its end
        ((1.0, -20.0, 0.0), (1.0, 20.0, 0.0), False),  # beside it
        ((0.0, 0.0, 0.0), (0.0, 0.0, -50.0), False),  # above each other
    ],
)
def test_a_wall(a: Vector3, b: Vector3, hidden: bool) -> None:
    assert WALL.hides(a, b) is hidden
    assert WALL.hides(b, a) is hidden


def test_a_crest_is_as_high_as_its_points_and_straight_between() -> None:
    ridge = Ridge(crest_ned_m=((0.0, 0.0, 0.0), (0.0, 100.0, -100.0), (0.0, 200.0, 0.0)))
    for east_m, above_m in ((25.0, 25.0), (100.0, 100.0), (150.0, 50.0)):
        assert ridge.hides((-9.0, east_m, 0.5 - above_m), (9.0, east_m, 0.5 - above_m))
        assert not ridge.hides((-9.0, east_m, -0.5 - above_m), (9.0, east_m, -0.5 - above_m))


def test_a_piece_without_length_or_straight_up_hides_at_its_height() -> None:
    mast = Ridge(crest_ned_m=((0.0, 0.0, -5.0), (0.0, 0.0, -20.0)))
    assert mast.hides((-5.0, 0.0, -10.0), (5.0, 0.0, -10.0))
    assert not mast.hides((-5.0, 0.0, -21.0), (5.0, 0.0, -21.0))
    assert not mast.hides((-5.0, 0.1, 0.0), (5.0, 0.1, 0.0))


numbers_m = st.floats(-1000.0, 1000.0)
places = st.tuples(numbers_m, numbers_m, numbers_m)
crests = st.lists(places, min_size=2, max_size=6).map(tuple)


@given(crest=crests, a=places, b=places)
def test_whom_i_do_not_see_does_not_see_me(crest: tuple[Vector3, ...], a: Vector3, b: Vector3) -> None:
    assert Ridge(crest_ned_m=crest).hides(a, b) == Ridge(crest_ned_m=crest).hides(b, a)


@given(crest=crests, a=places, b=places, up_m=st.floats(0.01, 3000.0))
def test_who_both_climb_are_never_hidden_by_it(
    crest: tuple[Vector3, ...], a: Vector3, b: Vector3, up_m: float
) -> None:
    ridge = Ridge(crest_ned_m=crest)
    highest_m = -min(point[2] for point in crest)
    assert not ridge.hides((a[0], a[1], -highest_m - up_m), (b[0], b[1], -highest_m - up_m))
    raised = tuple((north, east, down - up_m) for north, east, down in crest)
    assert not ridge.hides(a, b) or Ridge(crest_ned_m=raised).hides(a, b)


@given(
    corner=st.tuples(numbers_m, numbers_m),
    towards=st.tuples(numbers_m, numbers_m),
    ends=st.tuples(numbers_m, numbers_m),
)
def test_nothing_slips_through_where_two_pieces_join(
    corner: tuple[float, float], towards: tuple[float, float], ends: tuple[float, float]
) -> None:
    """A crest from west to east with a corner anywhere, and a line from south to north exactly through the corner."""
    north, east = corner
    crest = ((ends[0], east - 500.0, -10.0), (north, east, -10.0), (ends[1], east + 500.0, -10.0))
    shift_m = towards[0] / 100.0
    below = (north - 5000.0, east - shift_m, 0.0), (north + 5000.0, east + shift_m, 0.0)
    assert Ridge(crest_ned_m=crest).hides(*below)
