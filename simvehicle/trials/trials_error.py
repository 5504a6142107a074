"""What a person can get wrong with trials."""

from __future__ import annotations


class TrialsError(ValueError):
    """One clear line: what is wrong, where, how to mend it."""
