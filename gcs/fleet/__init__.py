"""The fleet as the ground station sees it, and what it does of its own accord."""
