"""When the swarm holds for its table, and when it goes on all the same."""

from __future__ import annotations

from flightstack.swarm.table_calm import CALM_S, HEAL_LIMIT_S, HELD_S, TableCalm


def test_a_table_that_nobody_changes_holds_nobody() -> None:
    calm = TableCalm()
    calm.look(0.0, somebody_moves=False)
    assert not calm.holds(0.0)
    assert calm.is_steady(0.0)


def test_it_holds_for_a_while_after_a_change_and_the_root_orders_before_that() -> None:
    calm = TableCalm()
    calm.change(10.0)
    calm.look(10.0, somebody_moves=False)
    assert calm.holds(10.0)
    assert not calm.is_steady(10.0 + 0.9 * CALM_S)
    assert calm.is_steady(10.0 + CALM_S)
    calm.look(10.0 + 0.9 * HELD_S, somebody_moves=False)
    assert calm.holds(10.0 + 0.9 * HELD_S)
    calm.look(10.0 + HELD_S, somebody_moves=False)
    assert not calm.holds(10.0 + HELD_S)


def holding_times_s(reason: str, seconds: int) -> list[int]:
    """The seconds in which the swarm holds while there is always a reason."""
    calm = TableCalm()
    held = []
    for now_s in range(seconds):
        if reason == "flapping":
            calm.change(float(now_s))
        calm.settle(reason != "unsettled")
        calm.look(float(now_s), somebody_moves=reason == "moving")
        held += [now_s] * calm.holds(float(now_s))
        assert calm.is_steady(float(now_s)) or now_s < HEAL_LIMIT_S
    return held


def test_nothing_holds_the_swarm_for_ever() -> None:
    limit = round(HEAL_LIMIT_S)
    for reason in ("unsettled", "flapping", "moving"):
        assert holding_times_s(reason, 5 * limit) == list(range(limit)), reason
