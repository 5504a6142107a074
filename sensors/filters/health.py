"""How far an estimate can be trusted, in one word."""

from __future__ import annotations

import enum


class Health(enum.StrEnum):
    GOOD = "good"
    DEGRADED = "degraded"
    """The number holds within its variance, but something is amiss that a person should know."""
    BAD = "bad"
    """Do not use the number."""
