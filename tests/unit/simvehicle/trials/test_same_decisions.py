"""The agents' strategy objects in the situations of compiled trials: they decide what the trial decided.

A recorded trial tells where every drone was when it arrived, and so what it read there, and where it was sent next.
The same positions, readings and draws are given to the strategy objects that fly, waypoint after waypoint.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import numba
import numpy as np
import pytest

from mission.estimation.estimates import Reading, Scalar
from mission.geometry.formation import FloatArray
from mission.geometry.frames import Vector3
from mission.strategies.contract import (
    Decision,
    GoTo,
    Neighbour,
    Observation,
    Order,
    OwnState,
    Stage,
    Strategy,
    TreePlace,
)
from mission.strategies.locus.hybrid import AloneNote
from mission.strategies.locus.multi import GroupWord, MultiNote, parted
from mission.strategies.locus.note import LocusNote, noted
from mission.strategies.locus.spiral import arm_spacing_m, spiral_point
from mission.strategies.packed import Packed
from mission.strategies.registry import make
from mission.strategies.spokes import GOLDEN
from simvehicle.trials import randomness
from simvehicle.trials.cell import Cell
from simvehicle.trials.flight import (
    LEG_DRONE,
    LEG_ROW,
    LEG_START,
    LEG_TICKS,
    LEG_X,
    LEG_Y,
    LIMIT_FACTOR,
    read_at,
)
from simvehicle.trials.motion import ROW, TICKS_PER_S, X, Y
from simvehicle.trials.outcome import RecordedTrial, record_trial

SEED = 5
HEIGHT_M = -10.0
PAPER: dict[str, Any] = {
    "start_ned_m": [0.0, 0.0, HEIGHT_M],
    "detection_ppm": 2.0
    ** -20,  # any reading of the trials is contact; a power of two weighs all exactly alike
    "detection_sigmas": 0.0,
    "blocked_s": 0.5,
}
"""Parameters with which a flying strategy decides by the paper's numbers."""
PAPER_LOCUS = PAPER | {"upwind_weight": 0.0, "patience": 0, "return_to_best": False, "even_spiral": False}
PAPER_LOCUS |= {"search_radius_m": 90_000.0}


@numba.njit
def _read_at(scene: Any, row: Any, tick: int) -> float:
    return read_at(scene, row, tick)


_GROUP_WORD = Packed(GroupWord)


class Chance:
    """A trial's stream in the place of an agent's generator."""

    def __init__(self, trial: int, kind: int) -> None:
        self._stream = np.zeros(1, np.uint64)
        randomness.open_stream(self._stream, SEED, trial, kind)
        self.one, self.two = 0.0, np.zeros(2)
        """What the next single draw and the next pair of draws give."""

    def draw(self) -> float:
        return float(randomness.uniform(self._stream))

    def waypoint(self) -> None:
        """Draw as a trial of LoCUS does for every waypoint: two for the step, one for the turn."""
        self.two = np.array([self.draw(), self.draw()])
        self.one = self.draw()

    def random(self, size: int | None = None) -> Any:
        return self.one if size is None else self.two


class Drones:
    """Strategy objects of one (sub-)swarm, where the trial has the drones."""

    def __init__(self, cell: Cell, recorded: RecordedTrial, **parameters: Any) -> None:
        self.members = range(cell.drones)
        self.slots = {drone + 1: drone for drone in self.members}
        self.strategies: list[Strategy] = [
            make(cell.strategy, layout=cell.formation(), **parameters) for _ in self.members
        ]
        self.words = [b""] * cell.drones
        self._scene = recorded.setup.scene
        self._now_s = 0.0

    def decide(
        self,
        rows: FloatArray,
        tick: int,
        order: Order,
        chances: Sequence[Any],
        *,
        only: range | None = None,
        sequence: int | None = None,
    ) -> list[Decision]:
        """What each (of `only` some) decides standing still at its place, up to the root's next order.

        `sequence`: up to that order of the sub-swarm of the first.
        """
        readings: dict[int, Reading] = {}
        drones = only or self.members
        for _ in range(5):  # to arrive, to tell, to hear
            self._now_s += 1.0
            decisions = {
                drone: self.strategies[drone].decide(
                    self._seen(drone, rows, tick, order, readings), chances[drone]
                )
                for drone in drones
            }
            for drone, decision in decisions.items():
                self.words[drone] = decision.word
                if decision.reading is not None and decision.reading.order == order.sequence:
                    readings[drone] = decision.reading
            first = decisions[drones[0]]
            word = _GROUP_WORD.unpack(first.word)
            ordered = word is not None and word.order.sequence == sequence
            if ordered or (sequence is None and first.order is not None):
                return list(decisions.values())
        raise AssertionError("nobody decides")

    def _seen(
        self, drone: int, rows: FloatArray, tick: int, order: Order, readings: dict[int, Reading]
    ) -> Observation:
        still = (0.0, 0.0, 0.0)
        value = _read_at(self._scene, rows[drone], tick)
        own = OwnState(drone + 1, _place(rows[drone]), still, Scalar(value, 0.0, 0.0), None, 0.9)
        others = tuple(
            Neighbour(other + 1, _place(rows[other]), still, 0.1, True, word=self.words[other])
            for other in self.members
            if other != drone
        )
        tree = TreePlace(0, drone, self.slots, None, (), None, None, 1, False)
        return Observation(self._now_s, own, others, tree, order, tuple(readings.values()))


