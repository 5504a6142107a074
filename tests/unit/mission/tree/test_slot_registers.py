"""Slots as merged registers: the distributed Outer-Level First, joining, disputes, and that all of it settles."""

from __future__ import annotations

import random
from collections.abc import Collection, Mapping

from hypothesis import given, settings
from hypothesis import strategies as st

from mission.geometry.formation import LAYOUTS, Hexagonal, Layout, SlotTable, make_layout
from mission.tree.balanced_tree import NOBODY, heal, problems
from mission.tree.slot_registers import (
    STRIDE,
    Registers,
    SlotRegister,
    assignment,
    awaited_heirs,
    configured,
    digest,
    is_settled,
    merge,
    own_claims,
    within_stride,
)

HEX = Hexagonal(10.0)

REGISTER = st.builds(
    SlotRegister, st.integers(0, 4), st.one_of(st.just(NOBODY), st.integers(1, 12)), st.integers(0, 12)
)
REGISTERS = st.dictionaries(st.integers(0, 11), REGISTER, max_size=12)
LAYOUT = st.sampled_from(sorted(LAYOUTS)).map(lambda name: make_layout(name, 3.0))


def exchanged(
    registers: Registers,
    present: Collection[int],
    table: SlotTable,
    held: dict[int, int] | None = None,
    support: Mapping[int, int] | None = None,
) -> dict[int, SlotRegister]:
    """One round: everybody claims by the same knowledge, and everybody hears it."""
    after = dict(registers)
    for drone in present:
        at = assignment(registers, present).get(drone)
        said = (support or {}).get(drone, len(present))
        claimed = own_claims(registers, present, table, drone, said, (held or {}).get(drone))
        if held is not None and at is not None:
            held[drone] = at
        after = merge(after, claimed)
    return after


def settled(
    registers: Registers, present: Collection[int], table: SlotTable, rounds: int
) -> dict[int, SlotRegister]:
    held: dict[int, int] = {}
    for _ in range(rounds):
        if is_settled(registers, present, table):
            break
        registers = exchanged(registers, present, table, held)
    assert is_settled(registers, present, table)
    return dict(registers)


def check_whole(registers: Registers, present: Collection[int], layout: Layout) -> None:
    slots = assignment(registers, present)
    assert sorted(slots) == sorted(present)
    assert problems(slots, layout) == []


def test_everybody_starts_in_the_slot_of_the_configuration() -> None:
    registers = configured((4, 9, 2))
    assert assignment(registers, {2, 4, 9}) == {4: 0, 9: 1, 2: 2}
    assert is_settled(registers, {2, 4, 9}, HEX.table(3))


def test_the_heir_claims_and_vacates_in_one_update() -> None:
    registers = configured(range(1, 6))
    present = {2, 3, 4, 5}
    claimed = {d: own_claims(registers, present, HEX.table(5), d, 4) for d in present}
    assert claimed.pop(4) == {0: SlotRegister(1, 4, 4), 3: SlotRegister(1, NOBODY, 0)}
    assert not any(claimed.values())


def test_a_hole_waits_for_the_one_in_its_own_subtree_and_not_for_one_in_another() -> None:
    """19 drones in two full rings: slots 1 and 2 with their heirs are two branches, slot 0 is above both."""
    registers = configured(range(1, 20))
    table = HEX.table(19)
    present = set(range(1, 20)) - {1, 2, 3}
    first = {s: r for d in present for s, r in own_claims(registers, present, table, d, 16).items()}
    assert {slot for slot, register in first.items() if register.holder != NOBODY} == {1, 2}
    second = exchanged(merge(registers, first), present, table)
    assert second[0].holder in present


def test_whose_turn_it_is_is_known_to_all() -> None:
    table = HEX.table(19)
    registers = configured(range(1, 20))
    for lost in ({1, 2, 3}, {1}, {19}, {2, 8, 9}):
        present = set(range(1, 20)) - lost
        claims = {d for d in present if own_claims(registers, present, table, d, 16)}
        assert awaited_heirs(registers, present, table) == claims
    assert awaited_heirs(registers, set(), table) == frozenset()


