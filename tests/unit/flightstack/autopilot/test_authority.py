"""Who has a PX4 when it leaves Offboard: itself for want of setpoints, for good, or a pilot."""

from __future__ import annotations

import pytest

from flightstack.autopilot import TakenBy
from flightstack.autopilot.authority import FROZEN_S, RESUMES_S, Authority
from flightstack.mavlink.modes import Duty, Flavour, mode_of

OFFBOARD, RETURN, HOLD = (mode_of(Flavour.PX4, duty) for duty in (Duty.CONTROL, Duty.RETURN, Duty.HOLD))
ACTIVE, CRITICAL = 4, 5
NO_SETPOINTS = "Failsafe activated: switching to Return (No offboard signal)"


class Followed:
    """An authority, and a PX4 in Offboard whose heartbeats it gets."""

    def __init__(self) -> None:
        self.authority = Authority()
        self.now_s = 0.0
        self.authority.heartbeat(0.0, Flavour.PX4, False, OFFBOARD, 3)
        self.beat(OFFBOARD)

    def beat(self, mode: int, status: int = ACTIVE) -> TakenBy:
        self.now_s += 1.0
        self.authority.heartbeat(self.now_s, Flavour.PX4, True, mode, status)
        return self.authority.taken_by

    def say(self, text: str) -> None:
        self.authority.text(self.now_s + 0.5, text)


def test_the_failsafe_for_want_of_setpoints_is_over_when_offboard_is_back() -> None:
    px4 = Followed()
    px4.say(NO_SETPOINTS)
    assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.authority.resuming
    assert px4.authority.failsafe
    assert px4.beat(OFFBOARD) is TakenBy.NOBODY
    assert not px4.authority.resuming
    assert not px4.authority.failsafe
    assert px4.authority.takeovers == 0
    assert px4.beat(HOLD) is TakenBy.PILOT, "what comes then is somebody's choice"


def test_a_pause_of_our_own_explains_it_where_no_words_come() -> None:
    px4 = Followed()
    px4.authority.stood_still(px4.now_s + 0.5)
    assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.beat(OFFBOARD) is TakenBy.NOBODY


def test_a_failsafe_that_lasts_has_the_vehicle() -> None:
    px4 = Followed()
    px4.say(NO_SETPOINTS)
    for _ in range(round(RESUMES_S) + 1):
        assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.beat(RETURN, CRITICAL) is TakenBy.AUTOPILOT
    assert px4.authority.taken_reason == f"mode changed from OFFBOARD to RTL ({NO_SETPOINTS})"
    assert px4.beat(OFFBOARD) is not TakenBy.NOBODY, "only a command gives it back"


@pytest.mark.parametrize("mode", [RETURN, HOLD, 3 << 16])
def test_a_pilot_is_a_pilot_also_after_a_pause(mode: int) -> None:
    px4 = Followed()
    px4.authority.stood_still(px4.now_s + 0.5)
    assert px4.beat(mode, ACTIVE) is TakenBy.PILOT


def test_a_pilot_who_takes_it_out_of_the_failsafe_has_it() -> None:
    px4 = Followed()
    px4.say(NO_SETPOINTS)
    px4.beat(RETURN, CRITICAL)
    assert px4.beat(3 << 16, ACTIVE) is TakenBy.PILOT
    assert not px4.authority.resuming


@pytest.mark.parametrize(
    "text",
    [
        "Failsafe activated: switching to Return (Geofence violation: approaching or outside geofence)",
        "Failsafe activated: Critical battery: Hold, switching to Return in 5 seconds",
    ],
)
def test_another_failsafe_takes_it_at_once_also_after_a_pause(text: str) -> None:
    px4 = Followed()
    px4.authority.stood_still(px4.now_s + 0.5)
    px4.say(text)
    assert px4.beat(RETURN, CRITICAL) is TakenBy.AUTOPILOT
    assert text in px4.authority.taken_reason


def test_an_ardupilot_does_not_come_back_by_itself() -> None:
    authority = Authority()
    authority.heartbeat(0.0, Flavour.ARDUPILOT, False, 4, 3)
    authority.heartbeat(1.0, Flavour.ARDUPILOT, True, 4, ACTIVE)
    authority.stood_still(1.5)
    authority.heartbeat(2.0, Flavour.ARDUPILOT, True, 6, CRITICAL)
    assert authority.taken_by is TakenBy.AUTOPILOT
    assert not authority.resuming


