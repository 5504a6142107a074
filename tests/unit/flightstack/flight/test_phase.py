"""The flight phases, state by event."""

from __future__ import annotations

import itertools

import msgspec
import pytest

from flightstack.flight.facts import SwarmFacts, VehicleFacts
from flightstack.flight.phase import Ask, FlightPhase, PhaseStep
from flightstack.flight.taking_part import HAND_OVER_S, NO_SLOT_S, SLOTLESS_S
from flightstack.flight.transitions import STEERING
from flightstack.swarm.news import Note
from flightstack.swarm.wire import TAKING_PART, Command, CommandName, Phase, Result, Severity
from mission.strategies.contract import Order, Stage

GROUND = VehicleFacts(
    connected=True, problem="", armed=False, airborne=False, ours=False, mode="STABILIZE",
    taken_reason="", at_takeoff_altitude=False,
)  # fmt: skip
ARMED = msgspec.structs.replace(GROUND, armed=True, ours=True, mode="GUIDED")
UP = msgspec.structs.replace(ARMED, airborne=True, at_takeoff_altitude=True)
ALONE = SwarmFacts(
    order=None,
    member=True,
    formed_up=False,
    over_home=False,
    stuck=False,
    must_return="",
)


def order(stage: Stage) -> Order:
    return Order(1, stage, (0.0, 0.0, -10.0), 0.0)


class Flight:
    """Steps one phase machine, a tenth of a second at a time."""

    def __init__(self) -> None:
        self.machine = FlightPhase(3)
        self.now_s = 100.0
        self.identities = (f"c{n}" for n in itertools.count())

    def step(self, vehicle: VehicleFacts, swarm: SwarmFacts = ALONE, *commands: Command) -> PhaseStep:
        self.now_s += 0.1
        return self.machine.step(self.now_s, commands, vehicle, swarm)

    def command(self, name: CommandName, target: int = 0) -> Command:
        return Command(next(self.identities), "ground", target, name)

    def to(self, phase: Phase) -> Flight:
        """Fly the ordinary way until `phase`."""
        self.step(GROUND, ALONE, self.command(CommandName.START))
        if phase is Phase.ARMING:
            return self
        self.step(ARMED)
        if phase is Phase.TAKEOFF:
            return self
        self.step(UP)
        if phase is Phase.FORMING:
            return self
        self.step(UP, msgspec.structs.replace(ALONE, formed_up=True, order=order(Stage.FORM)))
        if phase is Phase.TRACKING:
            self.step(UP, msgspec.structs.replace(ALONE, order=order(Stage.TRACK)))
        if phase is Phase.HOLDING:
            self.step(UP, ALONE, self.command(CommandName.PAUSE))
        if phase is Phase.LEAVING:
            self.step(UP, ALONE, self.command(CommandName.ABORT, 3))
        if phase is Phase.RETURNING:
            self.step(UP, ALONE, self.command(CommandName.ABORT))
        assert self.machine.phase is phase
        return self


def test_a_whole_flight() -> None:
    flight = Flight()
    step = flight.step(GROUND, ALONE, flight.command(CommandName.START))
    assert step.phase is Phase.ARMING
    assert step.started == "c0"
    assert step.asks == (Ask.ARM,)
    step = flight.step(ARMED)
    assert (step.phase, step.asks) == (Phase.TAKEOFF, (Ask.TAKE_OFF,))
    step = flight.step(UP)
    assert (step.phase, step.steering) == (Phase.FORMING, True)
    step = flight.step(UP, msgspec.structs.replace(ALONE, formed_up=True, order=order(Stage.FORM)))
    assert step.phase is Phase.SEARCHING
    assert flight.step(UP, msgspec.structs.replace(ALONE, order=order(Stage.TRACK))).phase is Phase.TRACKING
    step = flight.step(UP, msgspec.structs.replace(ALONE, order=order(Stage.FOUND)))
    assert step.phase is Phase.RETURNING
    step = flight.step(UP, msgspec.structs.replace(ALONE, order=order(Stage.FOUND), over_home=True))
    assert (step.phase, step.asks, step.steering) == (Phase.LANDING, (Ask.LAND,), False)
    landing = msgspec.structs.replace(UP, ours=False, mode="LAND")
    assert flight.step(landing).asks == ()
    assert flight.step(msgspec.structs.replace(landing, armed=False, airborne=False)).phase is Phase.LANDED
    assert flight.step(GROUND, ALONE, flight.command(CommandName.START)).phase is Phase.ARMING


