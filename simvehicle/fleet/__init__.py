"""Many vehicles in one process, in real time."""
