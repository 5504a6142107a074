"""Where a drone comes down to its slot while somebody hovers there who makes way for nobody."""

from __future__ import annotations

import math

import msgspec
import pytest

from flightstack.config import LimitsConfig
from flightstack.flight.free_places import FreePlaces
from mission.geometry.frames import Vector3
from mission.strategies.contract import Neighbour

SLOT: Vector3 = (20.0, -10.0, -10.0)
LIMITS = LimitsConfig(separation_m=4.0)


def hovering(north_m: float, east_m: float, **changes: object) -> Neighbour:
    neighbour = Neighbour(2, (north_m, east_m, -10.0), (0.0, 0.0, 0.0), 0.2, airborne=True, adrift=True)
    return msgspec.structs.replace(neighbour, **changes)


def away_m(place: Vector3, other: Neighbour) -> float:
    return math.dist(place[:2], other.position_ned_m[:2])


def test_a_slot_in_which_nobody_hovers_is_come_down_to() -> None:
    places = FreePlaces(LIMITS, None, None)
    assert places.to_come_down_at(SLOT, ()) == SLOT
    assert places.to_come_down_at(SLOT, (hovering(30.0, -10.0),)) == SLOT


@pytest.mark.parametrize(
    "change", [{"adrift": False}, {"airborne": False}, {"velocity_ned_mps": (2.0, 0.0, 0.0)}]
)
def test_who_makes_way_has_landed_or_flies_on_is_not_gone_beside(change: dict[str, object]) -> None:
    assert FreePlaces(LIMITS, None, None).to_come_down_at(SLOT, (hovering(20.0, -10.0, **change),)) == SLOT


def test_beside_who_hovers_in_the_slot_and_no_farther_than_it_needs() -> None:
    other = hovering(20.3, -10.2)
    place = FreePlaces(LIMITS, None, None).to_come_down_at(SLOT, (other,))
    assert 5.0 <= away_m(place, other) < 7.5
    assert place[2] == SLOT[2]


def test_the_place_stays_while_the_other_sways_and_the_slot_is_taken_when_it_is_gone() -> None:
    places = FreePlaces(LIMITS, None, None)
    first = places.to_come_down_at(SLOT, (hovering(20.0, -10.0),))
    for k in range(40):
        other = hovering(20.0 + 0.5 * math.cos(k), -10.0 + 0.5 * math.sin(k))
        assert places.to_come_down_at(SLOT, (other,)) == first
    assert places.to_come_down_at(SLOT, ()) == SLOT


def test_between_two_that_hover_the_place_is_beside_both() -> None:
    others = hovering(18.0, -10.0), hovering(24.0, -10.0, drone=3)
    place = FreePlaces(LIMITS, None, None).to_come_down_at(SLOT, others)
    assert all(away_m(place, other) >= 5.0 for other in others)
