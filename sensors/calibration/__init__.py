"""Instruments against each other and against their own recordings."""
