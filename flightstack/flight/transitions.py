"""The flight phases of one drone as one table: in which phase which event leads where.

What stands in the table can be; nothing else can. A command that is not possible in a phase is a user's matter and is
refused with a reason (`flightstack.flight.phase`). An event of our own that is not possible is a defect of this
program: `following` raises, and changes nothing.
"""

from __future__ import annotations

import enum

from flightstack.swarm.wire import Phase

STEERING = frozenset(
    {Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING, Phase.LEAVING, Phase.RETURNING}
)
"""The phases in which we send a setpoint every tick, even to hold."""

IN_THE_AIR = STEERING | {Phase.TAKEOFF, Phase.LANDING, Phase.RTL, Phase.PILOT}
"""The phases between a take-off and a landing: a vehicle can crash in them."""

WAYS_DOWN = frozenset({Phase.LANDING, Phase.RTL})
"""The phases in which the autopilot brings the drone to the ground by itself."""

_NOT_OURS = WAYS_DOWN | {Phase.PILOT}

IN_FORMATION = frozenset({Phase.SEARCHING, Phase.TRACKING})
"""The phases in which the strategy decides."""


HANDS_OVER = IN_FORMATION | {Phase.HOLDING}
"""The phases in which a drone stands in its slot, so that one that leaves has something to hand over."""