def _place(row: FloatArray) -> Vector3:
    return float(row[X]), float(row[Y]), HEIGHT_M


def _waypoints(legs: FloatArray, first: int, count: int) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """(tick, (n, 2) targets, (n, ROW) motion states where they were) of every waypoint of some drones."""
    own = legs[(legs[:, LEG_DRONE] >= first) & (legs[:, LEG_DRONE] < first + count)]
    for tick in np.unique(own[:, LEG_START]):
        at = own[own[:, LEG_START] == tick]
        assert at[:, LEG_DRONE].tolist() == list(range(first, first + count))
        yield int(tick), at[:, [LEG_X, LEG_Y]], at[:, LEG_ROW : LEG_ROW + ROW]


def _targets(decisions: Sequence[Decision]) -> FloatArray:
    intents = [decision.intent for decision in decisions]
    assert all(isinstance(intent, GoTo) for intent in intents)
    return np.array([intent.position_ned_m[:2] for intent in intents if isinstance(intent, GoTo)])


def _clamped(cell: Cell, targets: FloatArray) -> FloatArray:
    most_m = LIMIT_FACTOR * cell.arena_m
    return np.clip(targets, -most_m, most_m)


def _recorded(cell: Cell, trial: int) -> RecordedTrial:
    recorded = record_trial(cell, SEED, trial)
    assert recorded.row["success"]
    return recorded


def _follow_locus(
    cell: Cell, drones: Drones, order: Order, waypoints: list[Any], chance: Chance, centre: Vector3
) -> list[Stage]:
    """Compare every waypoint of a LoCUS swarm; the stages that were ordered."""
    arms_m = arm_spacing_m(cell.formation().full_levels(cell.drones), cell.r_max_m)
    spiral = np.array([spiral_point(index, arms_m, False) for index in range(600)]) + np.array(centre[:2])
    stages = []
    for (_, targets, _), (tick, after, rows) in itertools.pairwise(waypoints):
        chance.waypoint()
        decisions = drones.decide(rows, tick, order, [chance] * cell.drones)
        decided = decisions[0].order
        assert decided is not None
        np.testing.assert_allclose(_clamped(cell, _targets(decisions)[1:]), targets[1:], atol=1e-9)
        np.testing.assert_allclose(_clamped(cell, _targets(decisions)[:1]), after[:1], atol=1e-9)
        on_spiral = np.linalg.norm(spiral - decided.anchor_ned_m[:2], axis=1).min() < 1e-9
        assert decided.stage is (Stage.SEARCH if on_spiral else Stage.TRACK)
        stages.append(decided.stage)
        order = decided
    return stages


@pytest.mark.parametrize("trial", [0, 1, 2])
def test_locus(trial: int) -> None:
    cell = Cell(drones=6, arena_m=60.0)
    recorded = _recorded(cell, trial)
    chance = Chance(trial, randomness.DECISIONS)
    chance.draw()  # a bearing, for spokes
    centre = (0.0, 0.0, HEIGHT_M)
    order = noted(Order(1, Stage.FORM, centre, math.pi * chance.draw()), LocusNote(0.0, centre))
    drones = Drones(cell, recorded, turn_rad=cell.turn_rad, **PAPER_LOCUS)
    waypoints = list(_waypoints(recorded.legs, 0, cell.drones))
    stages = _follow_locus(cell, drones, order, waypoints, chance, centre)
    assert {Stage.SEARCH, Stage.TRACK} == set(stages)
    assert len(stages) > 20


