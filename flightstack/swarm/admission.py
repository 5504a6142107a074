"""Which messages are believed: the one door to drones and ground stations alike.

A message that decodes may still come from a broken, misconfigured or hostile node. What is refused here never reaches
the tree, the guard, a strategy or a display, so that none of them has to ask whether a number is one, or whether a
message came from whom it names. `Admission` is one node's door; `refusal` and `flaw` say what a well-formed message
or decision must not say: numbers that are none, places nobody flies to, lists without end. Their limits are far
beyond anything that a survey needs, and far below what overflows.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection

import msgspec

from flightstack.swarm.freshness import Counted, Freshness, MessageMemory
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import (
    NEVER,
    Command,
    CommandOutcome,
    DroneState,
    Event,
    GroundBeat,
    GroundReport,
    MemberRegister,
    OrderState,
    ReadingsState,
    TableState,
    Traffic,
    TrafficVehicle,
    WireError,
)
from mission.documents.printable import printable
from mission.estimation.estimates import Reading, Scalar, Wind
from mission.geometry.frames import Vector3
from mission.strategies.contract import Decision, GoTo, Order, Velocity
from mission.tree.balanced_tree import NOBODY
from mission.tree.slot_registers import SlotRegister

Message = (
    DroneState
    | TableState
    | OrderState
    | ReadingsState
    | Command
    | CommandOutcome
    | Event
    | Traffic
    | GroundBeat
    | GroundReport
)

FARTHEST_M = 100_000.0
"""From the origin of the swarm's frame, per axis."""
FASTEST_MPS = 200.0
LARGEST_COUNT = 1 << 31
"""Of claims, lives, orders and heals: a swarm that made one a second would need 68 years."""
LONGEST_WORD = 200
NOTE_AT_MOST_BYTES = 1024
"""Of an order's note: it goes out with every telling of the order."""
WORD_AT_MOST_BYTES = 512
"""Of a strategy's word: it goes out with every state."""
OLDEST_S = 86_400.0
MOST_VEHICLES = 255
"""MAVLink has no more system ids."""
ANYBODY = frozenset(range(1, MOST_VEHICLES + 1))
MOST_TOLD = 1000
"""A node that makes up a new fault with every message must not fill the log, or the memory."""


class RefusalKind(enum.Enum):
    """Why a message is not believed."""

    UNREADABLE = "unreadable"
    MISNAMED = "misnamed"
    """It names another sender than the network does."""
    TWIN = "twin"
    """Another node says that it is this drone."""
    STRANGER = "stranger"
    """It comes from a drone that is no member of the survey."""
    FOREIGN_FRAME = "foreign_frame"
    """Its positions are in the frame of another origin."""
    IMPLAUSIBLE = "implausible"
    REPEATED = "repeated"
    """It was heard before: by two ways, or somebody sends what was recorded."""
    PAST = "past"
    """Its sender was started before one that was heard under its name."""


class Refusal(msgspec.Struct, frozen=True):
    kind: RefusalKind
    reason: str
    """What is wrong, of a message whose sender is known: "its position is none"."""
    text: str
    """The same as one whole line for a log."""
    fresh: bool
    """The first of its kind: a misconfigured node repeats itself five times a second and is told of once."""
    message: Message | None
    """What was said, if it is plausible in itself: an operator has to see also what no drone may believe."""


_OF_A_DRONE = (DroneState, TableState, OrderState, ReadingsState)
"""What a drone tells of itself and of what it knows."""

_OF_THE_PAST = (
    "it was started before the one that was heard: a second one under this name, something recorded, or its clock "
    "went back and its record_to was lost"
)
_REPEATED = Refusal(RefusalKind.REPEATED, "it was heard before", "a message was heard before", False, None)
"""Nothing to tell: it is common where there are two ways, or a radio repeats."""


