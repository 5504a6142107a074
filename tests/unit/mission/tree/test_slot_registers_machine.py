"""Slot registers over any network: lost, repeated and reordered words, drones that crash, come back and forget.

Every drone claims for itself by what it knows. Whatever was said and whatever was lost, once all hear all the claims
come to rest in one whole tree of those that are there, each in one slot.
"""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, rule

from mission.geometry.formation import make_layout
from mission.tree.balanced_tree import problems
from mission.tree.slot_registers import (
    NEVER_HELD,
    Registers,
    assignment,
    configured,
    digest,
    is_settled,
    merge,
    own_claims,
    within_stride,
)

MOST = 9
LAYOUT = make_layout("hexagonal", 10.0)
DRONES = st.integers(1, MOST)
ROUNDS = 6 * MOST
"""Enough for the claims of a heal, of disputes and of waiting drones, one after another."""


class RegistersMachine(RuleBasedStateMachine):
    words = Bundle("words")

    @initialize(count=st.integers(2, MOST))
    def begin(self, count: int) -> None:
        self.members = frozenset(range(1, count + 1))
        self.table = LAYOUT.table(count)
        self.known: dict[int, Registers] = {drone: configured(sorted(self.members)) for drone in self.members}
        self.held: dict[int, int | None] = {drone: drone - 1 for drone in self.members}
        self.present: dict[int, frozenset[int]] = dict.fromkeys(self.members, self.members)
        """By drone: whom it takes for being there."""
        self.alive = set(self.members)
        self.seen: dict[int, Registers] = {}

    def one(self, drone: int) -> int:
        return 1 + (drone - 1) % len(self.members)

    @rule(target=words, drone=DRONES)
    def tell(self, drone: int) -> Registers:
        return self.known[self.one(drone)]

    @rule(word=words, drone=DRONES)
    def hear(self, word: Registers, drone: int) -> None:
        """Any word at any time, again and again or never."""
        hearer = self.one(drone)
        known = {slot: register for slot, register in word.items() if slot < len(self.table)}
        self.known[hearer] = merge(self.known[hearer], within_stride(self.known[hearer], known))

    @rule(drone=DRONES, support=st.integers(1, MOST))
    def claim(self, drone: int, support: int) -> None:
        claimant = self.one(drone)
        if claimant not in self.alive:
            return
        claims = own_claims(
            self.known[claimant],
            self.present[claimant],
            self.table,
            claimant,
            min(support, len(self.members)),
            self.held[claimant],
        )
        for slot, register in claims.items():
            assert register.version == self.known[claimant].get(slot, NEVER_HELD).version + 1
            assert register.holder in (claimant, -1), "a drone writes of itself alone"
        self.known[claimant] = merge(self.known[claimant], claims)
        at = assignment(self.known[claimant], self.present[claimant]).get(claimant)
        self.held[claimant] = at if at is not None else self.held[claimant]

    @rule(drone=DRONES)
    def crash(self, drone: int) -> None:
        if len(self.alive) > 1:
            self.alive.discard(self.one(drone))

    @rule(drone=DRONES)
    def start_again(self, drone: int) -> None:
        """It remembers nothing, and takes part."""
        one = self.one(drone)
        if one not in self.alive:
            self.alive.add(one)
            self.known[one], self.held[one] = configured(sorted(self.members)), None

    @rule(drone=DRONES, missed=st.sets(DRONES))
    def miss(self, drone: int, missed: set[int]) -> None:
        """A drone takes for gone whom it likes, but never itself."""
        one = self.one(drone)
        self.present[one] = self.members - {self.one(gone) for gone in missed} | {one}

    @invariant()
    def nobody_holds_two_slots_and_no_register_goes_back(self) -> None:
        for drone, registers in getattr(self, "known", {}).items():
            slots = assignment(registers, self.present[drone])
            assert len(set(slots.values())) == len(slots)
            before = self.seen.get(drone, {})
            restarted = self.held[drone] is None
            assert restarted or all(registers[slot].version >= old.version for slot, old in before.items())
        self.seen = dict(getattr(self, "known", {}))

    def teardown(self) -> None:
        if not hasattr(self, "known"):
            return
        alive = frozenset(self.alive)
        self.present = dict.fromkeys(self.members, alive)
        for _ in range(ROUNDS):
            for drone in sorted(alive):
                self.claim(drone, 3)
            for drone in alive:
                for other in alive:
                    self.hear(self.known[other], drone)
        tables = [self.known[drone] for drone in alive]
        assert len({digest(table) for table in tables}) == 1
        slots = assignment(tables[0], alive)
        assert slots.keys() == alive
        assert problems(slots, LAYOUT) == []
        assert is_settled(tables[0], alive, self.table)


class LongRegistersMachine(RegistersMachine):
    """The same with more examples."""


TestRegisters = RegistersMachine.TestCase
TestRegisters.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)
TestRegistersForLong = pytest.mark.long(LongRegistersMachine.TestCase)
TestRegistersForLong.settings = settings(max_examples=5000, stateful_step_count=60, deadline=None)