class FlightEvent(enum.StrEnum):
    """What can change a phase. The first six are the commands of the same names."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"
    RTL = "rtl"
    LAND = "land"
    ARMED = "armed"
    """The motors run, in our mode."""
    ARMING_FAILED = "arming_failed"
    AT_ALTITUDE = "at_altitude"
    """The take-off is over."""
    TAKEOFF_FAILED = "takeoff_failed"
    CONTROL_LOST = "control_lost"
    """A pilot took the mode, or a failsafe of the autopilot that brings nothing down, or it was never given to us."""
    FAILSAFE_RETURNS = "failsafe_returns"
    """A failsafe of the autopilot took the mode, and comes home."""
    FAILSAFE_LANDS = "failsafe_lands"
    """A failsafe of the autopilot took the mode, and lands where it is."""
    DOWN = "down"
    """On the ground with the motors off."""
    CRASHED = "crashed"
    FLIES = "flies"
    """What was taken for a wreck flies on."""
    SEARCH = "search"
    """In its slot, and the swarm searches."""
    TRACK = "track"
    """In its slot, and the swarm follows a plume."""
    LEAVE = "leave"
    """This drone cannot go on, and announces that it goes."""
    GO_HOME = "go_home"
    """The survey is over, or this drone cannot go on with it."""
    REJOIN = "rejoin"
    """It takes the next slot that is free: its own was given away, or it hears the swarm again on its way home."""
    OVER_HOME = "over_home"
    BLOCKED = "blocked"
    """The way home is, for long."""


class IllegalTransitionError(RuntimeError):
    """An event in a phase in which it cannot be: a defect of this program, not of a user, a peer or a vehicle."""


TRANSITIONS: dict[tuple[Phase, FlightEvent], Phase] = {
    (Phase.DISARMED, FlightEvent.START): Phase.ARMING,
    # An agent that was restarted in the air has been given nothing: it takes its vehicle when it is told to.
    (Phase.DISARMED, FlightEvent.RESUME): Phase.FORMING,
    (Phase.DISARMED, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.DISARMED, FlightEvent.RTL): Phase.RTL,
    (Phase.DISARMED, FlightEvent.LAND): Phase.LANDING,
    # It takes part already: whoever starts or resumes again means those that do not.
    (Phase.ARMING, FlightEvent.START): Phase.ARMING,
    (Phase.ARMING, FlightEvent.RESUME): Phase.ARMING,
    (Phase.ARMING, FlightEvent.ABORT): Phase.DISARMED,
    (Phase.ARMING, FlightEvent.RTL): Phase.DISARMED,
    (Phase.ARMING, FlightEvent.LAND): Phase.DISARMED,
    (Phase.ARMING, FlightEvent.ARMED): Phase.TAKEOFF,
    (Phase.ARMING, FlightEvent.ARMING_FAILED): Phase.DISARMED,
    (Phase.TAKEOFF, FlightEvent.START): Phase.TAKEOFF,
    (Phase.TAKEOFF, FlightEvent.RESUME): Phase.TAKEOFF,
    (Phase.TAKEOFF, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.TAKEOFF, FlightEvent.RTL): Phase.RTL,
    (Phase.TAKEOFF, FlightEvent.LAND): Phase.LANDING,
    (Phase.TAKEOFF, FlightEvent.AT_ALTITUDE): Phase.FORMING,
    (Phase.TAKEOFF, FlightEvent.TAKEOFF_FAILED): Phase.LANDING,
    (Phase.TAKEOFF, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.TAKEOFF, FlightEvent.DOWN): Phase.LANDED,
    (Phase.FORMING, FlightEvent.START): Phase.FORMING,
    (Phase.FORMING, FlightEvent.PAUSE): Phase.HOLDING,
    (Phase.FORMING, FlightEvent.RESUME): Phase.FORMING,
    (Phase.FORMING, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.FORMING, FlightEvent.RTL): Phase.RTL,
    (Phase.FORMING, FlightEvent.LAND): Phase.LANDING,
    (Phase.FORMING, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.FORMING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.FORMING, FlightEvent.SEARCH): Phase.SEARCHING,
    (Phase.FORMING, FlightEvent.TRACK): Phase.TRACKING,
    (Phase.FORMING, FlightEvent.GO_HOME): Phase.RETURNING,
    (Phase.SEARCHING, FlightEvent.START): Phase.SEARCHING,
    (Phase.SEARCHING, FlightEvent.PAUSE): Phase.HOLDING,
    (Phase.SEARCHING, FlightEvent.RESUME): Phase.SEARCHING,
    (Phase.SEARCHING, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.SEARCHING, FlightEvent.RTL): Phase.RTL,
    (Phase.SEARCHING, FlightEvent.LAND): Phase.LANDING,
    (Phase.SEARCHING, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.SEARCHING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.SEARCHING, FlightEvent.TRACK): Phase.TRACKING,
    (Phase.SEARCHING, FlightEvent.GO_HOME): Phase.RETURNING,
    (Phase.SEARCHING, FlightEvent.REJOIN): Phase.FORMING,
    (Phase.TRACKING, FlightEvent.START): Phase.TRACKING,
    (Phase.TRACKING, FlightEvent.PAUSE): Phase.HOLDING,
    (Phase.TRACKING, FlightEvent.RESUME): Phase.TRACKING,
    (Phase.TRACKING, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.TRACKING, FlightEvent.RTL): Phase.RTL,
    (Phase.TRACKING, FlightEvent.LAND): Phase.LANDING,
    (Phase.TRACKING, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.TRACKING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.TRACKING, FlightEvent.SEARCH): Phase.SEARCHING,
    (Phase.TRACKING, FlightEvent.GO_HOME): Phase.RETURNING,
    (Phase.TRACKING, FlightEvent.REJOIN): Phase.FORMING,
    (Phase.HOLDING, FlightEvent.PAUSE): Phase.HOLDING,
    (Phase.HOLDING, FlightEvent.RESUME): Phase.FORMING,
    (Phase.HOLDING, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.HOLDING, FlightEvent.RTL): Phase.RTL,
    (Phase.HOLDING, FlightEvent.LAND): Phase.LANDING,
    (Phase.HOLDING, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.HOLDING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.HOLDING, FlightEvent.GO_HOME): Phase.RETURNING,
    **dict.fromkeys(((phase, FlightEvent.LEAVE) for phase in HANDS_OVER), Phase.LEAVING),
    (Phase.LEAVING, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.LEAVING, FlightEvent.RTL): Phase.RTL,
    (Phase.LEAVING, FlightEvent.LAND): Phase.LANDING,
    (Phase.LEAVING, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.LEAVING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.LEAVING, FlightEvent.GO_HOME): Phase.RETURNING,
    (Phase.RETURNING, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.RETURNING, FlightEvent.RTL): Phase.RTL,
    (Phase.RETURNING, FlightEvent.LAND): Phase.LANDING,
    (Phase.RETURNING, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.RETURNING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.RETURNING, FlightEvent.OVER_HOME): Phase.LANDING,
    (Phase.RETURNING, FlightEvent.BLOCKED): Phase.LANDING,
    (Phase.RETURNING, FlightEvent.REJOIN): Phase.FORMING,
    # A failsafe is followed down, unless a person takes the vehicle out of it.
    **dict.fromkeys(((phase, FlightEvent.FAILSAFE_RETURNS) for phase in _NOT_OURS), Phase.RTL),
    **dict.fromkeys(((phase, FlightEvent.FAILSAFE_LANDS) for phase in _NOT_OURS), Phase.LANDING),
    **dict.fromkeys(((phase, FlightEvent.CONTROL_LOST) for phase in WAYS_DOWN), Phase.PILOT),
    (Phase.LANDING, FlightEvent.ABORT): Phase.LANDING,
    (Phase.LANDING, FlightEvent.RTL): Phase.RTL,
    (Phase.LANDING, FlightEvent.LAND): Phase.LANDING,
    (Phase.LANDING, FlightEvent.DOWN): Phase.LANDED,
    (Phase.RTL, FlightEvent.ABORT): Phase.RTL,
    (Phase.RTL, FlightEvent.RTL): Phase.RTL,
    (Phase.RTL, FlightEvent.LAND): Phase.LANDING,
    (Phase.RTL, FlightEvent.DOWN): Phase.LANDED,
    (Phase.PILOT, FlightEvent.RESUME): Phase.FORMING,
    (Phase.PILOT, FlightEvent.ABORT): Phase.RETURNING,
    (Phase.PILOT, FlightEvent.RTL): Phase.RTL,
    (Phase.PILOT, FlightEvent.LAND): Phase.LANDING,
    (Phase.PILOT, FlightEvent.DOWN): Phase.LANDED,
    # A wreck stays one until its autopilot was restarted, somebody has armed it, or it flies.
    **dict.fromkeys(((phase, FlightEvent.CRASHED) for phase in IN_THE_AIR | {Phase.LANDED}), Phase.CRASHED),
    (Phase.CRASHED, FlightEvent.START): Phase.ARMING,
    (Phase.CRASHED, FlightEvent.ABORT): Phase.CRASHED,
    (Phase.CRASHED, FlightEvent.RTL): Phase.CRASHED,
    (Phase.CRASHED, FlightEvent.LAND): Phase.CRASHED,
    # It was asked to land; with a false alarm it is on its way down.
    (Phase.CRASHED, FlightEvent.FLIES): Phase.LANDING,
    (Phase.CRASHED, FlightEvent.CONTROL_LOST): Phase.PILOT,
    (Phase.LANDED, FlightEvent.START): Phase.ARMING,
    (Phase.LANDED, FlightEvent.RTL): Phase.RTL,
    (Phase.LANDED, FlightEvent.LAND): Phase.LANDING,
}


def following(phase: Phase, event: FlightEvent) -> Phase:
    """The phase that `event` leads to; `IllegalTransitionError` where it cannot be."""
    try:
        return TRANSITIONS[phase, event]
    except KeyError:
        raise IllegalTransitionError(f"{event} cannot be in phase {phase}") from None
