"""Kinematic trials by the thousand: the LoCUS paper's experiments with the decision code that flies."""