@pytest.mark.parametrize("phase", sorted(STEERING))
def test_a_mode_that_is_not_ours_ends_our_authority_at_once(phase: Phase) -> None:
    flight = Flight().to(phase)
    flight.step(UP)
    step = flight.step(msgspec.structs.replace(UP, ours=False, mode="LOITER"))
    assert step.phase is Phase.PILOT
    assert not step.steering
    assert step.asks == ()
    for _ in range(200):  # and it is not taken back, whatever the mode becomes
        assert flight.step(UP).phase is Phase.PILOT


def test_resume_takes_control_back_after_the_pilot() -> None:
    flight = Flight().to(Phase.SEARCHING)
    taken = msgspec.structs.replace(UP, ours=False, mode="LOITER")
    flight.step(taken)
    step = flight.step(taken, ALONE, flight.command(CommandName.RESUME))
    assert (step.phase, step.asks) == (Phase.FORMING, (Ask.TAKE_CONTROL,))
    assert flight.step(taken).phase is Phase.FORMING  # the mode change takes a moment
    assert flight.step(UP).phase is Phase.FORMING
    assert flight.step(taken).phase is Phase.PILOT


def test_control_that_is_never_given_goes_back_to_the_pilot() -> None:
    flight = Flight().to(Phase.SEARCHING)
    taken = msgspec.structs.replace(UP, ours=False, mode="LOITER")
    flight.step(taken)
    flight.step(taken, ALONE, flight.command(CommandName.ABORT))
    phases = {flight.step(taken).phase for _ in range(150)}
    assert phases == {Phase.RETURNING, Phase.PILOT}
    assert flight.machine.phase is Phase.PILOT


def test_a_command_is_carried_out_once_and_answered_always() -> None:
    flight = Flight()
    start = flight.command(CommandName.START)
    assert flight.step(GROUND, ALONE, start).started == start.identity
    again = flight.step(ARMED, ALONE, start)
    assert again.started is None
    assert again.outcomes[0].result is Result.ACCEPTED


@pytest.mark.parametrize("phase", sorted(TAKING_PART - {Phase.HOLDING}))
def test_a_start_for_those_that_did_not_hear_the_first_is_nothing_new_to_the_others(phase: Phase) -> None:
    flight = Flight().to(phase)
    vehicle = GROUND if phase is Phase.ARMING else ARMED if phase is Phase.TAKEOFF else UP
    step = flight.step(vehicle, ALONE, flight.command(CommandName.START))
    assert (step.outcomes[0].result, step.started, step.phase) == (Result.ACCEPTED, None, phase)


def test_commands_to_others_are_not_ours() -> None:
    flight = Flight()
    step = flight.step(GROUND, ALONE, flight.command(CommandName.START, target=4))
    assert (step.phase, step.outcomes) == (Phase.DISARMED, ())


@pytest.mark.parametrize(
    ("phase", "name"),
    [
        (Phase.DISARMED, CommandName.PAUSE),
        (Phase.RETURNING, CommandName.RESUME),
        (Phase.RETURNING, CommandName.PAUSE),
        (Phase.HOLDING, CommandName.START),
        (Phase.RETURNING, CommandName.START),
    ],
)
def test_what_cannot_be_is_refused_with_a_reason_and_changes_nothing(phase: Phase, name: CommandName) -> None:
    flight = Flight() if phase is Phase.DISARMED else Flight().to(phase)
    step = flight.step(GROUND if phase is Phase.DISARMED else UP, ALONE, flight.command(name))
    assert step.outcomes[0].result is Result.REFUSED
    assert step.outcomes[0].reason
    assert step.phase is phase


def test_start_is_refused_while_the_autopilot_is_silent() -> None:
    flight = Flight()
    silent = msgspec.structs.replace(GROUND, connected=False)
    step = flight.step(silent, ALONE, flight.command(CommandName.START))
    assert step.outcomes[0].reason.startswith("the autopilot does not answer")


def test_an_autopilot_that_never_gets_ready_ends_in_a_named_failure() -> None:
    flight = Flight().to(Phase.ARMING)
    step = flight.step(msgspec.structs.replace(GROUND, problem="not armed within 60 s: EKF has no position"))
    assert step.phase is Phase.DISARMED
    assert "EKF has no position" in step.notes[0].text
    assert step.notes[0].severity is Severity.CRITICAL


