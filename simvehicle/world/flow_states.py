"""The states of something that is advanced step by step, for who asks for them in any order."""

from __future__ import annotations

import collections
from collections.abc import Callable
from typing import Final

from mission.geometry.formation import FloatArray

_KEPT_BYTES: Final = 64 << 20
"""Of the newest states, and as much again of marks."""
_FEWEST, _MOST = 4, 256
"""Of the newest states that are all kept."""
_MARKS: Final = 32
"""States further back that are kept, evenly over the time: who asks for one between them has it computed again from
the one before it."""


class FlowStates:
    """State after state of a pure function `following(state, its index)`, from that of the index `begin` on."""

    def __init__(
        self,
        first: Callable[[], FloatArray],
        following: Callable[[FloatArray, int], FloatArray],
        *,
        begin: int,
    ) -> None:
        self._first = first
        self._following = following
        self._begin = begin
        self._newest = begin - 1
        self._recent: collections.deque[FloatArray] = collections.deque()
        self._marks: dict[int, FloatArray] = {}
        self._between = _MOST
        """Steps from mark to mark."""

    def at(self, index: int) -> FloatArray:
        """The state of this index, `begin` or later. It is shared: do not write into it."""
        if not self._recent or index <= self._newest - len(self._recent):
            self._go_back(index)
        while self._newest < index:
            self._append(self._following(self._recent[-1], self._newest + 1))
        return self._recent[index - self._newest - 1]

    def _go_back(self, index: int) -> None:
        mark = max((known for known in self._marks if known <= index), default=None)
        self._recent.clear()
        self._newest = (self._begin if mark is None else mark) - 1
        self._append(self._first() if mark is None else self._marks[mark])

    def _append(self, state: FloatArray) -> None:
        self._newest += 1
        self._recent.append(state)
        room = max(_KEPT_BYTES // state.nbytes, _FEWEST)
        if len(self._recent) > min(room, _MOST):
            self._recent.popleft()
        if self._newest % self._between == 0 and self._newest >= 0:
            self._marks[self._newest] = state
            if len(self._marks) > min(room, _MARKS):
                self._between *= 2
                self._marks = {at: kept for at, kept in self._marks.items() if at % self._between == 0}
