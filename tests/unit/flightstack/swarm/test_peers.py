"""What a drone knows of the others: ages, obstacles, parts of a swarm come apart."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.swarm.parting import Part
from flightstack.swarm.peers import OBSTACLE_MEMORY_S, Peers
from flightstack.swarm.wire import DroneState, GroundBeat, Phase, Traffic, TrafficVehicle

FRAME = 77
STATE = DroneState(
    sender=2,
    incarnation=1,
    sequence=1,
    frame=FRAME,
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


@pytest.fixture
def peers() -> Peers:
    return Peers(1)


def silence_s(peers: Peers, now_s: float, drone: int) -> float:
    return now_s - peers.facts()[drone].heard_s


def cut_off(peers: Peers, now_s: float) -> bool:
    return peers.part(now_s, 3.0) is Part.SMALLER


def test_a_peer_is_a_neighbour_with_an_age(peers: Peers) -> None:
    peers.hear(10.0, STATE)
    (neighbour,) = peers.neighbours(10.5)
    assert (neighbour.drone, neighbour.age_s, neighbour.airborne) == (2, 0.5, True)
    assert silence_s(peers, 12.0, 2) == 2.0
    assert 3 not in peers.facts()


def test_a_peer_that_has_lost_its_position_is_where_it_was_then(peers: Peers) -> None:
    """It speaks five times a second and says the same place: a vehicle without GPS drifts with the wind."""
    for tick in range(20):
        state = msgspec.structs.replace(STATE, sequence=tick + 1, position_age_s=0.1 + 0.2 * tick)
        peers.hear(10.0 + 0.2 * tick, state)
    (neighbour,) = peers.neighbours(14.0)
    assert neighbour.age_s == pytest.approx(4.1)
    assert not neighbour.adrift
    assert silence_s(peers, 14.0, 2) == pytest.approx(0.2)


@pytest.mark.parametrize("phase", Phase)
def test_a_drone_that_its_agent_does_not_steer_makes_no_way(peers: Peers, phase: Phase) -> None:
    peers.hear(10.0, msgspec.structs.replace(STATE, phase=phase))
    (neighbour,) = peers.neighbours(10.1)
    assert neighbour.adrift is (phase in {Phase.RTL, Phase.PILOT, Phase.CRASHED})


def beat(sequence: int) -> GroundBeat:
    return GroundBeat("ground", sequence)


def heard_until(peers: Peers, now_s: float, *drones: int, phase: Phase = Phase.SEARCHING) -> None:
    """`drones` are heard for the last time now."""
    for drone in drones:
        state = msgspec.structs.replace(STATE, sender=drone, sequence=int(10 * now_s), phase=phase)
        peers.hear(now_s, state)


def test_a_single_drone_that_falls_silent_has_failed_itself(peers: Peers) -> None:
    assert not cut_off(peers, 5.0)
    heard_until(peers, 10.0, 2)
    assert not cut_off(peers, 14.0)


def test_all_who_fall_silent_together_are_a_radio_of_our_own_that_failed(peers: Peers) -> None:
    heard_until(peers, 10.0, 2, 3)
    assert not cut_off(peers, 12.9)
    assert cut_off(peers, 13.1)


def test_a_drone_and_the_ground_station_that_fall_silent_together_too(peers: Peers) -> None:
    heard_until(peers, 30.0, 2)
    peers.hear(30.0, beat(1))
    assert cut_off(peers, 33.1)
    peers.hear(33.2, beat(2))
    assert not cut_off(peers, 33.3)  # our radio works: the drone has died


@pytest.mark.parametrize(
    ("near", "far", "goes_home"),
    [
        ({2}, {3, 4, 5}, True),
        ({2, 3}, {4, 5}, False),
        ({2, 3}, {4, 5, 6}, False),  # equal halves: that of the lowest id goes on
        ({2, 3, 4, 5}, {6}, False),
    ],
)
def test_who_is_in_the_smaller_part_of_the_swarm_is_cut_off(
    near: set[int], far: set[int], goes_home: bool
) -> None:
    peers = Peers(1)
    heard_until(peers, 10.0, *far)
    heard_until(peers, 11.0, *near)
    assert cut_off(peers, 13.5) is goes_home
    heard_until(peers, 40.0, *near)
    assert not cut_off(peers, 40.1), "long ago: the tree has healed around them"


def test_the_half_without_the_lowest_id_is_cut_off() -> None:
    peers = Peers(4)
    heard_until(peers, 10.0, 1, 2, 3)
    heard_until(peers, 13.0, 5, 6)
    assert cut_off(peers, 13.5)


def test_drones_that_have_left_the_survey_are_not_missed(peers: Peers) -> None:
    heard_until(peers, 10.0, 2, 3, phase=Phase.LANDED)
    assert not cut_off(peers, 13.5)


def test_while_the_ground_station_is_heard_nobody_is_cut_off(peers: Peers) -> None:
    heard_until(peers, 10.0, 2, 3)
    peers.hear(12.0, beat(1))
    assert not cut_off(peers, 13.5)


def test_what_a_drone_says_itself_goes_before_what_is_heard_of_it(peers: Peers) -> None:
    """A ground station may tell of vehicles whose agents we hear as well."""
    heard = TrafficVehicle(2, (9.0, 9.0, -10.0), (0.0, 0.0, 0.0), 0.0)
    traffic = Traffic("ground", FRAME, (heard,))
    peers.hear(10.0, STATE)
    peers.hear(10.5, traffic)
    (neighbour,) = peers.neighbours(10.5)
    assert (neighbour.position_ned_m, neighbour.adrift) == (STATE.position_ned_m, False)
    peers.hear(11.5, traffic)
    (neighbour,) = peers.neighbours(11.5)
    assert (neighbour.position_ned_m, neighbour.adrift) == (heard.position_ned_m, True)


def test_an_older_message_does_not_replace_a_newer_one(peers: Peers) -> None:
    peers.hear(10.0, msgspec.structs.replace(STATE, sequence=5, battery_fraction=0.5))
    peers.hear(11.0, msgspec.structs.replace(STATE, sequence=4, battery_fraction=0.6))
    assert peers.peers[2].state.battery_fraction == 0.5
    assert silence_s(peers, 11.0, 2) == 1.0


def test_a_restarted_agent_counts_from_one_again(peers: Peers) -> None:
    peers.hear(10.0, msgspec.structs.replace(STATE, sequence=500))
    peers.hear(11.0, msgspec.structs.replace(STATE, incarnation=7, sequence=1))
    assert silence_s(peers, 11.0, 2) == 0.0


def test_a_silent_drone_stays_an_obstacle_where_it_was(peers: Peers) -> None:
    peers.hear(10.0, STATE)
    (neighbour,) = peers.neighbours(10.0 + OBSTACLE_MEMORY_S - 1.0)
    assert neighbour.position_ned_m == (1.0, 2.0, -10.0)
    assert peers.neighbours(10.0 + OBSTACLE_MEMORY_S + 1.0) == ()


def test_the_ground_station_knows_where_an_orphan_is(peers: Peers) -> None:
    peers.hear(10.0, STATE)
    orphan = TrafficVehicle(2, (40.0, 2.0, -15.0), (5.0, 0.0, 0.0), 0.2)
    traffic = Traffic("ground", FRAME, (orphan,))
    peers.hear(20.0, traffic)
    (neighbour,) = peers.neighbours(20.0)
    assert neighbour.position_ned_m == (40.0, 2.0, -15.0)
    assert neighbour.age_s == pytest.approx(0.2)
    assert neighbour.adrift


def test_the_ground_is_heard(peers: Peers) -> None:
    assert peers.ground_heard_s is None
    peers.hear(10.0, beat(1))
    assert peers.ground_heard_s == 10.0


def test_an_orphan_that_has_landed_is_no_obstacle(peers: Peers) -> None:
    peers.hear(10.0, STATE)
    down = TrafficVehicle(2, (40.0, 2.0, 0.0), (0.0, 0.0, 0.0), 0.2, airborne=False)
    traffic = Traffic("ground", FRAME, (down,))
    peers.hear(20.0, traffic)
    (neighbour,) = peers.neighbours(20.0)
    assert not neighbour.airborne


def test_a_strategys_word_is_heard_by_the_neighbours_strategies(peers: Peers) -> None:
    peers.hear(1.0, msgspec.structs.replace(STATE, word=b"here"))
    assert [n.word for n in peers.neighbours(1.1)] == [b"here"]


def test_a_twin_that_comes_and_goes_does_not_make_its_peers_lose_a_drone(peers: Peers) -> None:
    for turn in range(100):
        now_s = 10.0 + 0.2 * turn
        peers.hear(now_s, msgspec.structs.replace(STATE, sequence=turn + 1, ticks=5000 + turn))
        if 20 <= turn < 60:
            twin = msgspec.structs.replace(
                STATE,
                incarnation=99,
                sequence=turn,
                phase=Phase.DISARMED,
                armed=False,
                airborne=False,
                position_ned_m=None,
            )
            peers.hear(now_s + 0.1, twin)
            assert not peers.speaks(2, 99)
        facts = peers.facts()[2]
        assert (facts.taking_part, facts.heard_s) == (True, now_s)
    (neighbour,) = peers.neighbours(now_s)
    assert (neighbour.drone, neighbour.airborne) == (2, True)


def test_a_restarted_agent_is_heard_by_its_peers(peers: Peers) -> None:
    peers.hear(10.0, msgspec.structs.replace(STATE, sequence=500))
    peers.hear(12.0, msgspec.structs.replace(STATE, incarnation=2, phase=Phase.DISARMED))
    assert not peers.facts()[2].taking_part
    assert (peers.speaks(2, 1), peers.speaks(2, 2)) == (False, True)


def test_a_drone_whose_agent_was_restarted_in_the_air_stays_an_obstacle_until_it_knows_more(
    peers: Peers,
) -> None:
    peers.hear(10.0, STATE)
    ignorant = msgspec.structs.replace(
        STATE,
        incarnation=2,
        phase=Phase.DISARMED,
        position_ned_m=None,
        velocity_ned_mps=None,
        armed=False,
        airborne=False,
    )
    peers.hear(12.0, ignorant)
    assert not peers.facts()[2].taking_part, "but it takes no part in the survey any more"
    (neighbour,) = peers.neighbours(12.5)
    assert (neighbour.airborne, neighbour.position_ned_m, neighbour.age_s) == (True, (1.0, 2.0, -10.0), 2.5)
    knows = msgspec.structs.replace(
        STATE, incarnation=2, sequence=2, phase=Phase.DISARMED, position_ned_m=(4.0, 2.0, -10.0)
    )
    peers.hear(13.0, knows)
    (neighbour,) = peers.neighbours(13.5)
    assert (neighbour.airborne, neighbour.position_ned_m, neighbour.age_s) == (True, (4.0, 2.0, -10.0), 0.5)
    peers.hear(14.0, msgspec.structs.replace(knows, sequence=3, armed=False, airborne=False))
    assert not peers.neighbours(14.0)[0].airborne
