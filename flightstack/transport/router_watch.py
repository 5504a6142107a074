"""Tells in the log when the router to the other sites is lost and when it is back."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final

log = logging.getLogger(__name__)

_PERIOD_S: Final = 0.5
_PATIENCE_S: Final = 5.0
"""A router that comes up with the nodes, or is started anew at once, is nobody's business."""
_STEADY_S: Final = 2.0
"""A router that does not know this site lets its nodes in and sends them away at once, again and again."""


class RouterWatch:
    """Whether a node is connected to a router. `look` it up now and then; it never waits."""

    def __init__(self, connected: Callable[[], bool], site: str) -> None:
        """`connected`: whether there is a connection to a router now."""
        self._connected = connected
        self._site = site
        self._looked_s = float("-inf")
        self._connected_since_s: float | None = None
        self._without_since_s: float | None = None
        self._told = False

    def look(self, now_s: float) -> None:
        """`now_s`: of a clock that nobody sets."""
        if now_s - self._looked_s < _PERIOD_S:
            return
        self._looked_s = now_s
        if not self._connected():
            self._connected_since_s = None
        elif self._connected_since_s is None:
            self._connected_since_s = now_s
        if self._connected_since_s is not None and now_s - self._connected_since_s >= _STEADY_S:
            if self._told:
                log.warning("the router is there: site %s and the others hear each other", self._site)
            self._without_since_s, self._told = None, False
        elif self._without_since_s is None:
            self._without_since_s = now_s
        elif not self._told and now_s - self._without_since_s >= _PATIENCE_S:
            self._told = True
            log.error(
                "no router since %.0f s: site %s and the others do not hear each other until it is there",
                now_s - self._without_since_s,
                self._site,
            )