def test_a_takeoff_that_stalls_ends_in_a_landing() -> None:
    flight = Flight().to(Phase.TAKEOFF)
    step = flight.step(msgspec.structs.replace(ARMED, airborne=True, problem="take-off: stopped at 2.0 m"))
    assert (step.phase, step.asks) == (Phase.LANDING, (Ask.LAND,))


def test_abort_while_arming_cancels_the_start() -> None:
    flight = Flight().to(Phase.ARMING)
    step = flight.step(ARMED, ALONE, flight.command(CommandName.ABORT))
    assert (step.phase, step.asks) == (Phase.DISARMED, (Ask.DISARM,))


def test_rtl_is_asked_until_the_mode_has_left_ours_and_not_after() -> None:
    flight = Flight().to(Phase.SEARCHING)
    assert flight.step(UP, ALONE, flight.command(CommandName.RTL)).asks == (Ask.RETURN,)
    assert flight.step(UP).asks == (Ask.RETURN,)
    assert flight.step(msgspec.structs.replace(UP, ours=False, mode="RTL")).asks == ()
    assert flight.step(msgspec.structs.replace(UP, ours=False, mode="LOITER")).asks == ()


LOW = msgspec.structs.replace(ALONE, must_return="battery at 20 %")


@pytest.mark.parametrize(
    ("phase", "to"),
    [
        (Phase.FORMING, Phase.RETURNING),
        (Phase.SEARCHING, Phase.LEAVING),
        (Phase.TRACKING, Phase.LEAVING),
        (Phase.HOLDING, Phase.LEAVING),
    ],
)
def test_a_drone_that_cannot_go_on_announces_it_and_hands_over_what_it_has(phase: Phase, to: Phase) -> None:
    flight = Flight().to(phase)
    step = flight.step(UP, LOW)
    assert (step.phase, step.steering) == (to, True)
    assert to not in TAKING_PART, "the others need not find out"
    assert any("battery" in note.text for note in step.notes)


def test_who_leaves_waits_for_its_heir_and_then_goes_home() -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(UP, LOW)
    out = msgspec.structs.replace(LOW, member=False)
    assert flight.step(UP, out).phase is Phase.LEAVING
    step = flight.step(UP, msgspec.structs.replace(out, handed_over=True))
    assert step.phase is Phase.RETURNING
    assert flight.step(UP, msgspec.structs.replace(out, flies_on=True)).phase is Phase.RETURNING


def test_who_leaves_does_not_wait_for_ever() -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(UP, LOW)
    for _ in range(round(HAND_OVER_S * 10)):
        assert flight.step(UP, LOW).phase is Phase.LEAVING
    flight.step(UP, LOW)
    assert flight.step(UP, LOW).phase is Phase.RETURNING


@pytest.mark.parametrize("urgent", ["in_haste", "parted"])
def test_who_has_no_time_or_nobody_to_hand_over_to_goes_at_once(urgent: str) -> None:
    flight = Flight().to(Phase.SEARCHING)
    assert flight.step(UP, msgspec.structs.replace(LOW, **{urgent: True})).phase is Phase.RETURNING
    flight = Flight().to(Phase.SEARCHING)
    assert flight.step(UP, LOW).phase is Phase.LEAVING
    assert flight.step(UP, msgspec.structs.replace(LOW, **{urgent: True})).phase is Phase.RETURNING


def test_a_single_drone_that_is_called_home_hands_over_and_all_of_them_go_at_once() -> None:
    flight = Flight().to(Phase.SEARCHING)
    assert flight.step(UP, ALONE, flight.command(CommandName.ABORT, 3)).phase is Phase.LEAVING
    assert flight.step(UP, ALONE, flight.command(CommandName.ABORT, 3)).phase is Phase.RETURNING
    flight = Flight().to(Phase.SEARCHING)
    assert flight.step(UP, ALONE, flight.command(CommandName.ABORT)).phase is Phase.RETURNING