class Admission:
    """The door of one node. It remembers what it has told."""

    def __init__(
        self,
        members: Collection[int] = (),
        frame_identity: int | None = None,
        drone: int | None = None,
        incarnation: int | None = None,
    ) -> None:
        """`members` are all drones of the survey, `frame_identity` its frame's; () and None: not known here, and any
        will do. `drone` is the node's own id, None for a ground station, `incarnation` its own."""
        self._members = frozenset(members) or ANYBODY
        self._frame_identity = frame_identity
        self._drone = drone
        self._incarnation = incarnation
        self._memory = MessageMemory()
        self._told: set[str] = set()

    def admit(self, received: Received) -> Message | Refusal:
        """The message, if it is to be believed, without numbers that are none; else one line why not."""
        message = self.read(received)
        if isinstance(message, Counted):
            match self._memory.judge(received, message):
                case Freshness.REPEATED:
                    return _REPEATED
                case Freshness.PAST:
                    text = f"a message of {received.sender} is refused: {_OF_THE_PAST}"
                    return self._refusal(RefusalKind.PAST, _OF_THE_PAST, text, None)
        return message

    def read(self, received: Received) -> Message | Refusal:
        """The same, also of what was heard before: what it says in itself."""
        sender = received.sender
        try:
            message: Message = received.topic.codec.decode(received.payload)
        except WireError as error:
            text = f"{received.topic.name} from {sender}: {error}"
            return self._refusal(RefusalKind.UNREADABLE, str(error), text, None)
        misplaced = self._misplaced(sender, message)
        implausible = refusal(message, ANYBODY if misplaced else self._members)
        if implausible:
            text = f"a message of {sender} is refused: {implausible}"
            return self._refusal(RefusalKind.IMPLAUSIBLE, implausible, text, None)
        if misplaced is not None:
            kind, reason = misplaced
            if kind is RefusalKind.REPEATED:
                return _REPEATED
            return self._refusal(kind, reason, reason, _believable(message))
        return _believable(message)

    def _misplaced(self, sender: str, message: Message) -> tuple[RefusalKind, str] | None:
        """What is wrong with where a message comes from."""
        if isinstance(message, _OF_A_DRONE):
            if str(message.sender) != sender:
                return _misnamed(message.sender, sender)
            if message.sender == self._drone and message.incarnation == self._incarnation:
                return RefusalKind.REPEATED, "our own words have come back"
            if message.sender == self._drone:
                text = f"another node also says that it is drone {self._drone}: every drone needs its own id"
                return RefusalKind.TWIN, text
            if message.sender not in self._members:
                return RefusalKind.STRANGER, f"drone {message.sender} is not in swarm.members"
        # A ground station also answers and tells for drones whose agents are silent.
        if (
            isinstance(message, CommandOutcome | Event)
            and sender.isdecimal()
            and sender != str(message.sender)
        ):
            return _misnamed(message.sender, sender)
        if isinstance(message, (*_OF_A_DRONE, Traffic)) and self._frame_identity not in (
            None,
            message.frame,
        ):
            return (
                RefusalKind.FOREIGN_FRAME,
                f"{sender} flies in another frame: give all members the same origin",
            )
        return None

    def _refusal(self, kind: RefusalKind, reason: str, text: str, message: Message | None) -> Refusal:
        fresh = text not in self._told and len(self._told) < MOST_TOLD
        if fresh:
            self._told.add(text)
        return Refusal(kind, printable(reason), printable(text), fresh, message)


def refusal(message: object, members: Collection[int]) -> str:
    """Why `message` must not be believed, or nothing. `members` are all drones of the survey."""
    match message:
        case DroneState():
            return _state(message)
        case TableState():
            return _table(message, members)
        case OrderState():
            return _ordered(message, members)
        case ReadingsState():
            return _readings(message, members)
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
    if not _is_bounded(decision.word):
        return f"its word has {len(decision.word)} bytes, more than {WORD_AT_MOST_BYTES}"
    return "" if decision.order is None else _order(decision.order)


def _misnamed(drone: int, sender: str) -> tuple[RefusalKind, str]:
    return RefusalKind.MISNAMED, f"a message of drone {drone} came under the name {sender}"


def _believable(message: Message) -> Message:
    """One odd estimate does not hide the drone that sent it, nor one odd vehicle the others in the traffic; words
    come out as they may be shown."""
    match message:
        case DroneState():
            battery = message.battery_fraction
            words = (message.mode, message.storage, *message.notes)
            if not all(map(str.isprintable, words)):
                mode, storage, *notes = map(printable, words)
                message = msgspec.structs.replace(message, mode=mode, storage=storage, notes=tuple(notes))
            if (
                (battery is None or math.isfinite(battery))
                and _is_estimate(message.excess_co2_ppm)
                and _is_wind(message.wind)
                and _is_bounded(message.word)
            ):
                return message
            return msgspec.structs.replace(
                message,
                battery_fraction=battery if battery is not None and math.isfinite(battery) else None,
                excess_co2_ppm=message.excess_co2_ppm if _is_estimate(message.excess_co2_ppm) else None,
                wind=message.wind if _is_wind(message.wind) else None,
                word=message.word if _is_bounded(message.word) else b"",
            )
        case Event():
            return msgspec.structs.replace(
                message, code=printable(message.code), text=printable(message.text)
            )
        case CommandOutcome():
            return msgspec.structs.replace(message, reason=printable(message.reason))
        case GroundReport():
            return _shown(message)
        case Traffic():
            return msgspec.structs.replace(message, vehicles=tuple(filter(_is_vehicle, message.vehicles)))
    return message


def _shown(report: GroundReport) -> GroundReport:
    """With words that may be shown."""
    return msgspec.structs.replace(
        report,
        sender=printable(report.sender),
        alarms=tuple(
            msgspec.structs.replace(a, code=printable(a.code), text=printable(a.text)) for a in report.alarms
        ),
        vehicles=tuple(msgspec.structs.replace(v, mode=printable(v.mode)) for v in report.vehicles),
    )


