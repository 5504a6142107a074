"""Which survey a drone takes part in, where the others fly another one.

A survey is known by the command that started it. Two operators who start at once make two, and a command that did not
reach everybody is given again; then all join the one that has come further.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import msgspec

from flightstack.swarm.peers import PeerFacts
from flightstack.swarm.wire import NO_ORDER, OrderState, TableState
from mission.strategies.contract import Order

STEADY_S: Final = 1.0
"""How long a peer must tell of one survey before that counts: its state and its table may be of two for a moment."""

FORGOTTEN_S: Final = 2.0
"""A peer that has not told its table for so long is out of reach: where surveys differ it is told all the time."""


class _Flown(msgspec.Struct):
    """What a peer tells that takes part in a survey."""

    told: TableState
    order: OrderState | None
    """The newest heard of this survey; None if none was."""
    has_order: bool
    """It says that it knows of one."""
    since_s: float
    """When the peer was first heard to take part in this survey."""
    heard_s: float


class SurveyChoice:
    """What one drone hears of surveys."""

    def __init__(self) -> None:
        self._flown: dict[int, _Flown] = {}

    def hear(
        self,
        now_s: float,
        heard: Iterable[TableState],
        orders: Iterable[OrderState],
        peers: Mapping[int, PeerFacts],
    ) -> None:
        for told in heard:
            peer = peers.get(told.sender)
            before = self._flown.pop(told.sender, None)
            if peer is None or not peer.taking_part or not told.survey:
                continue
            again = before is not None and before.told.survey == told.survey
            since_s = before.since_s if before is not None and again else now_s
            order = before.order if before is not None and again else None
            has_order = peer.order_digest != NO_ORDER
            self._flown[told.sender] = _Flown(told, order, has_order, since_s, now_s)
        for said in orders:
            known = self._flown.get(said.sender)
            if known is not None and known.told.survey == said.survey:
                known.order = said
        if self._flown:
            self._flown = {d: f for d, f in self._flown.items() if now_s - f.heard_s < FORGOTTEN_S}

    def differ(self, survey: str) -> bool:
        """Whether somebody flies another survey than this."""
        return any(flown.told.survey != survey for flown in self._flown.values())

    def foremost(
        self, survey: str, epoch: int, order: Order | None
    ) -> tuple[TableState, OrderState | None] | None:
        """What is told of the survey that has come further than this drone's own, `survey`; None if none has. A table
        whose order has not been heard yet does not count."""
        best: tuple[TableState, OrderState | None] | None = None
        best_rank = _rank(survey, epoch, order)
        for flown in self._flown.values():
            told = flown.told
            if told.survey == survey or flown.heard_s - flown.since_s < STEADY_S:
                continue
            if flown.has_order and flown.order is None:
                continue
            ordered = flown.order.order if flown.order is not None else None
            rank = _rank(told.survey, told.epoch, ordered)
            if rank < best_rank:
                best, best_rank = (told, flown.order), rank
        return best


def _rank(survey: str, epoch: int, order: Order | None) -> tuple[int, int, str]:
    """By how far it has come, least first; between two that have only begun, everybody must choose the same."""
    return -epoch, -order.sequence if order is not None else 0, survey