@pytest.mark.parametrize(
    ("name", "phase"), [(CommandName.ABORT, Phase.RETURNING), (CommandName.LAND, Phase.LANDING)]
)
def test_an_agent_restarted_in_the_air_obeys_what_brings_its_drone_down(
    name: CommandName, phase: Phase
) -> None:
    flight = Flight()
    assert flight.step(UP).phase is Phase.DISARMED
    assert flight.step(UP, ALONE, flight.command(CommandName.START)).outcomes[0].result is Result.REFUSED
    assert flight.step(UP, ALONE, flight.command(name)).phase is phase


def test_an_agent_restarted_in_the_air_joins_what_the_others_fly_when_it_is_told_to() -> None:
    flight = Flight()
    heard = msgspec.structs.replace(ALONE, flies_on=True)
    assert flight.step(UP, heard).phase is Phase.DISARMED, "nobody has given it the vehicle"
    alone = flight.step(UP, ALONE, flight.command(CommandName.RESUME))
    assert "no survey that it could join" in alone.outcomes[0].reason
    low = flight.step(
        UP, msgspec.structs.replace(heard, must_return="battery"), flight.command(CommandName.RESUME)
    )
    assert low.outcomes[0].reason == "battery"
    resume = flight.command(CommandName.RESUME)
    step = flight.step(UP, heard, resume)
    assert (step.phase, step.started) == (Phase.FORMING, resume.identity)
    assert flight.step(UP, heard, flight.command(CommandName.PAUSE)).started is None


def test_a_drone_whose_way_home_is_blocked_lands_where_it_is() -> None:
    flight = Flight().to(Phase.RETURNING)
    step = flight.step(UP, msgspec.structs.replace(ALONE, stuck=True))
    assert (step.phase, step.asks) == (Phase.LANDING, (Ask.LAND,))


def test_a_drone_whose_way_home_takes_too_long_lands_where_it_is_and_says_why() -> None:
    flight = Flight().to(Phase.RETURNING)
    step = flight.step(UP, msgspec.structs.replace(ALONE, overdue="the way home has no end: landing here"))
    assert (step.phase, step.asks) == (Phase.LANDING, (Ask.LAND,))
    assert [note.text for note in step.notes] == ["landing: the way home has no end: landing here"]


def put_out(flight: Flight, seconds: float) -> list[Note]:
    """Fly on without a slot; gives what is told."""
    notes: list[Note] = []
    for _ in range(round(seconds * 10)):
        notes += flight.step(UP, msgspec.structs.replace(ALONE, member=False)).notes
    return notes


@pytest.mark.parametrize("stage", [Stage.SEARCH, Stage.TRACK])
def test_a_drone_whose_slot_was_given_away_flies_to_the_next_that_is_free(stage: Stage) -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(UP, msgspec.structs.replace(ALONE, order=order(stage)))
    before = flight.machine.phase
    put_out(flight, SLOTLESS_S)
    assert flight.machine.phase is before, "two that claim one slot settle it sooner"
    assert [note.code for note in put_out(flight, 0.3)] == ["rejoin"]
    assert flight.machine.phase is Phase.FORMING
    assert put_out(flight, NO_SLOT_S - 5.0) == []
    step = flight.step(UP, msgspec.structs.replace(ALONE, order=order(stage), formed_up=True))
    assert step.phase is before


def test_a_drone_for_which_there_is_no_slot_goes_home_after_a_while_and_stays_there() -> None:
    flight = Flight().to(Phase.SEARCHING)
    assert [note.code for note in put_out(flight, NO_SLOT_S + 1.0)] == ["rejoin", "leaving"]
    assert flight.machine.phase is Phase.RETURNING
    heard = msgspec.structs.replace(ALONE, member=False, flies_on=True)
    assert flight.step(UP, heard).phase is Phase.RETURNING


def test_a_drone_that_was_cut_off_takes_part_again_once_it_hears_the_swarm() -> None:
    flight = Flight().to(Phase.SEARCHING)
    cut_off = msgspec.structs.replace(ALONE, must_return="most fell silent", parted=True)
    assert flight.step(UP, cut_off).phase is Phase.RETURNING
    alone = msgspec.structs.replace(ALONE, member=False)
    assert flight.step(UP, alone).phase is Phase.RETURNING
    heard = msgspec.structs.replace(alone, flies_on=True)
    assert flight.step(UP, msgspec.structs.replace(heard, must_return="battery")).phase is Phase.RETURNING
    assert flight.step(UP, heard).phase is Phase.FORMING


