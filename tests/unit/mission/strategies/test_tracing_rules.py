"""Casting, chemotaxis, anemotaxis, fluxotaxis: which way a robot goes from what it senses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from mission.geometry.formation import Hexagonal
from mission.strategies.registry import find, make
from mission.strategies.tick_rule import WORD, OwnSenses, numbers
from mission.strategies.tracing.swarming import (
    CAST_EAST,
    CAST_NORTH,
    FLIPPED_S,
    GAS,
    STATE_SIZE,
    WIND_EAST,
    WIND_NORTH,
    WORD_SIZE,
    SwarmingParameters,
    formation_share,
)

PARAMETERS = SwarmingParameters()
R = PARAMETERS.spacing_m


def senses(**known: float) -> OwnSenses:
    usual = dict.fromkeys(OwnSenses._fields, 0.0) | {"interval_s": 1.2, "elapsed_s": 12.0}
    return OwnSenses(**(usual | known))


def neighbour(north_m: float, east_m: float, gas: float = 0.0, wind: tuple[float, float] = (0.0, 0.0)) -> Any:
    row = np.zeros(WORD + WORD_SIZE)
    row[0], row[1] = north_m, east_m
    row[WORD + GAS], row[WORD + WIND_NORTH], row[WORD + WIND_EAST] = gas, *wind
    return row


class Robot:
    """One robot with its memory."""

    def __init__(self, name: str, parameters: SwarmingParameters = PARAMETERS) -> None:
        rule = find(name).ticks
        assert rule is not None
        self.rule = rule.rule
        self.state = np.zeros(STATE_SIZE)
        self.word = np.zeros(WORD_SIZE)
        self.parameters = numbers(parameters)

    def step(self, *rows: Any, **known: float) -> tuple[float, float]:
        table = np.array(rows).reshape(-1, WORD + WORD_SIZE)
        return self.rule(
            senses(**known), table, len(table), np.zeros(0), self.state, self.word, self.parameters
        )


def test_the_formation_force_is_zero_at_the_spacing_and_the_papers() -> None:
    assert formation_share(R, R) == 0.0
    for away_m in (0.3, 0.6, 1.0, 2.0):
        force = R / away_m**2 - R**1.7 / away_m**2.7
        assert formation_share(R, away_m) == pytest.approx(R * force)
    assert formation_share(R, 0.5 * R) < 0.0 < formation_share(R, 1.2 * R)


def test_a_swarm_of_another_size_flies_alike() -> None:
    ten = Robot("fluxotaxis", SwarmingParameters(spacing_m=10 * R, range_m=10.0, speed_mps=2.0))
    one = Robot("fluxotaxis")
    rows = [neighbour(0.5, 0.3, 2.0, (0.1, 0.2)), neighbour(-0.7, 0.1, 3.0, (-0.2, 0.3))]
    far = [row.copy() for row in rows]
    for row in far:
        row[:2] *= 10.0
    assert ten.step(*far) == pytest.approx(20.0 * np.array(one.step(*rows)))


def test_casting_goes_along_a_diagonal_and_turns_where_it_is_held() -> None:
    robot = Robot("casting")
    first = np.array(robot.step(draw=0.3))
    assert np.abs(first) == pytest.approx([0.1 * math.sqrt(0.5)] * 2)
    north, east = first
    on = robot.step(velocity_north_mps=north, velocity_east_mps=east)
    assert on == pytest.approx(first)
    turned = robot.step(velocity_north_mps=0.0, velocity_east_mps=east)  # a wall lies across
    assert turned == pytest.approx((-north, east))
    corner = robot.step(velocity_north_mps=0.0, velocity_east_mps=0.0)
    assert corner == pytest.approx((north, -east))


def test_a_neighbour_ahead_is_no_wall() -> None:
    robot = Robot("casting")
    north, east = robot.step(draw=0.3)
    before = (robot.word[CAST_NORTH], robot.word[CAST_EAST])
    robot.step(neighbour(4.0 * north, 4.0 * east))
    assert (robot.word[CAST_NORTH], robot.word[CAST_EAST]) == before
    patient = Robot("casting", SwarmingParameters(held_s=3.0))
    patient.step(draw=0.3)
    for _ in range(2):
        patient.step()
        assert (patient.word[CAST_NORTH], patient.word[CAST_EAST]) == before
    patient.step()
    assert (patient.word[CAST_NORTH], patient.word[CAST_EAST]) == (-before[0], -before[1])


def test_the_swarm_casts_as_its_newest_turn_says() -> None:
    robot = Robot("casting")
    flown = robot.step(draw=0.1)
    for cast_north, cast_east, flipped_s, joined in ((-1.0, 1.0, 5.0, True), (1.0, 1.0, 4.0, False)):
        other = neighbour(R, 0.0)
        other[WORD + CAST_NORTH], other[WORD + CAST_EAST] = cast_north, cast_east
        other[WORD + FLIPPED_S] = flipped_s
        flown = robot.step(other, velocity_north_mps=flown[0], velocity_east_mps=flown[1])
        assert ((robot.word[CAST_NORTH], robot.word[CAST_EAST]) == (cast_north, cast_east)) is joined
    silent = neighbour(R, 0.0)
    silent[WORD + FLIPPED_S] = 9.0
    robot.step(silent, velocity_north_mps=flown[0], velocity_east_mps=flown[1])
    assert (robot.word[CAST_NORTH], robot.word[CAST_EAST]) == (-1.0, 1.0)


def test_chemotaxis_follows_only_who_reads_more() -> None:
    rows = (neighbour(0.0, R, 2.0), neighbour(R, 0.0, 3.0))
    assert Robot("chemotaxis").step(*rows, gas=1.0) == pytest.approx((0.1, 0.0))
    casts = Robot("casting").step(*rows, gas=4.0, draw=0.6)
    assert Robot("chemotaxis").step(*rows, gas=4.0, draw=0.6) == casts
    assert Robot("chemotaxis").step(neighbour(0.0, 1.01, 9.0), draw=0.6) == Robot("casting").step(draw=0.6)


def test_anemotaxis_goes_against_the_wind_where_there_is_gas() -> None:
    wind = {"wind_north_mps": 0.3, "wind_east_mps": -0.4}
    assert Robot("anemotaxis").step(gas=1.0, **wind) == pytest.approx((-0.06, 0.08))
    assert Robot("anemotaxis").step(draw=0.6, **wind) == Robot("casting").step(draw=0.6)
    assert Robot("anemotaxis").step(gas=1.0, draw=0.6) == Robot("casting").step(draw=0.6)


def test_fluxotaxis_goes_to_the_largest_influx_then_outflux_then_up_the_gradient() -> None:
    inflowing = neighbour(R, 0.0, 1.0, (-1.0, 0.0))
    more = neighbour(-R, 0.0, 3.0, (1.0, 0.0))
    leaving = neighbour(0.0, R, 9.0, (0.0, 1.0))
    assert Robot("fluxotaxis").step(inflowing, more, leaving) == pytest.approx((-0.1, 0.0))
    less = neighbour(-R, 0.0, 3.0, (-1.0, 0.0))
    assert Robot("fluxotaxis").step(less, leaving) == pytest.approx((0.0, 0.1))
    calm = (neighbour(R, 0.0, 1.0), neighbour(0.0, -R, 2.0))
    assert Robot("fluxotaxis").step(*calm, gas=0.5) == pytest.approx((0.0, -0.1))
    # Every direction of wind and neighbour: the sign is that of the flow towards the robot.
    for bearing_rad in np.arange(0.1, 6.2, 0.5):
        there = R * math.cos(bearing_rad), R * math.sin(bearing_rad)
        flow = -math.cos(bearing_rad), -math.sin(bearing_rad)
        rows = (neighbour(*there, 1.0, flow), neighbour(-there[0], -there[1], 5.0))
        assert Robot("fluxotaxis").step(*rows) == pytest.approx(0.1 * np.array(there) / R)


def test_fluxotaxis_of_a_few_is_anemotaxis() -> None:
    wind = {"wind_north_mps": 0.3, "wind_east_mps": -0.4}
    row = neighbour(R, 0.0, 9.0, (-1.0, 0.0))
    assert Robot("fluxotaxis").step(row, gas=1.0, **wind) == pytest.approx((-0.06, 0.08))
    far = neighbour(0.0, 1.01, 9.0, (0.0, -1.0))
    assert Robot("fluxotaxis").step(row, far, gas=1.0, **wind) == pytest.approx((-0.06, 0.08))


@pytest.mark.parametrize("name", ["casting", "chemotaxis", "anemotaxis", "fluxotaxis"])
def test_they_fly_and_refuse_what_is_no_parameter(name: str) -> None:
    assert make(name, layout=Hexagonal(10.0), spacing_m=8.0, range_m=10.0, speed_mps=2.0)
    with pytest.raises(ValueError, match=f"strategy {name}: spacing_m: "):
        make(name, layout=Hexagonal(10.0), spacing_m=0.0)
