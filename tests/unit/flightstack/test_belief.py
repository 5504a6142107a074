"""What a drone believes of others, and what it refuses to believe."""

from __future__ import annotations

import msgspec
import pytest

from flightstack import topics
from flightstack.belief import OBSTACLE_MEMORY_S, Belief
from flightstack.transport import Received
from flightstack.wire import VERSION, DroneState, GroundBeat, Phase, Traffic, TrafficVehicle
from mission.frames import Geodetic, LocalFrame

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


def test_all_who_fall_silent_together_are_a_radio_of_our_own_that_failed(belief: Belief) -> None:
    assert belief.cut_off_s(5.0) == 0.0
    belief.update(10.0, [said(STATE), said(msgspec.structs.replace(STATE, sender=3))])
    assert belief.cut_off_s(14.0) == pytest.approx(4.0)
    belief.update(20.0, [said(msgspec.structs.replace(STATE, sequence=2))])
    assert belief.cut_off_s(24.0) == 0.0  # the last of the others has died
    belief.update(30.0, [said(msgspec.structs.replace(STATE, sequence=3)), beat(1)])
    assert belief.cut_off_s(34.0) == pytest.approx(4.0)
    belief.update(35.0, [beat(2)])
    assert belief.cut_off_s(36.5) == 0.0  # our radio works: the drone has died


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
