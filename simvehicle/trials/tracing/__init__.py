"""Trials in recorded air: reactive swarms of disks among obstacles, every rule called at every step, compiled."""
