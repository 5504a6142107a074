"""Heirs that let a hole above them be: they are heard, so they are not lost, but something in them does not work."""

from __future__ import annotations

from typing import Final

from mission.geometry.formation import SlotTable
from mission.tree.slot_registers import Registers, awaited_heirs

CLAIM_S: Final = 3.0
"""How long an heir may leave a hole above it open before it is passed over."""


class OverdueHeirs:
    """Who counts as not there, for one drone's own claims: who does not claim the hole that it is the heir of, then
    whoever is the heir without it, and so on. It is never the drone itself."""

    def __init__(self, drone: int, table: SlotTable) -> None:
        self._itself = {drone}
        self._table = table
        self._awaited_since_s: dict[int, float] = {}

    def forget(self) -> None:
        """Nobody has to claim anything."""
        self._awaited_since_s = {}

    def passed_over(self, now_s: float, registers: Registers, present: frozenset[int]) -> frozenset[int]:
        """Once a tick while somebody has to claim a slot."""
        passed: frozenset[int] = frozenset()
        since_s: dict[int, float] = {}
        while True:
            awaited = awaited_heirs(registers, present - passed, self._table) - self._itself
            since_s.update({drone: self._awaited_since_s.get(drone, now_s) for drone in awaited})
            overdue = {drone for drone in awaited if now_s - since_s[drone] > CLAIM_S}
            if not overdue:
                break
            passed |= overdue
        self._awaited_since_s = since_s
        return passed
