"""How fast a drone may fly towards something before which it has to stop."""

from __future__ import annotations

import math

GAIN_PER_S = 0.8
"""Speed asked for per metre of distance, close to a target or a limit."""

REACTION_S = 0.3
"""Time from a setpoint to the vehicle's following it."""


def braking_speed_mps(distance_m: float, acceleration_mps2: float) -> float:
    """Largest speed towards something `distance_m` away from which one stops in time; negative once past it."""
    if distance_m <= 0.0:
        return GAIN_PER_S * distance_m
    return min(GAIN_PER_S * distance_m, math.sqrt(1.2 * acceleration_mps2 * distance_m))


def braking_distance_m(speed_mps: float, acceleration_mps2: float) -> float:
    """How far it goes on at most after a setpoint that stops it."""
    return speed_mps * (REACTION_S + speed_mps / (1.2 * acceleration_mps2))
