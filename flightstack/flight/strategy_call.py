"""Asking the strategy, which is never trusted: what it does wrong must not end the agent that flies the drone."""

from __future__ import annotations

import traceback

import numpy as np

from flightstack.swarm.admission import flaw
from mission.strategies.contract import Decision, Hold, Observation, Strategy


def consult(strategy: Strategy, observation: Observation, rng: np.random.Generator) -> tuple[Decision, str]:
    """The strategy's decision and "", or a hold and why the drone cannot go on with this strategy.

    All members run the same strategy on the same knowledge: an error that ended the root's agent would end its
    heir's next, and so the whole swarm's in the air. Instead the drone says so and goes home.
    """
    try:
        decision = strategy.decide(observation, rng)
    except Exception as error:  # noqa: BLE001 (any defect of any strategy; it is told, not swallowed)
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{where.filename.rpartition('/')[2]}:{where.lineno}"
        return Decision(Hold()), f"the strategy failed: {type(error).__name__}: {error} ({place})"
    problem = flaw(decision)
    return (Decision(Hold()), f"the strategy failed: {problem}") if problem else (decision, "")