def test_drones_without_a_slot_take_the_first_free_ones_by_their_number() -> None:
    registers = configured(range(1, 8))
    present = {1, 2, 3, 5, 20, 11}
    after = exchanged(registers, present, HEX.table(8))
    assert assignment(after, present) == {1: 0, 2: 1, 3: 2, 5: 4, 11: 3, 20: 5}


def test_one_that_leaves_vacates_its_slot() -> None:
    registers = configured(range(1, 4))
    assert own_claims(registers, {1, 2}, HEX.table(3), 3, 2) == {2: SlotRegister(1, NOBODY, 0)}


def test_one_whose_radio_was_dead_does_not_displace_the_many() -> None:
    """Drone 3 heard nobody and made itself root; the others healed around it. Then all hear each other."""
    table, everybody = HEX.table(5), set(range(1, 6))
    alone = exchanged(configured(range(1, 6)), {3}, table)
    assert alone[0] == SlotRegister(1, 3, 1)
    many = settled(configured(range(1, 6)), everybody - {3}, table, 10)
    registers: Registers = merge(many, alone)
    held = {**assignment(many, everybody - {3}), 3: 0}
    support = {1: 4, 2: 4, 3: 1, 4: 4, 5: 4}
    for _ in range(4):
        registers = exchanged(registers, everybody, table, held, support)
    assert assignment(registers, everybody) == {1: 0, 2: 1, 4: 3, 5: 4, 3: 2}


def test_of_two_equal_halves_the_lower_number_stays_root() -> None:
    table, everybody = HEX.table(4), {1, 2, 3, 4}
    held: dict[int, int] = {}
    halves = []
    for half in ({1, 4}, {2, 3}):
        halves.append(settled(configured(range(1, 5)), half, table, 10))
        held.update(assignment(halves[-1], half))
    registers: Registers = merge(*halves)
    for _ in range(6):
        registers = exchanged(registers, everybody, table, held, dict.fromkeys(everybody, 2))
    assert is_settled(registers, everybody, table)
    assert assignment(registers, everybody)[1] == 0


def test_a_great_version_is_taken_by_strides_and_never_at_once() -> None:
    ours: Registers = configured((1, 2))
    theirs = {1: SlotRegister(10_000, 2, 3), 0: SlotRegister(5, 1, 3)}
    steps = 0
    while merge(ours, theirs) != ours:
        before = ours
        ours = merge(ours, within_stride(ours, theirs))
        assert ours[1].version - before[1].version <= STRIDE
        steps += 1
    assert steps == 3


@given(REGISTERS, REGISTERS, REGISTERS)
def test_merging_is_commutative_associative_idempotent(a: Registers, b: Registers, c: Registers) -> None:
    assert merge(a, b) == merge(b, a)
    assert merge(merge(a, b), c) == merge(a, merge(b, c))
    assert merge(a, a) == a
    assert merge(merge(a, b), b) == merge(a, b)


@given(REGISTERS, REGISTERS)
def test_digests_differ_where_tables_differ(a: Registers, b: Registers) -> None:
    assert digest(a) == digest(dict(sorted(a.items(), reverse=True)))
    assert (digest(a) == digest(b)) == (a == b)


@settings(max_examples=60, deadline=None)
@given(LAYOUT, st.integers(2, 30), st.lists(st.sets(st.integers(1, 30), max_size=12), min_size=1, max_size=4))
def test_with_equal_knowledge_claims_end_where_healing_one_after_another_ends(
    layout: Layout, size: int, losses: list[set[int]]
) -> None:
    registers: Registers = configured(range(1, size + 1))
    slots = {drone: drone - 1 for drone in range(1, size + 1)}
    for lost in losses:
        present = slots.keys() - lost
        if not present:
            break
        slots = heal(slots, layout, lost).slots
        registers = settled(registers, present, layout.table(size), 2 * size)
        assert assignment(registers, present) == slots