@pytest.mark.parametrize("why", ["battery", "found", "aborted"])
def test_a_drone_that_goes_home_for_good_does_not_turn_back(why: str) -> None:
    flight = Flight().to(Phase.SEARCHING)
    match why:
        case "battery":
            flight.step(UP, msgspec.structs.replace(ALONE, must_return=why))
            flight.step(UP, msgspec.structs.replace(ALONE, handed_over=True))
        case "found":
            flight.step(UP, msgspec.structs.replace(ALONE, order=order(Stage.FOUND)))
        case "aborted":
            flight.step(UP, msgspec.structs.replace(ALONE, must_return="most fell silent", parted=True))
            flight.step(UP, ALONE, flight.command(CommandName.ABORT))
    assert flight.machine.phase is Phase.RETURNING
    assert flight.step(UP, msgspec.structs.replace(ALONE, flies_on=True)).phase is Phase.RETURNING


@pytest.mark.parametrize("phase", [Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING])
def test_a_drone_that_is_disarmed_during_the_survey_has_left_it(phase: Phase) -> None:
    flight = Flight().to(phase)
    swarm = msgspec.structs.replace(
        ALONE, order=order(Stage.TRACK if phase is Phase.TRACKING else Stage.SEARCH)
    )
    fallen = msgspec.structs.replace(ARMED, armed=False)
    phases = [flight.step(fallen, swarm).phase for _ in range(40)]
    assert phases[10] is phase  # one heartbeat that says so is not enough
    assert phases[-1] is Phase.LANDED


def test_a_survey_does_not_start_from_outside_the_fence() -> None:
    flight = Flight()
    outside = msgspec.structs.replace(ALONE, must_return="the launch point is 5 m outside the geofence")
    step = flight.step(GROUND, outside, flight.command(CommandName.START))
    assert step.outcomes[0].result is Result.REFUSED
    assert "outside the geofence" in step.outcomes[0].reason
    assert step.phase is Phase.DISARMED


def test_a_drone_that_somebody_flies_again_obeys_what_brings_it_down() -> None:
    """Landed, then taken up by remote control: what is answered is what is done."""
    flight = Flight().to(Phase.RETURNING)
    flight.step(UP, msgspec.structs.replace(ALONE, over_home=True))
    assert flight.step(GROUND).phase is Phase.LANDED
    flown = msgspec.structs.replace(UP, ours=False, mode="LOITER")
    step = flight.step(flown, ALONE, flight.command(CommandName.ABORT))
    assert (step.phase, step.outcomes[0].result, step.asks) == (Phase.LANDED, Result.REFUSED, ())
    step = flight.step(flown, ALONE, flight.command(CommandName.RTL))
    assert (step.phase, step.outcomes[0].result, step.asks) == (Phase.RTL, Result.ACCEPTED, (Ask.RETURN,))


@pytest.mark.parametrize("name", [CommandName.ABORT, CommandName.RTL, CommandName.LAND])
@pytest.mark.parametrize("landed", [False, True], ids=["never-flown", "landed"])
def test_what_brings_a_drone_down_is_obeyed_by_one_that_is_down(name: CommandName, landed: bool) -> None:
    flight = Flight()
    if landed:
        flight.to(Phase.RETURNING)
        assert flight.step(GROUND).phase is Phase.LANDED
    before = flight.machine.phase
    step = flight.step(GROUND, ALONE, flight.command(name))
    assert (step.phase, step.asks) == (before, ())
    assert (step.outcomes[0].result, step.outcomes[0].reason) == (Result.ACCEPTED, "it is on the ground")


def test_a_drone_whose_autopilot_is_silent_is_not_known_to_be_down() -> None:
    silent = msgspec.structs.replace(GROUND, connected=False)
    flight = Flight()
    step = flight.step(silent, ALONE, flight.command(CommandName.ABORT))
    assert step.outcomes[0].result is Result.REFUSED
    assert step.outcomes[0].reason.startswith("the autopilot does not answer")


FALLEN = msgspec.structs.replace(
    UP, airborne=False, crash="fell and hit the ground at 9.8 m/s, at 38.4, 14.9"
)


