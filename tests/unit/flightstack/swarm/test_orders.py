"""Which order counts, and that nobody uses up the numbers."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.swarm.orders import Orders, stopped_anchor
from mission.geometry.formation import make_layout
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import STRIDE, SlotRegister

ROOT, BEFORE = SlotRegister(2, 4, 5), SlotRegister(1, 1, 5)


def order(sequence: int, north_m: float = 0.0) -> Order:
    return Order(sequence, Stage.SEARCH, (north_m, 0.0, -10.0), 0.0)


def test_the_standing_roots_order_counts_before_a_newer_one_of_another() -> None:
    orders = Orders()
    orders.offer(order(3), ROOT, ROOT)
    orders.offer(order(9), BEFORE, ROOT)
    assert (orders.order, orders.ordered_by) == (order(3), ROOT)
    assert orders.next_sequence == 10
    orders.offer(order(4), ROOT, ROOT)
    assert orders.order == order(4)


def test_any_order_counts_until_the_standing_root_has_given_one() -> None:
    orders = Orders()
    orders.offer(order(3), BEFORE, ROOT)
    assert orders.order == order(3)
    orders.offer(order(1), ROOT, ROOT)
    assert orders.order == order(1)


@pytest.mark.parametrize("end", [Stage.FOUND, Stage.GIVE_UP])
@pytest.mark.parametrize("heir_first", [True, False])
def test_the_end_of_a_survey_stands_also_when_its_root_has_been_replaced(
    end: Stage, heir_first: bool
) -> None:
    """The root goes home as soon as it has ordered that; who hears its departure first must not search on."""
    told = [(msgspec.structs.replace(order(3), stage=end), BEFORE), (order(9), ROOT)]
    orders = Orders()
    for one, by in reversed(told) if heir_first else told:
        orders.offer(one, by, ROOT)
    assert orders.order is not None
    assert orders.order.stage is end


def test_an_end_by_a_claim_that_nobody_knows_counts_for_no_more_than_another_order() -> None:
    orders = Orders()
    orders.offer(order(3), ROOT, ROOT)
    orders.offer(msgspec.structs.replace(order(9), stage=Stage.FOUND), SlotRegister(7, 3, 5), ROOT)
    assert orders.order == order(3)


@pytest.mark.parametrize("number", [STRIDE + 10, 2**31 - 1])
def test_a_lie_of_a_great_number_is_not_taken_and_uses_up_a_stride(number: int) -> None:
    orders = Orders()
    orders.offer(order(3), ROOT, ROOT)
    orders.offer(order(number), ROOT, ROOT)
    assert orders.order == order(3)
    assert orders.next_sequence == 3 + STRIDE + 1


def test_one_that_comes_late_catches_up_with_great_numbers() -> None:
    orders = Orders()
    for _ in range(10):
        orders.offer(order(9 * STRIDE), ROOT, ROOT)
    assert orders.order == order(9 * STRIDE)


def test_what_is_known_of_where_the_drones_are_tells_where_the_formation_stopped() -> None:
    layout = make_layout("hexagonal", 10.0)
    moving = order(1, 100.0)
    assert stopped_anchor(moving, layout, {}, {}) == moving.anchor_ned_m
    offset_n, offset_e = layout.offset_m(1)
    where = {5: (40.0 + offset_n, offset_e, -12.0), 6: None}
    assert stopped_anchor(moving, layout, {5: 1, 6: 2}, where) == pytest.approx((40.0, 0.0, -10.0))