@settings(max_examples=60, deadline=None)
@given(LAYOUT, REGISTERS, st.sets(st.integers(1, 12), min_size=1))
def test_any_table_whatever_it_holds_settles_in_bounded_rounds(
    layout: Layout, registers: Registers, present: set[int]
) -> None:
    table = layout.table(12)
    after = settled(registers, present, table, 3 * len(table))
    check_whole(after, present, layout)
    assert exchanged(after, present, table) == after


@settings(max_examples=50, deadline=None)
@given(
    LAYOUT, st.integers(2, 12), st.sets(st.integers(1, 12), max_size=8), st.integers(0, 1 << 32), REGISTERS
)
def test_lost_repeated_and_reordered_updates_converge_to_one_table(
    layout: Layout, size: int, lost: set[int], seed: int, lies: Registers
) -> None:
    """Everybody claims by what it knows; updates are delayed, lost, repeated, come in any order, and losses are
    noticed at different times. Once messages come through again, all have one whole table."""
    rng = random.Random(seed)
    table = layout.table(12)
    everybody = set(range(1, size + 1))
    present = everybody - lost or {1}
    known: dict[int, Registers] = {drone: configured(range(1, size + 1)) for drone in present}
    known[rng.choice(sorted(present))] = merge(configured(range(1, size + 1)), lies)
    noticed: dict[int, set[int]] = {drone: set(everybody) for drone in present}
    held: dict[int, int | None] = dict.fromkeys(present)
    air: list[Registers] = []
    for _ in range(40):
        drone = rng.choice(sorted(present))
        noticed[drone] -= set(rng.sample(sorted(everybody), 2)) - present
        heard = [rng.choice(air) for _ in range(rng.randrange(4))] if air else []
        for told in heard:
            known[drone] = merge(known[drone], told)
        mine = own_claims(known[drone], noticed[drone], table, drone, len(present), held[drone])
        known[drone] = merge(known[drone], mine)
        held[drone] = assignment(known[drone], noticed[drone]).get(drone)
        air.append(known[drone])
    for _ in range(4 * len(table)):
        everything = tuple(known.values())
        for drone in present:
            for other in everything:
                known[drone] = merge(known[drone], other)
            mine = own_claims(known[drone], present, table, drone, len(present), held[drone])
            known[drone] = merge(known[drone], mine)
            held[drone] = assignment(known[drone], present).get(drone)
    assert len({digest(registers) for registers in known.values()}) == 1
    check_whole(known[min(present)], present, layout)
    assert is_settled(known[min(present)], present, table)


@settings(max_examples=50, deadline=None)
@given(LAYOUT, st.integers(2, 12), st.lists(st.integers(0, 2), min_size=12, max_size=12))
def test_parts_that_healed_apart_become_one_tree_without_moving_the_largest_root(
    layout: Layout, size: int, part_of: list[int]
) -> None:
    table, everybody = layout.table(size), set(range(1, size + 1))
    parts = [{d for d in everybody if part_of[d - 1] == part} for part in range(3)]
    held: dict[int, int] = {}
    support: dict[int, int] = {}
    registers: Registers = {}
    for part in filter(None, parts):
        healed = settled(configured(range(1, size + 1)), part, table, 3 * size)
        held.update(assignment(healed, part))
        support.update(dict.fromkeys(part, len(part)))
        registers = merge(registers, healed)
    for _ in range(4 * size):
        registers = exchanged(registers, everybody, table, held, support)
    check_whole(registers, everybody, layout)
    root = next(drone for drone, slot in assignment(registers, everybody).items() if slot == 0)
    largest = max(len(part) for part in parts)
    assert support[root] == largest
