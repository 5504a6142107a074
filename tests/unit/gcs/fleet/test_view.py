"""The fleet view: restarts, clashes, ages, who speaks for a drone."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.swarm import topics
from flightstack.swarm.topics import Received
from flightstack.swarm.wire import (
    Command,
    CommandName,
    CommandOutcome,
    GroundReport,
    HeardVehicle,
    Phase,
    Result,
)
from gcs.fleet.view import FleetView
from mission.estimation.estimates import Scalar, Wind
from mission.tree.slot_registers import SlotRegister


def test_rows_show_what_the_agent_says(frame, state, on_air):
    view = FleetView((1, 2), frame, 0.0)
    told = state(
        1, excess_co2_ppm=Scalar(30.0, 4.0, 0.1), wind=Wind((0.0, -3.0, 0.0), 0.1, 0.2), notes=("co2: warm",)
    )
    view.receive_peer(10.0, on_air(told))
    one, two = view.rows(11.0)
    assert (one.agent, one.agent_age_s, one.phase, one.mode) == ("live", 1.0, "searching", "GUIDED")
    assert one.above_home_m == pytest.approx(12.0)
    assert (one.excess_co2_ppm, one.excess_co2_sd_ppm) == (30.0, 2.0)
    assert one.wind_mps == pytest.approx(3.0)
    assert one.wind_from_deg == pytest.approx(90.0), "air that goes west is an east wind"
    assert frame.to_ned(frame.to_geodetic((10.0, 20.0, -12.0))) == pytest.approx(one.position_ned_m, abs=1e-3)
    assert (two.agent, two.agent_age_s, two.phase, two.vehicle) == ("never", None, None, "never")
    msgspec.json.encode(one)


def test_measurements_of_a_silent_agent_are_not_shown_as_current(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    view.receive_peer(0.0, on_air(state(1, excess_co2_ppm=Scalar(30.0, 4.0, 0.1))))
    (row,) = view.rows(2.5)
    assert (row.agent, row.excess_co2_ppm, row.co2_ppm) == ("silent", None, None)
    assert row.phase == "searching", "the last known phase stays"


def test_late_and_repeated_messages_change_nothing(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    view.receive_peer(1.0, on_air(state(1, sequence=5, mode="RTL")))
    view.receive_peer(2.0, on_air(state(1, sequence=4, mode="GUIDED")))
    view.receive_peer(2.0, on_air(state(1, sequence=5, mode="GUIDED")))
    assert view.agents[1].state.mode == "RTL"
    assert view.agents[1].age_s(3.0) == 2.0, "an old message is no sign of life"


def test_a_restart_is_recognised_and_two_agents_with_one_id_too(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    view.receive_peer(1.0, on_air(state(1, sequence=500, ticks=500)))
    view.receive_peer(2.0, on_air(state(1, incarnation=107, sequence=1)))
    agent = view.agents[1]
    agents = agent.incarnations
    assert (agents.restarts, agents.has_twins(2.0), agent.state.sequence) == (1, False, 1)
    view.receive_peer(2.5, on_air(state(1, incarnation=107, sequence=2)))
    view.receive_peer(2.6, on_air(state(1, sequence=501, ticks=501)))
    view.receive_peer(2.7, on_air(state(1, incarnation=107, sequence=3)))
    view.receive_peer(2.8, on_air(state(1, sequence=502, ticks=502)))
    assert (agents.restarts, agents.has_twins(2.8), agent.state.incarnation) == (1, True, 101), "by its rank"
    view.receive_peer(5.0, on_air(state(1, incarnation=107, sequence=4)))
    assert agent.state.incarnation == 107, "whoever is heard now counts"


def test_late_ticks_are_a_share_of_the_newest_ticks(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    for second in range(30):
        late = max(0, second - 20) * 2
        view.receive_peer(
            float(second), on_air(state(1, sequence=second, ticks=second * 10, late_ticks=late))
        )
    assert view.agents[1].late_fraction() == pytest.approx(18 / 100)


def test_unreadable_messages_are_counted_with_their_reason(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    newer = topics.STATE.codec.encode(state(1))
    assert view.receive_peer(1.0, Received(topics.STATE, "1", b"\x09" + newer[1:])) is None
    assert "version 9" in view.garbled["1"].text
    assert view.receive_peer(1.0, on_air(state(2), sender="1")) is None
    assert "drone 2" in view.garbled["1"].text
    assert 2 not in view.agents


@pytest.mark.parametrize(
    ("changes", "sender", "told"),
    [
        ({}, "2", "a message of drone 1 came under the name 2"),
        (
            {"slots": ((0, SlotRegister(0, 1)), (9, SlotRegister(0, 2)))},
            "1",
            "its slots are not those of this swarm",
        ),
        ({"frame": 9}, "1", None),
        ({"sender": 9}, "9", None),
    ],
    ids=["another name", "implausible", "foreign frame", "stranger"],
)
def test_a_table_that_the_drones_refuse_is_not_believed_here_either(
    frame, table, on_air, changes, sender, told
):
    view = FleetView((1, 2, 3), frame, 0.0)
    assert view.receive_peer(1.0, on_air(table(1, (1, 2, 3), **changes), sender=sender)) is None
    assert all(agent.table is None for agent in view.agents.values())
    assert (view.garbled[sender].text if view.garbled else None) == told
    assert view.receive_peer(2.0, on_air(table(1, (1, 2, 3)))) is not None
    assert view.agents[1].table is not None


def test_a_drone_of_another_swarm_is_shown_as_one(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    assert view.receive_peer(1.0, on_air(state(9))) is not None
    _, stranger = view.rows(1.0)
    assert (stranger.drone, stranger.member, stranger.agent) == (9, False, "live")
    assert view.garbled == {}


def test_the_vehicle_speaks_when_the_agent_is_silent(fleet, autopilot):
    swarm = fleet()
    swarm.flying[2] = autopilot(2)
    swarm.flying[2].mode = 6
    swarm.flying[2].up_m = 30.0
    view = swarm.tick(1.0)
    assert view.rows(1.0)[1].mode == "GUIDED", "a live agent speaks for its drone"
    del swarm.talking[2]
    for step in range(2, 8):
        swarm.tick(float(step))
    row = view.rows(7.0)[1]
    assert (row.agent, row.vehicle, row.mode) == ("silent", "live", "RTL")
    assert row.above_home_m == pytest.approx(30.0, abs=0.1)


def test_positions_in_another_frame_are_not_used(frame, state, on_air):
    view = FleetView((1,), frame, 0.0)
    view.receive_peer(1.0, on_air(state(1, frame=frame.identity + 1)))
    (row,) = view.rows(1.0)
    assert (row.frame_matches, row.position_ned_m, row.latitude_deg) == (False, None, None)


def test_displays_learn_of_vehicles_from_the_running_station(frame, on_air):
    view = FleetView((1,), frame, 0.0)
    heard = HeardVehicle(4, "RTL", True, True, (1.0, 2.0, -3.0), None, (0.0, 0.0, 0.0), 0.5, 0.5)
    view.receive_peer(1.0, on_air(GroundReport("ground", frame.identity, (), (heard,))))
    row = view.rows(2.0)[-1]
    assert (row.drone, row.vehicle, row.vehicle_age_s, row.mode, row.member) == (4, "live", 1.5, "RTL", False)


def test_answers_are_matched_with_commands(frame, state, on_air):
    view = FleetView((1, 2), frame, 0.0)
    for drone in (1, 2):
        view.receive_peer(1.0, on_air(state(drone)))
    view.receive_peer(1.0, on_air(Command("abc", "operator", 0, CommandName.PAUSE)))
    view.receive_peer(1.2, on_air(CommandOutcome("abc", 1, Result.ACCEPTED)))
    assert view.asked["abc"].waiting_for == {2}


def test_a_vehicle_seen_disarmed_is_nobodys_orphan(fleet, autopilot):
    swarm = fleet((1,))
    swarm.flying[1] = autopilot(1)
    view = swarm.tick(1.0)
    assert view.agents[1].flown
    swarm.flying[1].armed = False
    del swarm.talking[1]
    swarm.tick(2.0)
    assert not view.agents[1].flown


def test_a_restarted_agent_that_does_not_know_its_vehicle_yet_does_not_hide_that_it_flew(
    frame, state, on_air
):
    view = FleetView((1,), frame, 0.0)
    view.receive_peer(1.0, on_air(state(1)))
    fresh = state(1, incarnation=107, armed=False, airborne=False, position_ned_m=None, phase=Phase.DISARMED)
    view.receive_peer(2.0, on_air(fresh))
    assert view.agents[1].flown
    view.receive_peer(2.2, on_air(msgspec.structs.replace(fresh, sequence=2, position_ned_m=(0.0, 0.0, 0.0))))
    assert not view.agents[1].flown


def test_what_is_no_number_is_not_known(frame, state, on_air):
    """A broken drone's word must neither end the station nor stand as "nan" on a display."""
    nan = float("nan")
    view = FleetView((1, 2), frame, 0.0)
    told = state(
        1, battery_fraction=nan, excess_co2_ppm=Scalar(nan, 4.0, 0.1), wind=Wind((nan, 0.0, 0.0), 0.1, 0.2)
    )
    assert view.receive_peer(1.0, on_air(told)) is not None
    assert view.receive_peer(1.0, on_air(state(2, position_ned_m=(nan, 0.0, 0.0)))) is None
    one, two = view.rows(1.0)
    assert (one.battery_fraction, one.excess_co2_ppm, one.wind_mps, one.wind_from_deg) == (None,) * 4
    assert one.phase == "searching"
    assert two.agent == "never"
    assert view.garbled["2"].text == "its position is none"
