"""Who holds which slot as state that is merged slot by slot, and what each drone claims by itself.

Every slot has a register: who claimed it, in which version. Merging keeps of each slot the greater register, so that
lost, repeated and reordered messages do no harm, and a heal in one branch needs no word from another. A drone writes
of itself alone: it claims a slot and vacates the one that it leaves in one update.

Outer-Level First without a leader (LoCUS paper III-C leaves the distributed version to future work): the heir of an
empty slot claims it once no other hole with somebody below it is left *in that slot's own subtree*. A heal moves
nobody outside of that subtree, so holes in branches apart are healed at once and those in one branch from the outside
in: with equal knowledge of the losses the outcome is that of `balanced_tree.heal`, which heals one after another.

* In a tree without such holes the drones without a slot take the first free ones, by ascending id; where there are
  none, the last drone of the deepest level moves up while the tree is out of balance.
* Two drones that could not hear each other may claim one slot. A claim says how many drones its claimant heard
  (`support`). Who is put out of its slot by a claim of less support (of equal support: by a higher id) claims it
  again, so that one whose own radio was dead never displaces the many; otherwise it takes a free slot. Each new claim
  of such a dispute has more support or a lower id than the one before: it ends.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from typing import Final, TypeAlias

import msgspec
import numpy as np

from mission.geometry.formation import SlotTable
from mission.tree.balanced_tree import NOBODY, heir_slot, holders, next_heal, next_rebalance

STRIDE: Final = 4096
"""How far a told version may be beyond the known one. No honest drone is ever so far ahead of one that hears it; a
hostile one that uses up the numbers by this stride five times a second needs more than a day."""


class SlotRegister(msgspec.Struct, frozen=True, array_like=True):
    version: int = 0
    holder: int = NOBODY
    """The drone that claimed the slot; `NOBODY`: it was vacated."""
    support: int = 0
    """How many drones the claimant heard, itself counted; 0 for a slot that was vacated or configured."""


Registers: TypeAlias = Mapping[int, SlotRegister]
"""By slot; a slot that is not in it has never been held."""

NEVER_HELD: Final = SlotRegister()


def configured(members: Collection[int]) -> dict[int, SlotRegister]:
    """The table that everybody starts from: the first of `members` in slot 0, and so on."""
    return {slot: SlotRegister(0, drone) for slot, drone in enumerate(members)}


def merge(ours: Registers, theirs: Registers) -> Registers:
    """What both tell together: commutative, associative, idempotent. `ours` itself where theirs tells nothing new."""
    news: dict[int, SlotRegister] = {}
    for slot, register in theirs.items():
        known = ours.get(slot)
        if known is None or (register != known and _rank(register) > _rank(known)):
            news[slot] = register
    return {**ours, **news} if news else ours


def within_stride(ours: Registers, theirs: Registers) -> dict[int, SlotRegister]:
    """`theirs` with no version further than `STRIDE` beyond ours, so that nobody can use up the numbers at once.

    A cut version is still far beyond the known one, and the next message brings the rest: one that comes late to a
    swarm with great versions catches up by as many messages as it takes.
    """
    return {
        slot: register
        if register.version <= (limit := ours.get(slot, NEVER_HELD).version + STRIDE)
        else msgspec.structs.replace(register, version=limit)
        for slot, register in theirs.items()
    }


def assignment(registers: Registers, present: Collection[int]) -> dict[int, int]:
    """drone -> slot, of the drones in `present` alone. One that stands in several registers holds the lowest slot."""
    slots: dict[int, int] = {}
    for slot in sorted(registers):
        drone = registers[slot].holder
        if drone in present and drone not in slots:
            slots[drone] = slot
    return slots


def is_settled(registers: Registers, present: Collection[int], table: SlotTable) -> bool:
    """Whether nobody has to claim anything: every present drone holds a slot of a whole, balanced tree."""
    slots = assignment(registers, present)
    if len(slots) < len(present):
        return False
    holder = holders(slots, table)
    below = np.zeros_like(holder)
    return (
        next_heal(holder, table.parent, table.child_start, table.child, below)[1] < 0
        and next_rebalance(holder, table.level)[1] < 0
    )


def awaited_heirs(registers: Registers, present: Collection[int], table: SlotTable) -> frozenset[int]:
    """The drones whose turn it is to claim a hole above them."""
    slots = assignment(registers, present)
    holder = holders(slots, table)
    heirs = {
        heir_slot(hole, holder, table.child_start, table.child)
        for hole, waits in enumerate(_open_below(slots, table))
        if holder[hole] == NOBODY and not waits
    }
    return frozenset(int(holder[heir]) for heir in heirs if heir != NOBODY)


def own_claims(
    registers: Registers,
    present: Collection[int],
    table: SlotTable,
    drone: int,
    support: int,
    held: int | None = None,
) -> dict[int, SlotRegister]:
    """The registers that `drone` has to write now; empty if none.

    `present` are the drones that count as there, those without a slot included; `table` has as many slots as there
    are members. `held` is the slot that this drone held the last time that it looked, if it held one then. A drone
    that is not in `present` itself (it leaves) vacates what it holds.
    """
    slots = assignment(registers, present)
    at = slots.get(drone)
    claimed: dict[int, SlotRegister] = {}

    def write(slot: int, holder: int) -> None:
        version = registers.get(slot, NEVER_HELD).version + 1
        claimed[slot] = SlotRegister(version, holder, support if holder != NOBODY else 0)

    for slot, register in registers.items():
        if register.holder == drone and slot != at:
            write(slot, NOBODY)
    if drone not in present:
        return claimed
    if at is not None:
        target = _move(slots, present, table, at)
    elif held is not None and _takes_back(registers, slots, drone, support, held):
        target = held
    else:
        target = _free_slot(slots, present, table, drone)
    if target is not None:
        if at is not None:
            write(at, NOBODY)
        write(target, drone)
    return claimed


def digest(registers: Registers) -> int:
    """32 bits that differ where two tables differ: what is compared before tables are exchanged."""
    listed = [(slot, registers[slot]) for slot in sorted(registers)]
    return zlib.crc32(msgspec.msgpack.encode(listed))


def _rank(register: SlotRegister) -> tuple[int, int, bool, int]:
    return register.version, register.support, register.holder != NOBODY, -register.holder


def _takes_back(registers: Registers, slots: Mapping[int, int], drone: int, support: int, held: int) -> bool:
    """Whether `drone` claims the slot that it `held` against the one that holds it now."""
    claim = registers.get(held, NEVER_HELD)
    return slots.get(claim.holder) == held and (support, -drone) > (claim.support, -claim.holder)


def _move(slots: Mapping[int, int], present: Collection[int], table: SlotTable, at: int) -> int | None:
    """The slot that the drone in slot `at` has to move to: as the heir of a hole, or to balance the tree."""
    holder = holders(slots, table)
    open_below = _open_below(slots, table)
    above = int(table.parent[at])
    while above >= 0:
        if holder[above] == NOBODY:
            is_heir = heir_slot(above, holder, table.child_start, table.child) == at
            return above if is_heir and not open_below[above] else None
        above = int(table.parent[above])
    if len(slots) < len(present) or not _is_whole(slots, table):
        return None
    last, free = next_rebalance(holder, table.level)
    return free if last == at else None


def _free_slot(
    slots: Mapping[int, int], present: Collection[int], table: SlotTable, drone: int
) -> int | None:
    """The slot for a drone without one: in a whole tree the parent of the first free slot is always held."""
    if not _is_whole(slots, table):
        return None
    taken = set(slots.values())
    free = [slot for slot in range(len(table)) if slot not in taken]
    waiting = sorted(set(present) - slots.keys())
    turn = waiting.index(drone)
    return free[turn] if turn < len(free) else None


def _is_whole(slots: Mapping[int, int], table: SlotTable) -> bool:
    taken = set(slots.values())
    return all(slot == 0 or int(table.parent[slot]) in taken for slot in taken)


def _open_below(slots: Mapping[int, int], table: SlotTable) -> list[bool]:
    """Of each slot: whether a hole that has somebody below it is left in its subtree, itself not counted."""
    taken = set(slots.values())
    anybody = [False] * len(table)
    open_below = [False] * len(table)
    for slot in range(len(table) - 1, 0, -1):
        above = int(table.parent[slot])
        anybody[above] |= anybody[slot] or slot in taken
        open_below[above] |= open_below[slot] or (anybody[slot] and slot not in taken)
    return open_below