@pytest.mark.parametrize("phase", [Phase.TAKEOFF, *sorted(STEERING)])
def test_a_crash_takes_the_drone_out_of_the_survey_at_once(phase: Phase) -> None:
    flight = Flight().to(phase)
    step = flight.step(FALLEN)
    assert (step.phase, step.steering, step.asks) == (Phase.CRASHED, False, (Ask.LAND,))
    assert [(n.severity, n.code) for n in step.notes] == [(Severity.CRITICAL, "crash")]
    assert step.notes[0].text == "crashed: fell and hit the ground at 9.8 m/s, at 38.4, 14.9"
    assert Phase.CRASHED not in TAKING_PART
    assert flight.step(FALLEN).notes == (), "once"
    disarmed = msgspec.structs.replace(FALLEN, armed=False, ours=False)
    assert (flight.step(disarmed).phase, flight.step(disarmed).asks) == (Phase.CRASHED, ())


def test_a_wreck_that_somebody_arms_again_is_the_pilots() -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(FALLEN)
    flight.step(msgspec.structs.replace(FALLEN, armed=False))
    step = flight.step(msgspec.structs.replace(UP, ours=False, mode="LOITER"))
    assert step.phase is Phase.PILOT
    assert "armed it again" in step.notes[0].text


@pytest.mark.parametrize(
    ("phase", "after"),
    [(Phase.SEARCHING, Phase.LANDING), (Phase.TAKEOFF, Phase.LANDING), (Phase.PILOT, Phase.PILOT)],
)
def test_what_was_taken_for_a_wreck_and_flies_on_lands_or_is_the_pilots(phase: Phase, after: Phase) -> None:
    flight = Flight().to(Phase.SEARCHING if phase is Phase.PILOT else phase)
    lands = msgspec.structs.replace(UP, ours=False, mode="LAND")
    if phase is Phase.PILOT:
        assert flight.step(lands).phase is Phase.PILOT
    flight.step(FALLEN)
    step = flight.step(lands)
    assert (step.phase, step.asks) == (after, ())
    assert [(n.severity, n.code) for n in step.notes] == [(Severity.CRITICAL, "crash")]
    assert "it did not crash, it flies on" in step.notes[0].text
    assert flight.step(lands, ALONE, flight.command(CommandName.RTL)).phase is Phase.RTL


def test_a_wreck_starts_again_when_its_autopilot_was_restarted() -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(FALLEN)
    wreck = msgspec.structs.replace(FALLEN, armed=False, ours=False)
    refused = flight.step(wreck, ALONE, flight.command(CommandName.START))
    assert (refused.phase, refused.outcomes[0].result) == (Phase.CRASHED, Result.REFUSED)
    assert flight.step(GROUND, ALONE, flight.command(CommandName.START)).phase is Phase.ARMING


def taken(*later: VehicleFacts, seconds: float = 4.0) -> list[tuple[str, str]]:
    """What is told of a mode that was taken: (code, text). `later`: the facts of the ticks, the last one for ever."""
    flight = Flight().to(Phase.SEARCHING)
    told = []
    for tick in range(round(seconds * 10)):
        step = flight.step(later[min(tick, len(later) - 1)])
        assert step.phase is Phase.PILOT
        told += [(note.code, note.text) for note in step.notes]
    return told


def test_who_took_the_mode_is_told_once_and_by_the_autopilots_own_text() -> None:
    pilot = msgspec.structs.replace(
        UP, ours=False, mode="RTL", taken_reason="mode changed from GUIDED to RTL"
    )
    fence = msgspec.structs.replace(
        pilot, failsafe=True, taken_reason="mode changed from GUIDED to RTL (Fence Breached)"
    )
    failsafe = (
        "failsafe",
        "pilot: failsafe of the autopilot: mode changed from GUIDED to RTL (Fence Breached)",
    )
    assert taken(fence) == [failsafe]
    assert taken(pilot, pilot, pilot, fence) == [failsafe], "the text came after the mode"
    assert taken(pilot) == [
        ("pilot", "pilot: by the pilot or another ground station: mode changed from GUIDED to RTL")
    ]


FAILSAFE_HOME = msgspec.structs.replace(
    UP,
    ours=False,
    mode="RTL",
    failsafe=True,
    returns=True,
    taken_reason="mode changed from GUIDED to RTL (Fence Breached)",
)
FAILSAFE_DOWN = msgspec.structs.replace(FAILSAFE_HOME, mode="LAND", returns=False, lands=True)
PILOTS = msgspec.structs.replace(
    UP, ours=False, mode="LOITER", taken_reason="mode changed from RTL to LOITER"
)


