"""The table of phases, every state and every event; and what flies it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import msgspec
import pytest

from flightstack.flight.facts import SwarmFacts, VehicleFacts
from flightstack.flight.phase import FlightPhase
from flightstack.flight.transitions import (
    STEERING,
    TRANSITIONS,
    FlightEvent,
    IllegalTransitionError,
    following,
)
from flightstack.swarm.wire import TAKING_PART, Command, CommandName, Phase, Result
from mission.strategies.contract import Order, Stage

PHASES = (
    Phase.DISARMED, Phase.ARMING, Phase.TAKEOFF, Phase.FORMING, Phase.SEARCHING, Phase.TRACKING, Phase.HOLDING,
    Phase.LEAVING, Phase.RETURNING, Phase.LANDING, Phase.RTL, Phase.PILOT, Phase.LANDED, Phase.CRASHED,
)  # fmt: skip
SHORT = {
    "dis": Phase.DISARMED, "arm": Phase.ARMING, "tko": Phase.TAKEOFF, "frm": Phase.FORMING, "sea": Phase.SEARCHING,
    "trk": Phase.TRACKING, "hld": Phase.HOLDING, "lvg": Phase.LEAVING, "ret": Phase.RETURNING,
    "lnd": Phase.LANDING, "rtl": Phase.RTL, "plt": Phase.PILOT, "dwn": Phase.LANDED, "crs": Phase.CRASHED,
}  # fmt: skip
EXPECTED = """
                 dis arm tko frm sea trk hld lvg ret lnd rtl plt dwn crs
