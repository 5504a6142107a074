"""What can go wrong in the ground station and is not a programming error."""

from __future__ import annotations


class GroundError(RuntimeError):
    """One line for the operator: what failed, where, and how to mend it."""
