"""Real autopilots in the place of the simulated ones."""