def _is_bounded(word: bytes) -> bool:
    """Whether a strategy's word is short enough to be carried; what it says is for the strategy to judge."""
    return len(word) <= WORD_AT_MOST_BYTES


def _is_vehicle(vehicle: TrafficVehicle) -> bool:
    return (
        1 <= vehicle.drone <= MOST_VEHICLES
        and _is_place(vehicle.position_ned_m)
        and _is_velocity(vehicle.velocity_ned_mps)
        and 0.0 <= vehicle.age_s <= OLDEST_S
    )


def _is_estimate(estimate: Scalar | None) -> bool:
    """Whether an estimate is one: finite, with a variance that is not negative."""
    return estimate is None or (
        math.isfinite(estimate.mean) and 0.0 <= estimate.variance < math.inf and estimate.age_s >= 0.0
    )


def _is_wind(wind: Wind | None) -> bool:
    return wind is None or (
        _is_velocity(wind.wind_ned_mps) and 0.0 <= wind.variance_m2ps2 < math.inf and wind.age_s >= 0.0
    )


def _state(state: DroneState) -> str:
    place, home = state.position_ned_m, state.home_ned_m
    if not ((place is None or _is_place(place)) and (home is None or _is_place(home))):
        return "its position is none"
    if state.velocity_ned_mps is not None and not _is_velocity(state.velocity_ned_mps):
        return "its velocity is none"
    if not 0.0 <= state.position_age_s < math.inf:
        return "the age of its position is none"
    return ""


def _table(state: TableState, members: Collection[int]) -> str:
    size = len(members)
    if not (0 <= state.heals < LARGEST_COUNT and 0 <= state.sequence < LARGEST_COUNT):
        return "its count of heals or messages is none"
    if max(len(state.slots), len(state.members), len(state.absent)) > size:
        return "it lists more than there are drones"
    slots = [slot for slot, _ in state.slots]
    if len(set(slots)) < len(slots) or not all(0 <= slot < size for slot in slots):
        return "its slots are not those of this swarm"
    if not all(_is_claim(register, members) for _, register in state.slots):
        return "a claim to a slot in it is none"
    told = [drone for drone, _ in state.members]
    if len(set(told)) < len(told) or not all(drone in members for drone in (*told, *state.absent)):
        return "its members are not those of this swarm"
    if not all(_is_member_register(register) for _, register in state.members):
        return "a member's life in it is none"
    return ""


def _ordered(state: OrderState, members: Collection[int]) -> str:
    if not 0 <= state.sequence < LARGEST_COUNT:
        return "its count of messages is none"
    return _order(state.order) if _is_claim(state.ordered_by, members) else "nobody gave its order"


def _readings(state: ReadingsState, members: Collection[int]) -> str:
    if not 0 <= state.sequence < LARGEST_COUNT:
        return "its count of messages is none"
    if max(len(state.readings), len(state.held)) > len(members):
        return "it lists more drones than there are"
    if not all(_is_reading(reading) and reading.drone in members for reading in state.readings):
        return "a reading in it is none"
    return "" if all(drone in members for drone in state.held) else "it holds readings of strangers"


def _is_claim(register: SlotRegister, members: Collection[int]) -> bool:
    return (
        0 <= register.version < LARGEST_COUNT
        and (register.holder == NOBODY or register.holder in members)
        and 0 <= register.support <= len(members)
    )


def _is_member_register(register: MemberRegister) -> bool:
    return (
        0 <= register.life < LARGEST_COUNT
        and NEVER <= register.suspected <= register.life
        and NEVER <= register.left <= register.life
    )


def _order(order: Order) -> str:
    if not 0 <= order.sequence < LARGEST_COUNT:
        return "its order's number is no count"
    places = (order.anchor_ned_m, order.source_ned_m)
    if not all(place is None or _is_place(place) for place in places):
        return "its order leads nowhere"
    if not abs(order.rotation_rad) <= FARTHEST_M:
        return "its order's rotation is none"
    if order.source_sd_m is not None and not 0.0 <= order.source_sd_m <= FARTHEST_M:
        return "its order's source is known to no number of metres"
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
    north_m, east_m, down_m = position_ned_m
    # False for what is not a number. Written out: a loop takes four times as long, for every message of every drone.
    return abs(north_m) <= FARTHEST_M and abs(east_m) <= FARTHEST_M and abs(down_m) <= FARTHEST_M


def _is_velocity(velocity_ned_mps: Vector3) -> bool:
    north_mps, east_mps, down_mps = velocity_ned_mps
    return abs(north_mps) <= FASTEST_MPS and abs(east_mps) <= FASTEST_MPS and abs(down_mps) <= FASTEST_MPS


def _is_word(word: str) -> bool:
    return 0 < len(word) <= LONGEST_WORD and word.isprintable()
