"""The messages that drones and ground stations exchange, and their one codec.

A message on the wire is one version byte and a msgpack array: the message's kind, then its fields. Fields are only
ever appended, with defaults: an older peer then ignores what it does not know, and a newer one fills in what is
missing. A change that breaks this raises `VERSION`, and the receiver says so in `WireError` instead of guessing.

The kind is in the message, although its key tells it too: on an overloaded machine zenoh was seen to deliver messages
under the key of another topic after a connection had been made again, and a state must never pass for a command.
"""

from __future__ import annotations

import enum
from typing import Generic, TypeVar

import msgspec

from mission.estimation.estimates import Reading, Scalar, Wind
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order
from mission.tree.balanced_tree import NOBODY
from mission.tree.slot_registers import SlotRegister, assignment

VERSION = 6


class WireError(ValueError):
    """Bytes that are not a message of this version and type."""


class Phase(enum.StrEnum):
    """What one drone is doing. The transitions stand in `flightstack.flight.transitions`."""

    DISARMED = "disarmed"
    ARMING = "arming"
    TAKEOFF = "takeoff"
    FORMING = "forming"
    SEARCHING = "searching"
    TRACKING = "tracking"
    HOLDING = "holding"
    LEAVING = "leaving"
    """It has announced that it leaves, and hovers in its slot until its heir has claimed that."""
    RETURNING = "returning"
    LANDING = "landing"
    """The autopilot lands it where it is."""
    RTL = "rtl"
    """The autopilot brings it home by its own way and lands it."""
    LANDED = "landed"
    CRASHED = "crashed"
    PILOT = "pilot"
    """A person has the vehicle, or a failsafe that does not bring it down; nothing is sent until a command gives it
    back."""


TAKING_PART = frozenset(
    {Phase.ARMING, Phase.TAKEOFF, Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING}
)
"""The phases of a live member of the survey; any other phase after the start announces that it left."""


NO_TABLE = 0
"""The digest of a drone that knows of no survey."""

NO_ORDER = 0
"""The digest of a drone that knows of no order."""


class DroneState(msgspec.Struct, frozen=True, array_like=True, tag="state"):
    """What a drone tells everybody about itself, best effort, several times a second."""

    sender: int
    incarnation: int
    """Random per start of the agent: a restarted agent is recognised."""
    sequence: int
    frame: int
    """`LocalFrame.identity` of the frame that the positions are in."""
    phase: Phase
    position_ned_m: Vector3 | None
    velocity_ned_mps: Vector3 | None
    heading_rad: float | None
    home_ned_m: Vector3 | None
    armed: bool
    airborne: bool
    mode: str
    """The autopilot's mode in its own words: GUIDED, RTL, OFFBOARD."""
    battery_fraction: float | None
    co2_ppm: float | None
    """The newest valid raw reading."""
    excess_co2_ppm: Scalar | None
    wind: Wind | None
    epoch: int
    slot: int | None
    parent: int | None
    healing: bool
    tracking_best_ppm: float | None
    """Largest filtered excess that this drone has measured in this survey."""
    notes: tuple[str, ...] = ()
    """Why something is not as it should be: "co2: zeroing 12 of 25", "guard: held back by drone 4"."""
    ticks: int = 0
    late_ticks: int = 0
    position_age_s: float = 0.0
    """Age of position and velocity when this was sent: a vehicle without GPS drifts away from what it says."""
    word: bytes = b""
    """What its strategy tells the neighbours' strategies, which alone know what it means."""
    crash: str = ""
    """How and where it crashed, empty if it did not."""
    astray: str = ""
    """How it does not go where it is sent, empty while it does."""
    storage: str = ""
    """Why its flight is not recorded; empty when it is."""
    table_digest: int = NO_TABLE
    """Of what it would tell as `TableState`: two that differ tell each other their tables."""
    order_digest: int = NO_ORDER
    """Of what it would tell as `OrderState`: two that differ tell each other their orders."""


NEVER = -1


class MemberRegister(msgspec.Struct, frozen=True, array_like=True):
    """What is told of one member; the counters `suspected` and `left` are never above `life`."""

    life: int = 0
    suspected: int = NEVER
    """The newest life in which it was missed."""
    left: int = NEVER
    """The newest life that it ended itself."""


class TableState(msgspec.Struct, frozen=True, array_like=True, tag="table"):
    """What a drone knows of the swarm's members and slots: each register is merged by itself, whoever told it."""

    sender: int
    incarnation: int
    sequence: int
    """Counts the sender's messages of this kind since its start, from 1."""
    frame: int
    survey: str
    """Identity of the command that started the survey; knowledge of another survey is not merged."""
    slots: tuple[tuple[int, SlotRegister], ...]
    """(slot, its register), ascending."""
    members: tuple[tuple[int, MemberRegister], ...]
    """(drone, its register) of those about whom there ever was a doubt, ascending."""
    absent: tuple[int, ...]
    """Members that the sender counts as lost or gone, ascending: for displays, each drone counts by itself."""
    heals: int = 0
    """How often the sender has seen the table whole again after somebody was lost or moved."""
    digest: int = 0
    """As `DroneState.table_digest`."""

    @property
    def held(self) -> dict[int, int]:
        """drone -> slot, as the sender counts who is there."""
        holders = {register.holder for _, register in self.slots} - {NOBODY, *self.absent}
        return assignment(dict(self.slots), holders)

    @property
    def epoch(self) -> int:
        """How often slots were claimed or vacated, as far as the sender knows."""
        return sum(register.version for _, register in self.slots)


