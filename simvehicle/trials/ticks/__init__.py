"""Trials of reactive swarms: every robot's rule is called at every tick, compiled."""
