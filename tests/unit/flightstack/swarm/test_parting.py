"""What a part of a swarm does that came apart."""

from __future__ import annotations

import pytest

from flightstack.swarm.parting import ADRIFT_S, PARTING_S, TOGETHER_S, Part, is_adrift, part_of

LOST_S = 3.0
NOW_S = 100.0
GONE_S = NOW_S - 4.0
"""When those were heard last who are silent now."""


def part(
    drone: int,
    near: set[int],
    far: set[int],
    *,
    ground_heard_s: float | None = None,
    now_s: float = NOW_S,
) -> Part:
    heard_s = dict.fromkeys(near, now_s - 0.2) | dict.fromkeys(far, GONE_S)
    return part_of(now_s, drone, heard_s, ground_heard_s, LOST_S)


@pytest.mark.parametrize(
    ("drone", "near", "far", "expected"),
    [
        (1, set(), set(), Part.WHOLE),
        (1, {2, 3, 4}, set(), Part.WHOLE),
        (1, {2, 3}, {4}, Part.WHOLE),  # it has failed itself
        (1, set(), {2}, Part.WHOLE),
        (1, {2, 3}, {4, 5}, Part.LARGER),
        (4, {5}, {1, 2, 3}, Part.SMALLER),
        (1, {2}, {3, 4}, Part.LARGER),  # equal halves: that of the lowest id goes on
        (3, {4}, {1, 2}, Part.SMALLER),
        (1, set(), {2, 3}, Part.SMALLER),  # alone: the own radio
    ],
)
def test_the_larger_part_goes_on_and_of_equal_ones_that_of_the_lowest_id(
    drone: int, near: set[int], far: set[int], expected: Part
) -> None:
    assert part(drone, near, far) is expected


@pytest.mark.parametrize("split", [({1, 2, 3}, {4, 5}), ({1, 5}, {2, 3, 4}), ({1, 2}, {3, 4}), ({1}, {2, 3})])
def test_of_two_parts_that_do_not_hear_each_other_one_goes_on(split: tuple[set[int], set[int]]) -> None:
    one, two = ({part(d, ours - {d}, theirs) for d in ours} for ours, theirs in (split, split[::-1]))
    assert len(one) == len(two) == 1, "all of a part decide the same"
    decided = one | two
    alone = min(map(len, split)) == 1
    # The larger part sees a single drone fail; the one alone knows that not all others have.
    assert decided == ({Part.WHOLE, Part.SMALLER} if alone else {Part.LARGER, Part.SMALLER})


def test_nobody_is_cut_off_while_the_ground_station_is_heard() -> None:
    assert part(4, {5}, {1, 2, 3}, ground_heard_s=NOW_S - LOST_S) is Part.WHOLE
    assert part(4, {5}, {1, 2, 3}, ground_heard_s=NOW_S - LOST_S - 0.1) is Part.SMALLER


def test_a_ground_station_that_fell_silent_with_the_only_peer_shows_that_the_radio_failed() -> None:
    assert part(2, set(), {1}, ground_heard_s=GONE_S) is Part.SMALLER
    assert part(2, set(), {1}, ground_heard_s=GONE_S - TOGETHER_S) is Part.WHOLE, "it went before"


def test_those_who_fell_silent_one_after_the_other_have_failed_one_by_one() -> None:
    heard_s = {3: GONE_S, 4: GONE_S - TOGETHER_S, 2: NOW_S}
    assert part_of(NOW_S, 1, heard_s, None, LOST_S) is Part.WHOLE
    assert part_of(NOW_S, 1, heard_s | {4: GONE_S - 0.9 * TOGETHER_S}, None, LOST_S) is Part.LARGER


def test_a_parting_is_decided_while_it_is_new() -> None:
    later_s = GONE_S + LOST_S + PARTING_S
    assert part(4, {5}, {1, 2, 3}, now_s=later_s) is Part.SMALLER
    assert part(4, {5}, {1, 2, 3}, now_s=later_s + 0.1) is Part.WHOLE


def test_a_drone_whose_agent_is_silent_does_not_make_way() -> None:
    assert not is_adrift(ADRIFT_S)
    assert is_adrift(ADRIFT_S + 0.1)