@pytest.mark.parametrize("trial", [0, 2])
def test_mobs(trial: int) -> None:
    cell = Cell(strategy="mobs", drones=4, arena_m=30.0)
    recorded = _recorded(cell, trial)
    drones = Drones(cell, recorded, radius_m=cell.arena_m, step_m=1.0, **PAPER)
    order = Order(2, Stage.SEARCH, (0.0, 0.0, HEIGHT_M), 0.0, apart=True)
    moths = 0
    for drone in drones.members:
        legs = recorded.legs[recorded.legs[:, LEG_DRONE] == drone]
        chance = Chance(trial, randomness.OWN + drone)
        chance.one = (chance.draw() - (drone + 1) / GOLDEN) % 1.0  # the strategy adds its number
        rows = np.zeros((cell.drones, ROW))
        for leg in legs[1:]:
            rows[drone] = leg[LEG_ROW : LEG_ROW + ROW]
            tick = int(leg[LEG_START])
            decision = None
            for step in range(2):
                seen = drones._seen(drone, rows, tick, order, {})
                seen = msgspec.structs.replace(seen, elapsed_s=2.0 * tick + step)
                if step == 1 or leg is not legs[1]:
                    chance.one = chance.draw() if step == 1 else chance.one
                decision = drones.strategies[drone].decide(seen, chance)  # type: ignore[arg-type]
            assert decision is not None
            expected = [leg[LEG_X], leg[LEG_Y]]
            np.testing.assert_allclose(_clamped(cell, _targets([decision]))[0], expected, atol=1e-9)
            moths += bool(_read_at(recorded.setup.scene, rows[drone], tick) > 0.0)
    assert moths > 5


@pytest.mark.parametrize("trial", [0, 1])
def test_mobs_authors(trial: int) -> None:
    """The agent's object is stepped at the ticks of the trial's legs, and in the ticks of waiting between."""
    cell = Cell(strategy="mobs-authors", drones=4, arena_m=30.0)
    recorded = _recorded(cell, trial)
    drones = Drones(cell, recorded, radius_m=cell.arena_m, step_m=1.0, settle_s=0.0, **PAPER)
    order = Order(2, Stage.SEARCH, (0.0, 0.0, HEIGHT_M), 0.0, apart=True)
    stops = moves = 0
    for drone in drones.members:
        legs = recorded.legs[recorded.legs[:, LEG_DRONE] == drone]
        chance = Chance(trial, randomness.OWN + drone)
        chance.one = (chance.draw() - (drone + 1) / GOLDEN) % 1.0  # the strategy adds its number
        rows = np.zeros((cell.drones, ROW))
        turned = waited = False
        elapsed_s = 0.0
        for before, leg in itertools.pairwise(legs):
            rows[drone] = leg[LEG_ROW : LEG_ROW + ROW]
            tick = int(leg[LEG_START])
            contact = _read_at(recorded.setup.scene, rows[drone], tick) > 0.0
            # A moth decides a tick after it stopped or arrived: the second leg to one target begins.
            same = bool((before[[LEG_X, LEG_Y]] == leg[[LEG_X, LEG_Y]]).all())
            if turned and not waited and before[LEG_TICKS] == 1:
                chance.two = np.array([chance.draw(), chance.draw()])
            waited = turned and not waited and before[LEG_TICKS] == 1
            for _ in range(max(int(before[LEG_TICKS]), 1) if before[LEG_TICKS] <= 4 else 1):
                elapsed_s += 1.0
                seen = drones._seen(drone, rows, tick, order, {})
                decision = drones.strategies[drone].decide(
                    msgspec.structs.replace(seen, elapsed_s=elapsed_s),
                    chance,  # type: ignore[arg-type]
                )
            stops += contact and not turned
            moves += not same
            turned = turned or contact
            expected = [leg[LEG_X], leg[LEG_Y]]
            np.testing.assert_allclose(_clamped(cell, _targets([decision]))[0], expected, atol=1e-9)
    assert stops > 0
    assert moves > 100