start            arm arm tko frm sea trk  -   -   -   -   -   -  arm arm
pause             -   -   -  hld hld hld hld  -   -   -   -   -   -   -
resume           frm arm tko frm sea trk frm  -   -   -   -  frm  -   -
abort            ret dis ret ret ret ret ret ret ret lnd rtl ret  -  crs
rtl              rtl dis rtl rtl rtl rtl rtl rtl rtl rtl rtl rtl rtl crs
land             lnd dis lnd lnd lnd lnd lnd lnd lnd lnd lnd lnd lnd crs
armed             -  tko  -   -   -   -   -   -   -   -   -   -   -   -
arming_failed     -  dis  -   -   -   -   -   -   -   -   -   -   -   -
at_altitude       -   -  frm  -   -   -   -   -   -   -   -   -   -   -
takeoff_failed    -   -  lnd  -   -   -   -   -   -   -   -   -   -   -
control_lost      -   -  plt plt plt plt plt plt plt plt plt  -   -  plt
failsafe_returns  -   -   -   -   -   -   -   -   -  rtl rtl rtl  -   -
failsafe_lands    -   -   -   -   -   -   -   -   -  lnd lnd lnd  -   -
down              -   -  dwn dwn dwn dwn dwn dwn dwn dwn dwn dwn  -   -
crashed           -   -  crs crs crs crs crs crs crs crs crs crs crs  -
flies             -   -   -   -   -   -   -   -   -   -   -   -   -  lnd
search            -   -   -  sea  -  sea  -   -   -   -   -   -   -   -
track             -   -   -  trk trk  -   -   -   -   -   -   -   -   -
leave             -   -   -   -  lvg lvg lvg  -   -   -   -   -   -   -
go_home           -   -   -  ret ret ret ret ret  -   -   -   -   -   -
rejoin            -   -   -   -  frm frm  -   -  frm  -   -   -   -   -
over_home         -   -   -   -   -   -   -   -  lnd  -   -   -   -   -
blocked           -   -   -   -   -   -   -   -  lnd  -   -   -   -   -
"""
"""Written by hand, from what the phases mean."""


def expected() -> Iterator[tuple[Phase, FlightEvent, Phase | None]]:
    heads, *rows = (line.split() for line in EXPECTED.strip().splitlines())
    for event, *cells in rows:
        for head, cell in zip(heads, cells, strict=True):
            yield SHORT[head], FlightEvent(event), SHORT.get(cell)


CASES = list(expected())


def test_the_cases_are_all_there_are() -> None:
    assert {(phase, event) for phase, event, _ in CASES} == set(itertools.product(Phase, FlightEvent))


@pytest.mark.parametrize(("phase", "event", "to"), CASES)
def test_every_event_in_every_phase(phase: Phase, event: FlightEvent, to: Phase | None) -> None:
    if to is None:
        with pytest.raises(IllegalTransitionError, match=f"{event} cannot be in phase {phase}"):
            following(phase, event)
    else:
        assert following(phase, event) is to


@pytest.mark.parametrize(("phase", "event", "to"), CASES)
def test_the_machine_goes_by_the_table_and_an_illegal_event_changes_nothing(
    phase: Phase, event: FlightEvent, to: Phase | None
) -> None:
    machine = FlightPhase(3)
    machine.phase = phase
    if to is None:
        with pytest.raises(IllegalTransitionError):
            machine._happen(10.0, event, "for a test")
        assert machine.phase is phase
        assert machine._notes == []
    else:
        machine._happen(10.0, event, "for a test")
        assert machine.phase is to
        assert [note.text for note in machine._notes] == ([] if to is phase else [f"{to}: for a test"])


FLYING = VehicleFacts(
    connected=True, problem="", armed=True, airborne=True, ours=True, mode="GUIDED", taken_reason="",
    at_takeoff_altitude=False,
)  # fmt: skip
STANDING = msgspec.structs.replace(FLYING, armed=False, airborne=False, ours=False, mode="STABILIZE")
MEMBER = SwarmFacts(
    order=None, member=True, formed_up=False, over_home=False, stuck=False, must_return="", flies_on=True
)


@pytest.mark.parametrize("name", CommandName)
@pytest.mark.parametrize("phase", PHASES)
def test_a_command_is_carried_out_where_the_table_has_it_and_refused_where_not(
    phase: Phase, name: CommandName
) -> None:
    """In the air, and a start on the ground: so that nothing but the phase stands in the way."""
    machine = FlightPhase(3)
    machine.phase = phase
    vehicle = STANDING if name is CommandName.START or phase is Phase.ARMING else FLYING
    machine._answer(10.0, Command("c1", "ground", 0, name), vehicle, MEMBER)
    to = TRANSITIONS.get((phase, FlightEvent(name)))
    (outcome,) = machine._outcomes
    assert machine.phase is (phase if to is None else to)
    assert outcome.result is (Result.REFUSED if to is None else Result.ACCEPTED)
    assert bool(outcome.reason) is (to is None)
    assert machine._prompt is None or outcome.result is Result.ACCEPTED, "what is refused is not done either"


@pytest.mark.parametrize("name", CommandName)
@pytest.mark.parametrize("phase", PHASES)
def test_no_facts_lead_to_an_illegal_event(phase: Phase, name: CommandName) -> None:
    """Every phase, every command, and every combination of what can be known of vehicle and swarm."""
    command = Command("c1", "ground", 0, name)
    flags = (False, True)
    stages = (None, *Stage)
    failsafes = ((False, False, False), (True, False, False), (True, True, False), (True, False, True))
    for (connected, armed, airborne, ours, high, problem), (failsafe, returns, lands) in itertools.product(
        itertools.product(flags, repeat=6), failsafes
    ):
        vehicle = VehicleFacts(
            connected=connected, problem="no" if problem else "", armed=armed, airborne=airborne, ours=ours,
            mode="X", taken_reason="", at_takeoff_altitude=high, failsafe=failsafe, returns=returns, lands=lands,
        )  # fmt: skip
        for stage, member, near, must in itertools.product(stages, flags, flags, flags):
            order = None if stage is None else Order(1, stage, (0.0, 0.0, -10.0), 0.0)
            swarm = SwarmFacts(
                order=order, member=member, formed_up=near, over_home=near, stuck=near and member,
                must_return="battery" if must else "", parted=must and near, flies_on=member,
                handed_over=near, in_haste=near and must,
            )  # fmt: skip
            machine = FlightPhase(3)
            machine.phase = phase
            step = machine.step(10.0, [command], vehicle, swarm)
            assert [outcome.command for outcome in step.outcomes] == ["c1"]
            assert step.steering is (step.phase in STEERING)
            machine.step(20.0, [], vehicle, swarm)


def test_a_drone_takes_part_from_arming_to_the_end_of_the_search() -> None:
    """What the others take for a member, the table lets a pause or the swarm's order reach."""
    assert {phase for phase in Phase if (phase, FlightEvent.RESUME) in TRANSITIONS} - {
        Phase.PILOT,
        Phase.DISARMED,
    } == TAKING_PART
