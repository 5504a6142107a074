"""What a drone believes of others, and what it refuses to believe."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.swarm import topics
from flightstack.swarm.peers import OBSTACLE_MEMORY_S, Belief
from flightstack.swarm.wire import VERSION, DroneState, GroundBeat, Phase, Traffic, TrafficVehicle
from flightstack.transport import Received
from mission.geometry.frames import Geodetic, LocalFrame

FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
STATE = DroneState(
    sender=2,
    incarnation=1,
    sequence=1,
    frame=FRAME.identity,
    phase=Phase.SEARCHING,
    position_ned_m=(1.0, 2.0, -10.0),
    velocity_ned_mps=(0.5, 0.0, 0.0),
    heading_rad=0.0,
    home_ned_m=None,
    armed=True,
    airborne=True,
    mode="GUIDED",
    battery_fraction=0.9,
    co2_ppm=450.0,
    excess_co2_ppm=None,
    wind=None,
    epoch=0,
    slot=1,
    parent=1,
    healing=False,
    tracking_best_ppm=None,
)


def said(state: DroneState, sender: str | None = None) -> Received:
    return Received(topics.STATE, sender or str(state.sender), topics.STATE.codec.encode(state))


@pytest.fixture
def belief() -> Belief:
    return Belief(1, (1, 2, 3), FRAME)


def test_a_peer_is_a_neighbour_with_an_age(belief: Belief) -> None:
    belief.update(10.0, [said(STATE)])
    (neighbour,) = belief.neighbours(10.5)
    assert (neighbour.drone, neighbour.age_s, neighbour.airborne) == (2, 0.5, True)
    assert belief.silence_s(12.0, 2) == 2.0
    assert belief.silence_s(12.0, 3) == float("inf")


def test_a_peer_that_has_lost_its_position_is_where_it_was_then(belief: Belief) -> None:
    """It speaks five times a second and says the same place: a vehicle without GPS drifts with the wind."""
    for tick in range(20):
        state = msgspec.structs.replace(STATE, sequence=tick + 1, position_age_s=0.1 + 0.2 * tick)
        belief.update(10.0 + 0.2 * tick, [said(state)])
    (neighbour,) = belief.neighbours(14.0)
    assert neighbour.age_s == pytest.approx(4.1)
    assert not neighbour.adrift
    assert belief.silence_s(14.0, 2) == pytest.approx(0.2)


def beat(sequence: int) -> Received:
    return Received(topics.GROUND, "ground", topics.GROUND.codec.encode(GroundBeat("ground", sequence)))


def heard_until(belief: Belief, now_s: float, *drones: int, phase: Phase = Phase.SEARCHING) -> None:
    """`drones` are heard for the last time now."""
    for drone in drones:
        state = msgspec.structs.replace(STATE, sender=drone, sequence=int(10 * now_s), phase=phase)
        assert not belief.update(now_s, [said(state)]).problems


def test_a_single_drone_that_falls_silent_has_failed_itself(belief: Belief) -> None:
    assert not belief.cut_off(5.0, 3.0)
    heard_until(belief, 10.0, 2)
    assert not belief.cut_off(14.0, 3.0)


def test_all_who_fall_silent_together_are_a_radio_of_our_own_that_failed(belief: Belief) -> None:
    heard_until(belief, 10.0, 2, 3)
    assert not belief.cut_off(12.9, 3.0)
    assert belief.cut_off(13.1, 3.0)


def test_a_drone_and_the_ground_station_that_fall_silent_together_too(belief: Belief) -> None:
    heard_until(belief, 30.0, 2)
    belief.update(30.0, [beat(1)])
    assert belief.cut_off(33.1, 3.0)
    belief.update(33.2, [beat(2)])
    assert not belief.cut_off(33.3, 3.0)  # our radio works: the drone has died


@pytest.mark.parametrize(
    ("near", "far", "cut_off"),
    [
        ({2}, {3, 4, 5}, True),
        ({2, 3}, {4, 5}, False),
        ({2, 3}, {4, 5, 6}, False),  # equal halves: that of the lowest id goes on
        ({2, 3, 4, 5}, {6}, False),
    ],
)
def test_who_is_in_the_smaller_part_of_the_swarm_is_cut_off(
    near: set[int], far: set[int], cut_off: bool
) -> None:
    belief = Belief(1, (1, 2, 3, 4, 5, 6), LocalFrame(Geodetic(-5.06, 151.3, 500.0)))
    heard_until(belief, 10.0, *far)
    heard_until(belief, 11.0, *near)
    assert belief.cut_off(13.5, 3.0) is cut_off
    heard_until(belief, 40.0, *near)
    assert not belief.cut_off(40.1, 3.0), "long ago: the tree has healed around them"


def test_the_half_without_the_lowest_id_is_cut_off() -> None:
    belief = Belief(4, (1, 2, 3, 4, 5, 6), LocalFrame(Geodetic(-5.06, 151.3, 500.0)))
    heard_until(belief, 10.0, 1, 2, 3)
    heard_until(belief, 13.0, 5, 6)
    assert belief.cut_off(13.5, 3.0)


def test_drones_that_have_left_the_survey_are_not_missed(belief: Belief) -> None:
    heard_until(belief, 10.0, 2, 3, phase=Phase.LANDED)
    assert not belief.cut_off(13.5, 3.0)


def test_while_the_ground_station_is_heard_nobody_is_cut_off(belief: Belief) -> None:
    heard_until(belief, 10.0, 2, 3)
    belief.update(12.0, [beat(1)])
    assert not belief.cut_off(13.5, 3.0)


def test_what_a_drone_says_itself_goes_before_what_is_heard_of_it(belief: Belief) -> None:
    """A ground station may tell of vehicles whose agents we hear as well."""
    heard = TrafficVehicle(2, (9.0, 9.0, -10.0), (0.0, 0.0, 0.0), 0.0)
    traffic = Received(
        topics.TRAFFIC, "ground", topics.TRAFFIC.codec.encode(Traffic("ground", FRAME.identity, (heard,)))
    )
    belief.update(10.0, [said(STATE)])
    belief.update(10.5, [traffic])
    (neighbour,) = belief.neighbours(10.5)
    assert (neighbour.position_ned_m, neighbour.adrift) == (STATE.position_ned_m, False)
    belief.update(11.5, [traffic])
    (neighbour,) = belief.neighbours(11.5)
    assert (neighbour.position_ned_m, neighbour.adrift) == (heard.position_ned_m, True)


def test_an_older_message_does_not_replace_a_newer_one(belief: Belief) -> None:
    belief.update(10.0, [said(msgspec.structs.replace(STATE, sequence=5, battery_fraction=0.5))])
    belief.update(11.0, [said(msgspec.structs.replace(STATE, sequence=4, battery_fraction=0.6))])
    assert belief.peers[2].state.battery_fraction == 0.5
    assert belief.silence_s(11.0, 2) == 1.0


def test_a_restarted_agent_counts_from_one_again(belief: Belief) -> None:
    belief.update(10.0, [said(msgspec.structs.replace(STATE, sequence=500))])
    belief.update(11.0, [said(msgspec.structs.replace(STATE, incarnation=7, sequence=1))])
    assert belief.silence_s(11.0, 2) == 0.0


@pytest.mark.parametrize(
    ("item", "why"),
    [
        (said(msgspec.structs.replace(STATE, frame=1)), "another frame"),
        (said(msgspec.structs.replace(STATE, sender=9)), "not in swarm.members"),
        (said(msgspec.structs.replace(STATE, sender=1)), "another node also says that it is drone 1"),
        (said(STATE, sender="3"), "came under the name 3"),
        (Received(topics.STATE, "2", bytes([VERSION]) + b"garbage"), "not a DroneState"),
        (Received(topics.STATE, "2", b"\x09" + said(STATE).payload[1:]), "message version 9"),
        (Received(topics.STATE, "2", b""), "empty message"),
    ],
)
def test_what_must_not_be_believed_is_told_once(belief: Belief, item: Received, why: str) -> None:
    (problem,) = belief.update(10.0, [item]).problems
    assert why in problem
    assert belief.neighbours(10.0) == ()
    assert belief.update(10.1, [item]).problems == ()


def test_a_silent_drone_stays_an_obstacle_where_it_was(belief: Belief) -> None:
    belief.update(10.0, [said(STATE)])
    (neighbour,) = belief.neighbours(10.0 + OBSTACLE_MEMORY_S - 1.0)
    assert neighbour.position_ned_m == (1.0, 2.0, -10.0)
    assert belief.neighbours(10.0 + OBSTACLE_MEMORY_S + 1.0) == ()


def test_the_ground_station_knows_where_an_orphan_is(belief: Belief) -> None:
    belief.update(10.0, [said(STATE)])
    orphan = TrafficVehicle(2, (40.0, 2.0, -15.0), (5.0, 0.0, 0.0), 0.2)
    traffic = Traffic("ground", FRAME.identity, (orphan,))
    belief.update(20.0, [Received(topics.TRAFFIC, "ground", topics.TRAFFIC.codec.encode(traffic))])
    (neighbour,) = belief.neighbours(20.0)
    assert neighbour.position_ned_m == (40.0, 2.0, -15.0)
    assert neighbour.age_s == pytest.approx(0.2)
    assert neighbour.adrift


def test_the_ground_is_heard(belief: Belief) -> None:
    assert belief.ground_heard_s is None
    beat = GroundBeat("ground", 1)
    belief.update(10.0, [Received(topics.GROUND, "ground", topics.GROUND.codec.encode(beat))])
    assert belief.ground_heard_s == 10.0


def test_an_orphan_that_has_landed_is_no_obstacle(belief: Belief) -> None:
    belief.update(10.0, [said(STATE)])
    down = TrafficVehicle(2, (40.0, 2.0, 0.0), (0.0, 0.0, 0.0), 0.2, airborne=False)
    traffic = Traffic("ground", FRAME.identity, (down,))
    belief.update(20.0, [Received(topics.TRAFFIC, "ground", topics.TRAFFIC.codec.encode(traffic))])
    (neighbour,) = belief.neighbours(20.0)
    assert not neighbour.airborne


def test_a_strategys_word_is_heard_by_the_neighbours_strategies(belief: Belief) -> None:
    belief.update(1.0, [said(msgspec.structs.replace(STATE, word=b"here"))])
    assert [n.word for n in belief.neighbours(1.1)] == [b"here"]
