"""Robots that trace a plume each for itself: against the wind while there is gas, then a local search for it."""
