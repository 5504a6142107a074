"""Whole swarms in one process, on simulated time."""