@pytest.mark.parametrize("phase", sorted(STEERING | {Phase.TAKEOFF}))
@pytest.mark.parametrize(("facts", "to"), [(FAILSAFE_HOME, Phase.RTL), (FAILSAFE_DOWN, Phase.LANDING)])
def test_a_failsafe_that_brings_it_down_is_followed_to_the_ground_and_no_pilot(
    phase: Phase, facts: VehicleFacts, to: Phase
) -> None:
    flight = Flight().to(phase)
    step = flight.step(facts)
    assert (step.phase, step.asks, step.steering) == (to, (), False)
    told = "failsafe of the autopilot: mode changed from GUIDED to RTL (Fence Breached)"
    assert [(note.code, note.text) for note in step.notes] == [("failsafe", f"{to}: {told}")]
    assert to not in TAKING_PART, "the others must hear that it left"
    for _ in range(100):
        step = flight.step(facts)
        assert (step.phase, step.asks, step.notes) == (to, (), ())
    down = msgspec.structs.replace(facts, armed=False, airborne=False)
    assert flight.step(down).phase is Phase.LANDED
    assert flight.step(GROUND, ALONE, flight.command(CommandName.START)).phase is Phase.ARMING


def test_a_failsafe_that_holds_first_or_is_named_late_is_followed_from_then_on() -> None:
    flight = Flight().to(Phase.SEARCHING)
    holds = msgspec.structs.replace(FAILSAFE_HOME, mode="HOLD", returns=False)
    assert flight.step(holds).phase is Phase.PILOT
    assert flight.step(FAILSAFE_HOME).phase is Phase.RTL
    assert flight.step(FAILSAFE_DOWN).phase is Phase.LANDING
    unnamed = msgspec.structs.replace(FAILSAFE_HOME, failsafe=False, taken_reason="mode changed")
    flight = Flight().to(Phase.SEARCHING)
    assert flight.step(unnamed).phase is Phase.PILOT
    for _ in range(60):
        assert flight.step(unnamed).phase is Phase.PILOT
    assert flight.step(FAILSAFE_HOME).phase is Phase.RTL


def test_a_pilot_who_takes_it_out_of_a_failsafe_has_it() -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(FAILSAFE_HOME)
    told = []
    for _ in range(40):
        step = flight.step(PILOTS)
        assert (step.phase, step.asks) == (Phase.PILOT, ())
        told += [note.text for note in step.notes]
    assert told == ["pilot: by the pilot or another ground station: mode changed from RTL to LOITER"]


def test_a_return_by_command_is_not_the_failsafes_and_a_mode_chosen_then_is_left_alone() -> None:
    flight = Flight().to(Phase.SEARCHING)
    flight.step(UP, ALONE, flight.command(CommandName.RTL))
    assert flight.step(msgspec.structs.replace(UP, ours=False, mode="RTL", returns=True)).phase is Phase.RTL
    assert flight.step(PILOTS).phase is Phase.RTL


def test_a_pilot_who_takes_the_mode_in_the_very_tick_after_the_take_off_keeps_it() -> None:
    flight = Flight().to(Phase.FORMING)
    step = flight.step(msgspec.structs.replace(UP, ours=False, mode="LOITER", taken_reason="mode changed"))
    assert (step.phase, step.asks) == (Phase.PILOT, ())


@pytest.mark.parametrize("command", [CommandName.RESUME, CommandName.ABORT])
def test_a_pilot_who_chooses_another_mode_while_ours_is_waited_for_has_said_no(command: CommandName) -> None:
    taken = msgspec.structs.replace(
        UP, ours=False, mode="LOITER", taken_reason="mode changed from GUIDED to LOITER"
    )
    flight = Flight().to(Phase.SEARCHING)
    flight.step(taken)
    step = flight.step(taken, ALONE, flight.command(command))
    assert step.asks == (Ask.TAKE_CONTROL,)
    named = msgspec.structs.replace(taken, taken_reason=taken.taken_reason + " (Fence Breached)")
    assert flight.step(named).asks == (Ask.TAKE_CONTROL,), "no new change: the same one, explained"
    no = msgspec.structs.replace(
        taken, mode="STABILIZE", taken_reason="mode changed from LOITER to STABILIZE"
    )
    step = flight.step(no)
    assert (step.phase, step.asks) == (Phase.PILOT, ())