@pytest.mark.parametrize("trial", [0, 2])
def test_hybrid(trial: int) -> None:
    cell = Cell(strategy="locus-hybrid", drones=5, arena_m=60.0)
    recorded = _recorded(cell, trial)
    scene = recorded.setup.scene
    contact = round(float(str(recorded.row["contact_s"])) * TICKS_PER_S)
    drones = Drones(
        cell, recorded, turn_rad=cell.turn_rad, spoke_m=cell.arena_m, spoke_step_m=1.0, **PAPER_LOCUS
    )
    chance = Chance(trial, randomness.DECISIONS)
    chance.draw()
    order = Order(2, Stage.SEARCH, (0.0, 0.0, HEIGHT_M), math.pi * chance.draw(), apart=True)
    order = msgspec.structs.replace(order, note=Packed(AloneNote).pack(AloneNote()))
    offsets = np.array([cell.formation().offset_m(drone) for drone in drones.members])
    alone = recorded.legs[recorded.legs[:, LEG_START] < contact]
    own: list[Chance] = []
    for drone in drones.members:
        legs = alone[alone[:, LEG_DRONE] == drone]
        luck = Chance(trial, randomness.OWN + drone)
        luck.one = (luck.draw() - (drone + 1) / GOLDEN) % 1.0
        own.append(luck)
        rows = np.zeros((cell.drones, ROW))
        for leg in legs[1:]:
            rows[drone] = leg[LEG_ROW : LEG_ROW + ROW]
            for step in range(3):
                seen = drones._seen(drone, rows, 0, order, {})
                still = msgspec.structs.replace(
                    seen,
                    elapsed_s=1e-3 * leg[LEG_START] + 0.4 * step,
                    own=msgspec.structs.replace(seen.own, excess_co2_ppm=Scalar(0.0, 0.0, 0.0)),
                )
                decision = drones.strategies[drone].decide(still, luck)  # type: ignore[arg-type]
                moved = _targets([decision])[0] - offsets[drone]
                if np.allclose(moved, [leg[LEG_X], leg[LEG_Y]], atol=1e-9):
                    break
            np.testing.assert_allclose(moved, [leg[LEG_X], leg[LEG_Y]], atol=1e-9)
    waypoints = list(_waypoints(recorded.legs[recorded.legs[:, LEG_START] >= contact], 0, cell.drones))
    tick, _, rows = waypoints[0]
    assert tick == contact
    caller = next(d for d in drones.members if _read_at(scene, rows[d], tick) > 0.0)
    called = drones.decide(rows, tick, order, own)[0].order
    assert called is not None
    centre = _place(rows[caller])
    assert called.anchor_ned_m == centre
    assert called.stage is Stage.FORM
    stages = _follow_locus(cell, drones, called, waypoints, chance, centre)
    assert Stage.TRACK in stages


@pytest.mark.parametrize("trial", [0, 1])
def test_multi(trial: int) -> None:
    cell = Cell(strategy="locus-multi", drones=6, group=3, arena_m=50.0)
    recorded = _recorded(cell, trial)
    groups = parted(range(1, 7), cell.group)
    assert groups == ((1, 2, 3), (4, 5, 6))
    drones = Drones(
        cell,
        recorded,
        turn_rad=cell.turn_rad,
        group=3,
        spoke_m=cell.arena_m,
        group_gap_m=0.0,
        **PAPER_LOCUS,
    )
    note = Packed(MultiNote).pack(MultiNote(groups))
    order = Order(2, Stage.SEARCH, (0.0, 0.0, HEIGHT_M), 0.0, note=note, apart=True)
    stages = set()
    for number, members in enumerate(groups):
        chance = Chance(trial, randomness.OWN + number)
        chance.one = chance.draw()
        chance.draw()  # the formation's first turn, which a flight does not make
        leader = members[0] - 1
        rows = np.zeros((cell.drones, ROW))
        group = range(leader, leader + len(members))
        waypoints = _waypoints(recorded.legs, leader, len(members))
        for sequence, (tick, targets, where) in enumerate(waypoints):
            rows[group.start : group.stop] = where
            if sequence > 0:
                chance.waypoint()
            drones.decide(rows, tick, order, [chance] * cell.drones, only=group, sequence=sequence)
            word = _GROUP_WORD.unpack(drones.words[leader])
            assert word is not None
            np.testing.assert_allclose(word.order.anchor_ned_m[:2], targets[0], atol=1e-9)
            stages.add(word.order.stage)
    assert stages == {Stage.FORM, Stage.SEARCH, Stage.TRACK}
