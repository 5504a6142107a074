"""An heir that is heard and claims nothing is passed over for its next, and for no longer than it is its turn."""

from __future__ import annotations

from flightstack.swarm.overdue_heirs import CLAIM_S, OverdueHeirs
from mission.geometry.formation import make_layout
from mission.tree.slot_registers import awaited_heirs, configured

MEMBERS = (1, 2, 3, 4)
TABLE = make_layout("hexagonal", 10.0).table(len(MEMBERS))
REGISTERS = configured(MEMBERS)
PRESENT = frozenset(MEMBERS) - {1}
(HEIR,) = awaited_heirs(REGISTERS, PRESENT, TABLE)
(NEXT,) = awaited_heirs(REGISTERS, PRESENT - {HEIR}, TABLE)
LAST = min(PRESENT - {HEIR, NEXT})


def test_one_heir_after_the_other_is_passed_over() -> None:
    heirs = OverdueHeirs(LAST, TABLE)
    assert heirs.passed_over(0.0, REGISTERS, PRESENT) == frozenset()
    assert heirs.passed_over(CLAIM_S, REGISTERS, PRESENT) == frozenset()
    assert heirs.passed_over(CLAIM_S + 0.1, REGISTERS, PRESENT) == {HEIR}
    assert heirs.passed_over(2.0 * CLAIM_S + 0.3, REGISTERS, PRESENT) == {HEIR, NEXT}


def test_nobody_passes_itself_over() -> None:
    heirs = OverdueHeirs(HEIR, TABLE)
    assert [heirs.passed_over(t * CLAIM_S, REGISTERS, PRESENT) for t in range(4)] == [frozenset()] * 4


def test_who_had_nothing_to_claim_meanwhile_has_its_whole_time_again() -> None:
    heirs = OverdueHeirs(LAST, TABLE)
    heirs.passed_over(0.0, REGISTERS, PRESENT)
    heirs.forget()
    assert heirs.passed_over(CLAIM_S + 0.1, REGISTERS, PRESENT) == frozenset()
