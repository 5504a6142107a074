"""The virtual-force paper: a swarm in a small arena with obstacles, and in a large one whose plume meanders."""
