"""Kinematic trials by the thousand: strategies' rules, compiled, on drones that are moving points."""
