"""What a well-formed message must not say: numbers that are none, places nobody flies to, lists without end.

A message that decodes may still come from a broken or hostile node. What is refused here never reaches the tree,
the guard or a strategy, so that none of them has to ask whether a number is one. The limits are far beyond
anything that a survey needs, and far below what overflows.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from flightstack.swarm.wire import Command, DroneState, Traffic, TrafficVehicle, TreeState
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, GoTo, Order, Reading, Scalar, Velocity, Wind

FARTHEST_M = 100_000.0
"""From the origin of the swarm's frame, per axis."""
FASTEST_MPS = 200.0
LARGEST_COUNT = 1 << 31
"""Of epochs, orders and heals: a swarm that made one a second would need 68 years."""
LONGEST_WORD = 200
NOTE_AT_MOST_BYTES = 1024
"""Of an order's note: it goes out with every tree message."""
WORD_AT_MOST_BYTES = 512
"""Of a strategy's word: it goes out with every state."""
OLDEST_S = 86_400.0
MOST_VEHICLES = 255
"""MAVLink has no more system ids."""


def refusal(message: object, members: Collection[int]) -> str:
    """Why `message` must not be believed, or nothing. `members` are all drones of the survey."""
    match message:
        case DroneState():
            return _state(message)
        case TreeState():
            return _tree(message, members)
        case Command():
            return _command(message)
        case Traffic():
            return "" if len(message.vehicles) <= MOST_VEHICLES else f"{len(message.vehicles)} vehicles"
    return ""


def flaw(decision: Decision) -> str:
    """Why a strategy's decision must not be carried out, or nothing."""
    match decision.intent:
        case GoTo(position_ned_m=place, speed_mps=speed_mps):
            if not _is_place(place) or not (speed_mps is None or speed_mps >= 0.0):
                return f"its target {place} is no place"
        case Velocity(velocity_ned_mps=velocity):
            if not _is_velocity(velocity):
                return f"its velocity {velocity} is none"
    if decision.reading is not None and not _is_reading(decision.reading):
        return "its reading is none"
    if not is_bounded_word(decision.word):
        return f"its word has {len(decision.word)} bytes, more than {WORD_AT_MOST_BYTES}"
    return "" if decision.order is None else _order(decision.order)


def is_bounded_word(word: bytes) -> bool:
    """Whether a strategy's word is short enough to be carried; what it says is for the strategy to judge."""
    return len(word) <= WORD_AT_MOST_BYTES


def is_vehicle(vehicle: TrafficVehicle) -> bool:
    """Whether one entry of a `Traffic` message can be believed."""
    return (
        1 <= vehicle.drone <= MOST_VEHICLES
        and _is_place(vehicle.position_ned_m)
        and _is_velocity(vehicle.velocity_ned_mps)
        and 0.0 <= vehicle.age_s <= OLDEST_S
    )


def is_estimate(estimate: Scalar | None) -> bool:
    """Whether an estimate is one: finite, with a variance that is not negative."""
    return estimate is None or (
        math.isfinite(estimate.mean) and 0.0 <= estimate.variance < math.inf and estimate.age_s >= 0.0
    )


def is_wind(wind: Wind | None) -> bool:
    return wind is None or (
        _is_velocity(wind.wind_ned_mps) and 0.0 <= wind.variance_m2ps2 < math.inf and wind.age_s >= 0.0
    )


def _state(state: DroneState) -> str:
    if not all(place is None or _is_place(place) for place in (state.position_ned_m, state.home_ned_m)):
        return "its position is none"
    if state.velocity_ned_mps is not None and not _is_velocity(state.velocity_ned_mps):
        return "its velocity is none"
    if not 0.0 <= state.position_age_s < math.inf:
        return "the age of its position is none"
    return ""


def _tree(state: TreeState, members: Collection[int]) -> str:
    drones, slots = {drone for drone, _ in state.slots}, {slot for _, slot in state.slots}
    if not all(0 <= count < LARGEST_COUNT for count in (state.epoch, state.heals)):
        return "its epoch is no count"
    if not all(author in members and 1 <= heard <= len(members) for heard, author in state.lineage):
        return "an author in its lineage is no member, or heard more drones than there are"
    if not state.epoch == len(state.lineage) < len(members):
        return f"its epoch {state.epoch} is not that of its lineage"
    if state.author != (state.lineage[-1][1] if state.lineage else 0):
        return f"its author {state.author} is not that of its lineage"
    if not state.slots or not len(drones) == len(slots) == len(state.slots):
        return "its slots are no assignment"
    if not drones.issubset(members) or not all(0 <= slot < len(members) for slot in slots):
        return "its slots are not those of this swarm"
    if len(state.lost) > len(members) or len(state.readings) > len(members):
        return "it lists more drones than there are"
    if not all(_is_reading(reading) for reading in state.readings):
        return "a reading in it is none"
    return "" if state.order is None else _order(state.order)


def _order(order: Order) -> str:
    if not 0 <= order.sequence < LARGEST_COUNT:
        return "its order's number is no count"
    places = (order.anchor_ned_m, order.source_ned_m)
    if not all(place is None or _is_place(place) for place in places):
        return "its order leads nowhere"
    if not abs(order.rotation_rad) <= FARTHEST_M:
        return "its order's rotation is none"
    if len(order.note) > NOTE_AT_MOST_BYTES:
        return f"its order's note has {len(order.note)} bytes, more than {NOTE_AT_MOST_BYTES}"
    return ""


def _command(command: Command) -> str:
    if not all(_is_word(word) for word in (command.identity, command.sender)):
        return "its identity or sender is no word"
    return ""


def _is_reading(reading: Reading) -> bool:
    """An infinite variance says that a drone has no valid measurement."""
    return (
        0 <= reading.order < LARGEST_COUNT
        and _is_place(reading.position_ned_m)
        and math.isfinite(reading.excess_co2_ppm)
        and abs(reading.excess_co2_ppm) <= 1e9
        and reading.variance_ppm2 >= 0.0
    )


def _is_place(position_ned_m: Vector3) -> bool:
    return all(abs(axis) <= FARTHEST_M for axis in position_ned_m)  # False for what is not a number


def _is_velocity(velocity_ned_mps: Vector3) -> bool:
    return all(abs(axis) <= FASTEST_MPS for axis in velocity_ned_mps)


def _is_word(word: str) -> bool:
    return 0 < len(word) <= LONGEST_WORD and word.isprintable()