class OrderState(msgspec.Struct, frozen=True, array_like=True, tag="order"):
    """The order that counts for its sender, whoever gave it (`flightstack.swarm.orders`)."""

    sender: int
    incarnation: int
    sequence: int
    """Counts the sender's messages of this kind since its start, from 1."""
    frame: int
    survey: str
    """Identity of the command that started the survey; an order of another survey does not count."""
    order: Order
    ordered_by: SlotRegister
    """The claim to the root's slot by which `order` was given."""
    digest: int = NO_ORDER
    """As `DroneState.order_digest`."""


class ReadingsState(msgspec.Struct, frozen=True, array_like=True, tag="readings"):
    """Readings on their way to the root, and whose have come this far (`flightstack.swarm.reading_relay`)."""

    sender: int
    incarnation: int
    sequence: int
    """Counts the sender's messages of this kind since its start, from 1."""
    frame: int
    survey: str
    order: int
    """Sequence number of the order for which they were taken."""
    readings: tuple[Reading, ...]
    """That are not known to be nearer to the root; the sender has them."""
    held: tuple[int, ...] = ()
    """Drones whose readings the sender was told, and has."""
    to_anybody: bool = False
    """The sender's own way to the root is broken: whoever hears this takes the readings up its own."""


class CommandName(enum.StrEnum):
    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"
    """Stop the survey; everybody returns in good order and lands at home."""
    RTL = "rtl"
    """The autopilot's own return-to-launch, at once."""
    LAND = "land"
    """Land where it is, at once."""


class Command(msgspec.Struct, frozen=True, array_like=True, tag="command"):
    identity: str
    """Unique; the same identity again is the same command and is answered, not carried out, again."""
    sender: str
    target: int
    """A drone's id, or 0 for every member."""
    name: CommandName
    without_recording: bool = False
    """A start also for drones whose flight cannot be recorded."""
    incarnation: int = 0
    """Of the sender: random per start of its program; 0: not told."""
    sequence: int = 0
    """Counts the sender's messages of this kind since its start, from 1; 0: not told."""


class Result(enum.StrEnum):
    ACCEPTED = "accepted"
    REFUSED = "refused"


class CommandOutcome(msgspec.Struct, frozen=True, array_like=True, tag="outcome"):
    command: str
    sender: int
    result: Result
    reason: str = ""


class Severity(enum.StrEnum):
    INFO = "info"
    WARNING = "warning"
    CRITICAL = "critical"


class Event(msgspec.Struct, frozen=True, array_like=True, tag="event"):
    """Something that happened once and that a person should be able to read afterwards."""

    sender: int
    sequence: int
    severity: Severity
    code: str
    """A short stable word: "heal", "contact", "found", "fence", "pilot", "statustext"."""
    text: str
    incarnation: int = 0
    """Of the sender: random per start of its program; 0: not told."""


class TrafficVehicle(msgspec.Struct, frozen=True, array_like=True):
    drone: int
    position_ned_m: Vector3
    velocity_ned_mps: Vector3
    age_s: float
    airborne: bool = True
    """False: it is on the ground, and no obstacle where it was last heard flying."""


class Traffic(msgspec.Struct, frozen=True, array_like=True, tag="traffic"):
    """Vehicles that the ground station still hears over MAVLink although their agents are silent."""

    sender: str
    frame: int
    vehicles: tuple[TrafficVehicle, ...]
    incarnation: int = 0
    """Of the sender: random per start of its program; 0: not told."""
    sequence: int = 0
    """Counts the sender's messages of this kind since its start, from 1; 0: not told."""


class GroundBeat(msgspec.Struct, frozen=True, array_like=True, tag="ground"):
    sender: str
    sequence: int
    system: int = 0
    """Its MAVLink system id; 0: not told."""
    incarnation: int = 0
    """Of the sender: random per start of its program; 0: not told."""


class GroundAlarm(msgspec.Struct, frozen=True, array_like=True):
    drone: int
    severity: Severity
    code: str
    text: str
    age_s: float
    """How long it has stood."""


class HeardVehicle(msgspec.Struct, frozen=True, array_like=True):
    """A vehicle as the ground station hears its autopilot over MAVLink, with or without its agent."""

    drone: int
    mode: str
    armed: bool
    airborne: bool
    position_ned_m: Vector3 | None
    velocity_ned_mps: Vector3 | None
    home_ned_m: Vector3 | None
    battery_fraction: float | None
    age_s: float
    """Since its last heartbeat."""
    crash: str = ""
    """How it crashed since it was armed, as its motion and its autopilot's texts tell; empty if it did not."""


class GroundReport(msgspec.Struct, frozen=True, array_like=True, tag="report"):
    """What the running ground station knows beyond the drones' own messages, for displays alone."""

    sender: str
    frame: int
    alarms: tuple[GroundAlarm, ...]
    vehicles: tuple[HeardVehicle, ...]


T = TypeVar("T", bound=msgspec.Struct)


class Codec(Generic[T]):
    """Encoder and decoder of one message type."""

    def __init__(self, kind: type[T]) -> None:
        self.kind = kind
        self._encoder = msgspec.msgpack.Encoder()
        self._decoder = msgspec.msgpack.Decoder(kind)

    def encode(self, message: T) -> bytes:
        return bytes((VERSION,)) + self._encoder.encode(message)

    def decode(self, data: bytes) -> T:
        if not data:
            raise WireError("empty message")
        if data[0] != VERSION:
            raise WireError(
                f"message version {data[0]}, this software speaks {VERSION}: update the older one"
            )
        try:
            return self._decoder.decode(memoryview(data)[1:])
        # Text that is not UTF-8, or arrays nested thousands deep, are not errors of msgspec's own.
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise WireError(f"not a {self.kind.__name__}: {error}") from error
