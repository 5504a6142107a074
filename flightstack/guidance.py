"""Where a drone flies on its own account: forming up, filling another's slot, going home.

Each path is a plain function of where the drone is and where it shall be: it has no memory, so that a drone that
was pushed aside, paused or restarted goes on from wherever it finds itself. All positions are NED metres in the
swarm's frame; "layer" is the altitude (as down) that belongs to one drone while it crosses the others' way.
"""

from __future__ import annotations

import math

from mission.frames import Vector3

CORRIDOR_M = 1.5
"""Horizontal distance below which a drone counts as above or below its target."""


def horizontal_m(a: Vector3, b: Vector3) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def over_the_top(position_ned_m: Vector3, target_ned_m: Vector3, layer_down_m: float) -> Vector3:
    """Climb to the layer, cross in it, come down onto the target: forming up and going home."""
    return _by_layer(
        position_ned_m, target_ned_m, layer_down_m, reached=position_ned_m[2] <= layer_down_m + 1.0
    )


def underneath(position_ned_m: Vector3, target_ned_m: Vector3, layer_down_m: float) -> Vector3:
    """Descend below the formation, cross there, climb into the slot: the heir's way (LoCUS paper, figure 5)."""
    return _by_layer(
        position_ned_m, target_ned_m, layer_down_m, reached=position_ned_m[2] >= layer_down_m - 0.7
    )


def _by_layer(position: Vector3, target: Vector3, layer_down_m: float, *, reached: bool) -> Vector3:
    if horizontal_m(position, target) <= CORRIDOR_M:
        return target
    if reached:
        return target[0], target[1], layer_down_m
    return position[0], position[1], layer_down_m
