"""One command and its answers."""

from __future__ import annotations

import pytest

from flightstack.swarm.wire import CommandName, CommandOutcome, Result
from gcs.commands.survey_command import SurveyCommand


def make(target=0, members=(1, 2, 3), deadline_s=5.0):
    return SurveyCommand(
        CommandName.START,
        sender="op",
        target=target,
        members=members,
        started_s=100.0,
        deadline_s=deadline_s,
    )


def answer(command, drone, result=Result.ACCEPTED, reason=""):
    command.answered(CommandOutcome(command.command.identity, drone, result, reason))


def results(command):
    return {a.drone: a.result for a in command.answers()}


def test_all_accept():
    command = make()
    for drone in (1, 2, 3):
        command.heard(drone)
        answer(command, drone)
    assert command.done(100.1)
    assert command.accepted()


def test_it_is_repeated_twice_a_second_as_the_same_command():
    command = make()
    sent = [t / 10 for t in range(1000, 1030) if command.due(t / 10)]
    assert sent == pytest.approx([100.0, 100.5, 101.0, 101.5, 102.0, 102.5])
    assert make().command.identity != command.command.identity


def test_a_refusal_ends_the_waiting_but_not_well():
    command = make(members=(1, 2))
    answer(command, 1)
    answer(command, 2, Result.REFUSED, "already flying")
    assert command.done(100.5)
    assert not command.accepted()
    assert command.answers()[1].reason == "already flying"


def test_a_live_drone_is_waited_for_until_the_deadline():
    command = make(members=(1, 2))
    command.heard(2)
    answer(command, 1)
    assert not command.done(104.9)
    assert command.done(105.0)
    assert results(command) == {1: "accepted", 2: "no answer"}
    assert not command.accepted()


def test_a_drone_that_nobody_hears_is_not_waited_for():
    command = make(members=(1, 2))
    command.heard(1)
    answer(command, 1)
    assert not command.done(101.9), "it may still be found"
    assert command.done(102.0)
    assert results(command) == {1: "accepted", 2: "not heard"}
    assert not command.accepted()


def test_one_drone():
    command = make(target=2)
    command.heard(1)
    answer(command, 2)
    assert command.done(100.1)
    assert command.accepted()
    assert results(command) == {2: "accepted"}


def test_without_a_list_of_members_whoever_is_heard_counts():
    command = make(members=())
    assert not command.done(100.0)
    for drone in (7, 5):
        command.heard(drone)
        answer(command, drone)
    assert not command.done(100.5), "somebody may still be found"
    assert command.done(102.0)
    assert results(command) == {5: "accepted", 7: "accepted"}


def test_nobody_at_all_is_no_success():
    command = make(members=())
    assert command.done(102.0)
    assert not command.accepted()


def test_answers_to_other_commands_do_not_count():
    command = make(members=(1,))
    command.answered(CommandOutcome("another", 1, Result.ACCEPTED))
    assert results(command) == {1: "not heard"}


def test_a_drones_acceptance_is_not_undone_by_the_stations_late_word():
    command = make(members=(1,))
    answer(command, 1)
    answer(command, 1, Result.REFUSED, "its agent is silent")
    assert command.accepted()


@pytest.mark.parametrize("without", [False, True])
def test_it_says_whether_a_flight_may_go_unrecorded(without):
    command = SurveyCommand(
        CommandName.START,
        sender="op",
        target=0,
        members=(1,),
        started_s=0.0,
        deadline_s=5.0,
        without_recording=without,
    )
    assert command.command.without_recording is without


def test_every_time_it_is_said_it_has_a_number_of_its_own():
    """Drones hear nothing twice under one number: that was recorded."""
    command = make()
    numbers = [command.command.sequence for tenth in range(1000, 1030) if command.due(tenth / 10)]
    assert numbers == [1, 2, 3, 4, 5, 6]
