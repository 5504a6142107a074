"""The altitudes that belong to one drone alone: who crosses in them meets nobody, whether he hears the others or not.

Above the formation each drone has two. In the lower one its agent crosses the others' way, in the upper one its
autopilot, when it comes home by itself. All of them differ by `layer_gap_m`, the autopilots' lie above the agents':
an autopilot flies straight and makes way for nobody, and so it flies over whoever an agent steers up or down.

    formation | agents of members 1..n | autopilots of members 1..n | ceiling

Where the ceiling leaves no room for the autopilots' half, each comes home in its agent's layer; where the file asks
for fewer layers than there are members, members share one. `layer_cautions` tells of both.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from flightstack.config import FormationConfig, LimitsConfig
from flightstack.flight.guard import SEPARATION_MARGIN_M

RETURN_ALTITUDES = {"RTL_ALT": 0.01, "RTL_ALT_M": 1.0, "RTL_RETURN_ALT": 1.0}
"""Metres a unit: ArduPilot's in cm and, since 4.7, in m; PX4's in m."""

_MUST_BE_ZERO = {
    "RTL_CONE_ANG": "near home it returns lower",
    "RTL_CONE_SLOPE": "near home it returns lower",
    "RTL_LAND_DELAY": "it waits over home, in the way of whoever comes there",
    "RTL_LOIT_TIME": "it waits over home, in the way of whoever comes there",
}


class Layers(msgspec.Struct, frozen=True):
    """One drone's altitudes, metres above the origin of the swarm's frame."""

    agent_above_home_m: float
    """Where its agent crosses the others' way, forming up and going home."""
    autopilot_above_home_m: float
    """Where its autopilot comes home by itself."""


def layers_of(drone: int, members: Sequence[int], formation: FormationConfig, limits: LimitsConfig) -> Layers:
    """The altitudes of one member; every member computes the same from the file that is the same for all."""
    layer = members.index(drone) % _layers(formation, len(members))
    agent_m = _altitude_m(formation, layer)
    if autopilots_above(len(members), formation, limits):
        return Layers(agent_m, _altitude_m(formation, len(members) + layer))
    return Layers(agent_m, agent_m)


def autopilots_above(drones: int, formation: FormationConfig, limits: LimitsConfig) -> bool:
    """Whether autopilots come home above all agents: each member has its own layer, and there is room for as many."""
    return (
        _layers(formation, drones) == drones
        and ceiling_needed_m(drones, formation) <= limits.ceiling_above_home_m
    )


def ceiling_needed_m(drones: int, formation: FormationConfig) -> float:
    """The lowest ceiling under which all members' layers fit, agents' and autopilots'."""
    return _altitude_m(formation, 2 * drones - 1) + SEPARATION_MARGIN_M


def highest_agent_m(drones: int, formation: FormationConfig) -> float:
    return _altitude_m(formation, _layers(formation, drones) - 1)


def layer_cautions(
    drone: int,
    members: Sequence[int],
    formation: FormationConfig,
    limits: LimitsConfig,
    parameters: dict[str, float],
) -> Iterator[tuple[str, str]]:
    """(field, what may bring two drones together that do not hear each other, and how to mend it)."""
    drones = len(members)
    if drones == 1:
        return
    needed_m = ceiling_needed_m(drones, formation)
    if _layers(formation, drones) < drones:
        yield (
            "formation.layers",
            f"{drones} drones share {formation.layers} layers: two that go home without hearing each other are "
            f"not kept apart; leave it out, with limits.ceiling_above_home_m {needed_m:g} or more",
        )
    elif not autopilots_above(drones, formation, limits):
        yield (
            "limits.ceiling_above_home_m",
            f"{limits.ceiling_above_home_m:g} m leave no room for autopilots that come home by themselves above the "
            f"agents' layers: such a one is kept apart from the others by hearing only; {needed_m:g} m are enough",
        )
    own_m = layers_of(drone, members, formation, limits).autopilot_above_home_m
    for name, value in parameters.items():
        field = f"autopilot.parameters.{name}"
        if name in RETURN_ALTITUDES and abs(value * RETURN_ALTITUDES[name] - own_m) > 0.5:
            yield (
                field,
                f"{name} {value:g} is not the altitude at which drone {drone} alone comes home by itself: set it to "
                f"{own_m / RETURN_ALTITUDES[name]:g}",
            )
        if name in _MUST_BE_ZERO and value != 0.0:
            yield field, f"{name} {value:g}: {_MUST_BE_ZERO[name]}; set it to 0"
        if name == "RTL_DESCEND_ALT" and abs(value - own_m) > 0.5:
            yield (
                field,
                f"RTL_DESCEND_ALT {value:g}: it waits over home at that altitude; set it to {own_m:g}",
            )


def _layers(formation: FormationConfig, drones: int) -> int:
    return drones if formation.layers is None else min(formation.layers, drones)


def _altitude_m(formation: FormationConfig, layer: int) -> float:
    return formation.above_home_m + formation.layer_gap_m * (layer + 1)