def test_a_warning_is_no_failsafe_and_explains_no_mode() -> None:
    px4 = Followed()
    px4.say("Failsafe warning: Low battery")
    assert px4.beat(HOLD) is TakenBy.PILOT


def test_words_that_do_not_say_why_are_no_other_cause() -> None:
    """What the failsafe is for stands in a report that may not have come: it was sent while nobody listened."""
    px4 = Followed()
    px4.authority.stood_still(px4.now_s + 0.4, 4.0)
    px4.say("Failsafe activated: switching to Return")
    assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.beat(OFFBOARD) is TakenBy.NOBODY


def test_without_a_word_it_is_px4_that_says_whether_setpoints_were_all_that_was_missing() -> None:
    """They came late on their way to it; we have sent them all the time."""
    px4 = Followed()
    assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.beat(OFFBOARD) is TakenBy.NOBODY
    for _ in range(round(RESUMES_S) + 1):
        assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.beat(RETURN, CRITICAL) is TakenBy.AUTOPILOT


def test_another_cause_that_is_named_later_ends_the_waiting_at_once() -> None:
    px4 = Followed()
    assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    px4.say("Failsafe activated: switching to Return (Battery unhealthy)")
    assert px4.authority.taken_by is TakenBy.AUTOPILOT
    assert not px4.authority.resuming
    assert "Battery unhealthy" in px4.authority.taken_reason


def test_a_pause_while_it_is_waited_for_makes_the_waiting_longer() -> None:
    px4 = Followed()
    px4.say(NO_SETPOINTS)
    px4.beat(RETURN, CRITICAL)
    for _ in range(4):
        px4.now_s += RESUMES_S
        px4.authority.stood_still(px4.now_s + 0.5, RESUMES_S)
        assert px4.beat(RETURN, CRITICAL) is TakenBy.NOBODY
    assert px4.beat(OFFBOARD) is TakenBy.NOBODY


@pytest.mark.parametrize("flavour", [Flavour.ARDUPILOT, Flavour.PX4])
@pytest.mark.parametrize("duty", [Duty.RETURN, Duty.LAND])
def test_what_is_found_on_its_way_down_after_a_long_stand_still_is_no_pilots(
    flavour: Flavour, duty: Duty
) -> None:
    """Nobody saw who sent it: its failsafe, whose words are lost, or the ground station that missed us."""
    authority = Authority()
    authority.heartbeat(0.0, flavour, False, mode_of(flavour, Duty.CONTROL), 3)
    authority.heartbeat(1.0, flavour, True, mode_of(flavour, Duty.CONTROL), ACTIVE)
    authority.stood_still(31.0, 30.0)
    authority.heartbeat(31.5, flavour, True, mode_of(flavour, duty), ACTIVE)
    assert authority.taken_by is TakenBy.AUTOPILOT
    assert "while this program stood still for 30 s" in authority.taken_reason
    authority.heartbeat(36.0, flavour, True, mode_of(flavour, Duty.HOLD), ACTIVE)
    assert authority.taken_by is TakenBy.PILOT


def test_a_mode_of_a_person_is_a_pilots_however_long_we_stood_still() -> None:
    px4 = Followed()
    px4.authority.stood_still(px4.now_s + 0.5, 10.0 * FROZEN_S)
    assert px4.beat(3 << 16, ACTIVE) is TakenBy.PILOT


def test_a_px4_that_holds_before_it_returns_is_still_in_its_failsafe() -> None:
    px4 = Followed()
    px4.say("Failsafe activated: Critical battery: Hold, switching to Return in 5 seconds")
    assert px4.beat(HOLD, CRITICAL) is TakenBy.AUTOPILOT
    for _ in range(5):
        px4.beat(HOLD, CRITICAL)
    assert px4.beat(RETURN, CRITICAL) is TakenBy.AUTOPILOT
    assert px4.beat(HOLD, ACTIVE) is TakenBy.PILOT
