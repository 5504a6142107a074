"""What a drone takes the loss of its radio for, and how patient that makes it."""

from __future__ import annotations

import random

import pytest

from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.reception import CALM_LOSS, MOST_PATIENCE, OUTAGE_S, STATE_PERIOD_S, Reception
from flightstack.swarm.topics import STATE


def heard(reception: Reception, loss: float, seconds: float, *, peers: int = 6, start_s: float = 0.0) -> None:
    chance = random.Random(loss)
    facts: dict[int, PeerFacts] = {}
    for tick in range(round(seconds / STATE_PERIOD_S)):
        now_s = start_s + tick * STATE_PERIOD_S
        for drone in range(peers):
            if chance.random() >= loss:
                facts[drone] = PeerFacts(now_s, True, False, None)
        reception.look(facts)


def test_the_period_is_that_of_states() -> None:
    assert STATE.rate_hz == pytest.approx(1.0 / STATE_PERIOD_S)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3, 0.5])
def test_the_loss_is_seen(loss: float) -> None:
    reception = Reception()
    heard(reception, loss, 60.0)
    assert reception.loss == pytest.approx(loss, abs=0.12)


def test_patience_makes_false_alarms_as_rare_as_at_a_calm_radio() -> None:
    reception = Reception()
    assert reception.patience == 1.0
    heard(reception, 0.3, 60.0)
    misses = 4.0 * reception.patience
    assert reception.loss**misses == pytest.approx(CALM_LOSS**4, rel=1e-6)
    heard(reception, 0.9, 60.0, start_s=100.0)
    assert reception.patience == MOST_PATIENCE


def test_nodes_that_were_away_are_no_loss() -> None:
    reception = Reception()
    heard(reception, 0.0, 10.0)
    heard(reception, 0.0, 10.0, start_s=10.0 + 2.0 * OUTAGE_S)
    assert reception.loss == 0.0
