"""The model of the radio: what is lost over which distance, and what a file may say of it."""

from __future__ import annotations

import itertools
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightstack.transport.radio_model import OUT_OF_REACH_LOSS, LinkBudget, RadioModel
from flightstack.transport.terrain import Ridge

budgets = st.builds(
    LinkBudget,
    transmit_dbm=st.floats(-30.0, 60.0),
    path_loss_exponent=st.floats(1.5, 6.0),
    sensitivity_dbm=st.floats(-150.0, -20.0),
    shadowing_db=st.floats(0.1, 20.0),
)


@pytest.mark.parametrize(("distance_m", "lost"), [(100.0, 0.0), (300.0, 0.005), (500.0, 0.05), (1000.0, 0.5)])
def test_the_default_radio_reaches_as_far_as_is_said_of_it(distance_m: float, lost: float) -> None:
    assert LinkBudget().loss(distance_m) == pytest.approx(lost, rel=0.15, abs=1e-4)


def test_power_falls_by_ten_times_the_exponent_for_tenfold_distance_and_starts_from_free_space() -> None:
    budget = LinkBudget(transmit_dbm=20.0, antennas_dbi=0.0, frequency_hz=2.44e9, path_loss_exponent=3.0)
    assert budget.received_dbm(1.0) == pytest.approx(20.0 - 40.19, abs=0.02)  # Friis at 1 m, 12.29 cm of wave
    assert budget.received_dbm(10.0) - budget.received_dbm(100.0) == pytest.approx(30.0)
    assert budget.received_dbm(0.0) == budget.received_dbm(1.0)


def test_the_curve_stays_near_the_normal_distribution_that_it_stands_for() -> None:
    budget = LinkBudget(shadowing_db=5.0)
    for distance_m in range(50, 2000, 50):
        margin_db = budget.received_dbm(distance_m) - budget.sensitivity_dbm
        normal = 0.5 * math.erfc(margin_db / 5.0 / math.sqrt(2.0))
        assert abs(budget.loss(distance_m) - normal) < 0.0096


@given(budget=budgets, distances_m=st.lists(st.floats(0.0, 1e6), min_size=2, max_size=10))
def test_loss_is_a_probability_that_never_falls_with_the_distance(
    budget: LinkBudget, distances_m: list[float]
) -> None:
    losses = [budget.loss(distance_m) for distance_m in sorted(distances_m)]
    assert all(before <= after for before, after in itertools.pairwise(losses))
    assert all(0.0 <= loss <= OUT_OF_REACH_LOSS or loss == 1.0 for loss in losses)


@given(budget=budgets, distance_m=st.floats(0.0, 1e5), more_db=st.floats(0.0, 30.0))
def test_more_power_never_loses_more(budget: LinkBudget, distance_m: float, more_db: float) -> None:
    stronger = msgspec.structs.replace(budget, transmit_dbm=budget.transmit_dbm + more_db)
    assert stronger.loss(distance_m) <= budget.loss(distance_m)


def test_a_ridge_takes_everything_and_the_budget_its_share() -> None:
    ridge = Ridge(crest_ned_m=((50.0, -100.0, -30.0), (50.0, 100.0, -30.0)))
    model = RadioModel(ridges=(ridge,), link_budget=LinkBudget())
    assert model.loss_between((0.0, 0.0, -10.0), (600.0, 0.0, -10.0)) == 1.0
    high = (0.0, 0.0, -100.0), (600.0, 0.0, -100.0)
    assert model.loss_between(*high) == LinkBudget().loss(600.0)
    assert RadioModel(ridges=(ridge,)).loss_between(*high) == 0.0


@pytest.mark.parametrize(
    ("written", "field"),
    [
        ({"loss": 1.0}, "loss"),
        ({"los": 0.1}, "los"),
        ({"delay_s": -1.0}, "delay_s"),
        ({"range_m": 0.0}, "range_m"),
        ({"duplication": 1.5}, "duplication"),
        ({"bandwidth_bytes_per_s": 0.0}, "bandwidth_bytes_per_s"),
        ({"bandwidth_bytes_per_s": math.nan}, "bandwidth_bytes_per_s"),
        ({"queue_bytes": -1}, "queue_bytes"),
        ({"dead_links": [[1]]}, "dead_links"),
        ({"link_budget": {"shadowing_db": 0.0}}, "link_budget.shadowing_db"),
        ({"link_budget": {"sensitivity_dbm": math.inf}}, "link_budget.sensitivity_dbm"),
        ({"link_budget": {"power": 3.0}}, "power"),
        ({"ridges": [{"crest_ned_m": [[0.0, 0.0, -5.0]]}]}, "ridges[0].crest_ned_m"),
        ({"ridges": [{"crest_ned_m": [[0.0, 0.0], [1.0, 1.0]]}]}, "ridges[0].crest_ned_m"),
    ],
)
def test_what_cannot_be_is_refused_with_its_field(written: dict[str, object], field: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(written, RadioModel)
    assert field in str(caught.value)


def test_everything_that_can_be_written() -> None:
    written = {
        "loss": 0.1,
        "link_budget": {},
        "range_m": 500,
        "ridges": [{"crest_ned_m": [[0, 0, -5], [1, 1, -5.5]]}],
        "dead_links": [[1, 2], [3, "ground"]],
        "bandwidth_bytes_per_s": 12500,
        "queue_bytes": 0,
    }
    model = msgspec.convert(written, RadioModel)
    assert model.link_budget == LinkBudget()
    assert model.dead_links == ((1, 2), (3, "ground"))
    assert model.ridges[0].crest_ned_m == ((0.0, 0.0, -5.0), (1.0, 1.0, -5.5))
