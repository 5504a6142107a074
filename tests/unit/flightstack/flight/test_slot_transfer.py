"""The way to a slot, state by state: forming up, and taking another's place."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.flight.slot_transfer import (
    APPROACH_BLOCKED_S,
    AT_SLOT_M,
    TRANSFER_LIMIT_S,
    SlotState,
    SlotStep,
    SlotTransfer,
    is_awaited,
)
from flightstack.flight.transitions import IN_FORMATION
from flightstack.swarm.wire import Phase
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order, Stage

SLOT: Vector3 = (10.0, 0.0, -10.0)
FAR: Vector3 = (0.0, 0.0, -10.0)
MOVING: Vector3 = (1.0, 0.0, 0.0)
STILL: Vector3 = (0.0, 0.0, 0.0)
ORDER = Order(4, Stage.TRACK, (0.0, 0.0, -10.0), 0.0)
SETTLED = SlotStep(SlotState.SETTLED, formed_up=False)
TRANSFER = SlotStep(SlotState.TRANSFER, formed_up=False)


class SlotSeeker:
    def __init__(self) -> None:
        self.slot = SlotTransfer(separation_m=4.0)
        self.now_s = 50.0

    def step(
        self,
        phase: Phase,
        position: Vector3 | None = FAR,
        *,
        velocity: Vector3 | None = MOVING,
        slot: Vector3 | None = SLOT,
        moved: bool = False,
        after_s: float = 0.1,
    ) -> SlotStep:
        self.now_s += after_s
        return self.slot.step(
            self.now_s,
            phase,
            moved=moved,
            position_ned_m=position,
            velocity_ned_mps=velocity,
            slot_ned_m=slot,
        )


@pytest.fixture
def drone() -> SlotSeeker:
    return SlotSeeker()


@pytest.mark.parametrize("phase", sorted(set(Phase) - {Phase.FORMING}))
def test_without_a_new_slot_nobody_waits_for_this_drone(drone: SlotSeeker, phase: Phase) -> None:
    assert drone.step(phase) == SETTLED
    assert drone.step(phase, SLOT) == SETTLED


def test_forming_up_ends_in_the_slot(drone: SlotSeeker) -> None:
    assert drone.step(Phase.FORMING) == SlotStep(SlotState.FORMING_UP, formed_up=False)
    near = (SLOT[0] - 0.9 * AT_SLOT_M, SLOT[1], SLOT[2])
    assert drone.step(Phase.FORMING, near) == SlotStep(SlotState.FORMING_UP, formed_up=True)
    assert drone.step(Phase.SEARCHING, near) == SETTLED


def test_a_drone_that_is_kept_from_its_slot_counts_as_formed_up_after_a_while(drone: SlotSeeker) -> None:
    assert not drone.step(Phase.FORMING, velocity=STILL).formed_up
    assert not drone.step(Phase.FORMING, velocity=STILL, after_s=APPROACH_BLOCKED_S - 0.1).formed_up
    assert drone.step(Phase.FORMING, velocity=STILL, after_s=0.2).formed_up


@pytest.mark.parametrize("missing", ["position", "velocity", "slot"])
def test_who_does_not_know_where_it_is_or_shall_be_has_to_arrive_anew(
    drone: SlotSeeker, missing: str
) -> None:
    drone.step(Phase.FORMING, velocity=STILL)
    assert not drone.step(Phase.FORMING, after_s=APPROACH_BLOCKED_S, **{missing: None}).formed_up
    assert not drone.step(Phase.FORMING, velocity=STILL).formed_up


@pytest.mark.parametrize("phase", sorted(IN_FORMATION))
def test_an_heir_is_under_way_until_it_is_in_its_slot(drone: SlotSeeker, phase: Phase) -> None:
    assert drone.step(phase, moved=True) == TRANSFER
    assert drone.step(phase) == TRANSFER
    assert drone.step(phase, SLOT) == SETTLED
    assert drone.step(phase, FAR) == SETTLED, "what comes later is the strategy's"


def test_a_slot_in_which_a_vehicle_hovers_is_given_up(drone: SlotSeeker) -> None:
    assert drone.step(Phase.SEARCHING, moved=True, velocity=STILL) == TRANSFER
    assert drone.step(Phase.SEARCHING, velocity=STILL, after_s=APPROACH_BLOCKED_S - 0.1) == TRANSFER
    assert drone.step(Phase.SEARCHING, velocity=STILL, after_s=0.2) == SETTLED


def test_a_slot_beside_which_it_steps_to_and_fro_is_given_up_too(drone: SlotSeeker) -> None:
    """The guard steps aside before the vehicle that hovers there, and never stands still."""
    drone.step(Phase.SEARCHING, moved=True)
    beside = [(SLOT[0] - 2.0, SLOT[1] + shift_m, SLOT[2] + 5.0) for shift_m in (0.0, 0.4, 0.0, -0.4)]
    steps = [drone.step(Phase.SEARCHING, beside[n % 4]) for n in range(round(APPROACH_BLOCKED_S * 10.0) + 2)]
    assert steps[-3] == TRANSFER
    assert steps[-1] == SETTLED


def test_the_swarm_does_not_wait_for_ever_for_an_heir(drone: SlotSeeker) -> None:
    drone.step(Phase.TRACKING, moved=True)
    assert drone.step(Phase.TRACKING, after_s=TRANSFER_LIMIT_S - 0.1) == TRANSFER
    assert drone.step(Phase.TRACKING, after_s=0.2) == SETTLED


def test_an_heir_that_a_next_heal_moves_again_has_its_time_anew(drone: SlotSeeker) -> None:
    drone.step(Phase.TRACKING, moved=True)
    assert drone.step(Phase.TRACKING, moved=True, after_s=TRANSFER_LIMIT_S - 0.1) == TRANSFER
    assert drone.step(Phase.TRACKING, after_s=1.0) == TRANSFER


def test_a_paused_heir_goes_on_afterwards(drone: SlotSeeker) -> None:
    drone.step(Phase.SEARCHING, moved=True)
    assert drone.step(Phase.HOLDING) == TRANSFER
    assert drone.step(Phase.FORMING).state is SlotState.FORMING_UP


@pytest.mark.parametrize("phase", sorted(set(Phase) - IN_FORMATION - {Phase.HOLDING, Phase.FORMING}))
def test_an_heir_that_leaves_the_formation_is_not_waited_for(drone: SlotSeeker, phase: Phase) -> None:
    drone.step(Phase.SEARCHING, moved=True)
    assert drone.step(phase) == SETTLED


@pytest.mark.parametrize("phase", sorted(set(Phase) - IN_FORMATION))
def test_only_who_flies_in_formation_becomes_an_heir_under_way(drone: SlotSeeker, phase: Phase) -> None:
    assert not drone.step(phase, moved=True).transferring


def test_an_approach_to_the_old_slot_does_not_count_for_the_new_one(drone: SlotSeeker) -> None:
    drone.step(Phase.SEARCHING, moved=True, velocity=STILL)
    elsewhere = (SLOT[0], SLOT[1] + 20.0, SLOT[2])
    assert drone.step(Phase.SEARCHING, velocity=STILL, slot=elsewhere, after_s=APPROACH_BLOCKED_S) == TRANSFER


@pytest.mark.parametrize(
    ("phase", "slot", "order", "step", "awaited"),
    [
        (Phase.TRACKING, 2, ORDER, TRANSFER, True),
        (Phase.TRACKING, 2, ORDER, SETTLED, False),
        (Phase.FORMING, 2, ORDER, SETTLED, True),
        (Phase.FORMING, -1, ORDER, SETTLED, False),
        (Phase.FORMING, 2, msgspec.structs.replace(ORDER, stage=Stage.FORM), SETTLED, False),
        (Phase.FORMING, 2, msgspec.structs.replace(ORDER, apart=True), SETTLED, False),
        (Phase.FORMING, 2, None, SETTLED, False),
    ],
)
def test_a_formation_on_its_way_holds_for_an_heir_and_for_one_that_joins(
    phase: Phase, slot: int, order: Order | None, step: SlotStep, awaited: bool
) -> None:
    assert is_awaited(phase, slot, order, step) is awaited
