"""Errors that a person can cause and mend: one line each, no traceback."""

from __future__ import annotations


class FlightstackError(Exception):
    """Base of the package's errors."""


class StartError(FlightstackError):
    """The agent cannot start as configured."""
