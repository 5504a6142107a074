"""What a strategy is given, and what it gives back. All of it is plain data.

A strategy sees an `Observation` once a tick and returns a `Decision`. It never sees a socket, a clock or a
MAVLink message; time appears only as ages and as seconds since the survey began.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from mission.estimation.estimates import Reading, Scalar, Wind
from mission.geometry.frames import Vector3


class Stage(enum.StrEnum):
    """What the swarm as a whole is doing; the root decides it and orders carry it."""

    FORM = "form"
    SEARCH = "search"
    TRACK = "track"
    FOUND = "found"
    GIVE_UP = "give_up"
    """The search area is exhausted, or the time for it over, without a source: everybody goes home."""

    @property
    def ends_survey(self) -> bool:
        """Whether an order of this stage is the last: everybody goes home."""
        return self in (Stage.FOUND, Stage.GIVE_UP)


class Order(msgspec.Struct, frozen=True, array_like=True):
    """The root's instruction to the swarm: where the formation's root slot shall be, and how it is turned."""

    sequence: int
    stage: Stage
    anchor_ned_m: Vector3
    rotation_rad: float
    """Rotation of the whole formation about the anchor, from north towards east."""
    source_ned_m: Vector3 | None = None
    """The estimated source, when the stage is FOUND."""
    note: bytes = b""
    """What the strategy's next root needs to go on (`mission.strategies.packed`); nobody else reads it."""
    apart: bool = False
    """The drones do not stand in their slots about the anchor (each alone, in groups, seated otherwise): a heal gives
    slots without flying anybody to them, and leaves the anchor where it is."""
    source_sd_m: float | None = None
    """Standard deviation of the source's place, along the horizontal axis on which it is known worst; None where the
    strategy does not say."""


class OwnState(msgspec.Struct, frozen=True):
    drone: int
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    excess_co2_ppm: Scalar | None
    """None while no trustworthy estimate exists (warming up, zeroing, unplugged)."""
    wind: Wind | None
    battery_fraction: float | None


class Neighbour(msgspec.Struct, frozen=True):
    """Another drone as last heard. Ages are measured on this drone's own clock, by when its message came."""

    drone: int
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    age_s: float
    airborne: bool
    excess_co2_ppm: Scalar | None = None
    wind: Wind | None = None
    adrift: bool = False
    """It will not make way: its agent is silent, or its autopilot or a pilot has it."""
    word: bytes = b""
    """The newest `Decision.word` of its strategy, empty without one."""
    home_ned_m: Vector3 | None = None
    """Where it started and comes down again, as far as is known."""


class NeighbourArrays(NamedTuple):
    """Neighbours as a compiled rule takes them, one row a drone, in the order in which they were given."""

    drone: NDArray[np.int64]
    """(n,)"""
    position_ned_m: NDArray[np.float64]
    """(n, 3)"""
    velocity_ned_mps: NDArray[np.float64]
    """(n, 3)"""
    age_s: NDArray[np.float64]
    """(n,)"""


def neighbour_arrays(neighbours: Sequence[Neighbour]) -> NeighbourArrays:
    """`neighbours` as arrays."""
    return NeighbourArrays(
        np.array([n.drone for n in neighbours], dtype=np.int64),
        np.array([n.position_ned_m for n in neighbours], dtype=np.float64).reshape(-1, 3),
        np.array([n.velocity_ned_mps for n in neighbours], dtype=np.float64).reshape(-1, 3),
        np.array([n.age_s for n in neighbours], dtype=np.float64),
    )


class TreePlace(msgspec.Struct, frozen=True):
    """This drone's place in the swarm's tree, and who holds which slot (drone -> slot, live members only)."""

    epoch: int
    slot: int
    slots: Mapping[int, int]
    parent: int | None
    children: tuple[int, ...]
    heir: int | None
    parent_heir: int | None
    root: int
    healing: bool


class Observation(msgspec.Struct, frozen=True):
    elapsed_s: float
    """Seconds since this drone began to form up."""
    own: OwnState
    neighbours: tuple[Neighbour, ...]
    tree: TreePlace
    order: Order | None
    """The newest order of the swarm's root, None before the first."""
    readings: tuple[Reading, ...]
    """At the root: the readings of all members for the current order that have come up the tree so far.
    Elsewhere: those of the drone's own subtree."""
    ranges_m: tuple[tuple[float, float], ...] = ()
    """(bearing_rad from north towards east, range_m to what is there), one a beam; empty without a range finder."""


class GoTo(msgspec.Struct, frozen=True, tag=True):
    """Fly to a point and stay there."""

    position_ned_m: Vector3
    speed_mps: float | None = None
    """None: the configured cruise speed."""


class Velocity(msgspec.Struct, frozen=True, tag=True):
    """Fly with this velocity until the next decision."""

    velocity_ned_mps: Vector3


class Hold(msgspec.Struct, frozen=True, tag=True):
    """Stay where the vehicle is."""


Intent = GoTo | Velocity | Hold


class Decision(msgspec.Struct, frozen=True):
    intent: Intent
    reading: Reading | None = None
    """This drone's reading for the current order, once it has one; the tree carries it to the root."""
    order: Order | None = None
    """A new order for the whole swarm; only the root may give one."""
    word: bytes = b""
    """What the neighbours' strategies shall hear of this drone's (`mission.strategies.packed`): said again with every
    state until another word replaces it."""


class Strategy(Protocol):
    """How a drone searches. One object a drone, made anew for every survey; `mission.strategies.registry`
    names them.

    `decide` is called once a tick (10 Hz) while the drone flies in formation, and must be deterministic in
    its arguments, its own earlier calls and `rng`.
    """

    def decide(self, observation: Observation, rng: np.random.Generator) -> Decision: ...
