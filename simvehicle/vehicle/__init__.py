"""The simulated body and its controller."""
