"""Drones that hear nothing of each other from one moment on, as points that fly: all come home, and keep apart.

What each knows of the others is what was known at that moment: where they were, where their homes are. Autopilots
follow their parameters and make way for nobody; one at most comes home by itself at a time (docs/decisions/0015).
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterator

import msgspec
import pytest

from flightstack.autopilot import AutopilotSession
from flightstack.config import AutopilotConfig, FormationConfig, LimitsConfig
from flightstack.flight.guard import Guard, PositionTarget
from flightstack.flight.guidance import horizontal_m
from flightstack.flight.homecoming import Homecoming
from flightstack.flight.layers import Layers, ceiling_needed_m, layers_of
from mission.geometry.formation import make_layout
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.strategies.contract import GoTo, Hold, Intent, Neighbour

STEP_S = 0.2
FLIGHT_S = 240.0
FORMATION = FormationConfig()
REPORT = AutopilotSession(
    1, LocalFrame(Geodetic(-5.06, 151.3, 500.0)), AutopilotConfig(link="udpin:127.0.0.1:1")
).report
STILL: Vector3 = (0.0, 0.0, 0.0)
ADRIFT_AFTER_S = 5.0
GOES_WITHIN_S = 10.0
"""So late after the silence began a drone notices it, or its vehicle is sent home by the ground station."""

Pilot = Callable[[float, "Flyer"], Vector3]
"""Time and flyer to the velocity that is asked for, NED m/s."""


class Flyer:
    """A vehicle that follows velocities within its acceleration, as in the tests of the guard."""

    def __init__(self, drone: int, position: Vector3, home: Vector3, pilot: Pilot) -> None:
        self.drone, self.position, self.home, self.pilot = drone, position, home, pilot
        self.velocity: Vector3 = STILL

    @property
    def landed(self) -> bool:
        return self.position[2] > -0.3

    def step(self, now_s: float) -> None:
        if self.landed:
            return
        n, e, d = (w - v for w, v in zip(self.pilot(now_s, self), self.velocity, strict=True))
        scale = min(1.0, 2.5 * STEP_S / (math.hypot(n, e) or 1.0))
        d = min(max(d, -2.5 * STEP_S), 2.5 * STEP_S)
        vn, ve, vd = self.velocity
        self.velocity = (vn + n * scale, ve + e * scale, vd + d)
        n, e, d = (p + v * STEP_S for p, v in zip(self.position, self.velocity, strict=True))
        self.position = (n, e, d)


class Steered:
    """What an agent asks for: the guard's word on an intent, with the others as they were when they fell silent."""

    def __init__(self, limits: LimitsConfig, others: tuple[Neighbour, ...]) -> None:
        self._guard, self._others = Guard(limits, None), others
        self.heard: list[Flyer] = []
        """Those that it hears all the same."""

    def velocity(self, now_s: float, flyer: Flyer, intent: Intent) -> Vector3:
        guarded = self._guard.apply(
            intent, flyer.position, flyer.velocity, 0.1, self.silent(now_s), flyer.home
        )
        if isinstance(guarded.setpoint, PositionTarget):
            n, e, d = (t - p for t, p in zip(guarded.setpoint.position_ned_m, flyer.position, strict=True))
            return n, e, d
        return guarded.setpoint.velocity_ned_mps

    def silent(self, now_s: float) -> tuple[Neighbour, ...]:
        heard = {
            one.drone: Neighbour(one.drone, one.position, one.velocity, 0.2, True, home_ned_m=one.home)
            for one in self.heard
        }
        return tuple(
            heard.get(other.drone)
            or msgspec.structs.replace(other, age_s=now_s, adrift=now_s > ADRIFT_AFTER_S)
            for other in self._others
        )


def down(flyer: Flyer) -> Vector3:
    """An autopilot's landing over home."""
    return 0.8 * (flyer.home[0] - flyer.position[0]), 0.8 * (flyer.home[1] - flyer.position[1]), 1.0


def returning(at_s: float, limits: LimitsConfig, layers: Layers, others: tuple[Neighbour, ...]) -> Pilot:
    steered, homecoming = Steered(limits, others), Homecoming(limits, None, -layers.agent_above_home_m)
    lands = [False]

    def pilot(now_s: float, flyer: Flyer) -> Vector3:
        if now_s < at_s:
            return steered.velocity(now_s, flyer, Hold())
        report = msgspec.structs.replace(REPORT, position_ned_m=flyer.position, home_ned_m=flyer.home)
        homecoming.step(now_s, report, steered.silent(now_s), returning=True)
        assert not homecoming.stuck, f"drone {flyer.drone} at {flyer.position}"
        lands[0] |= homecoming.over_home
        if lands[0]:
            return down(flyer)
        return steered.velocity(now_s, flyer, homecoming.intent(flyer.position))

    return pilot


def searching(
    dice: random.Random,
    limits: LimitsConfig,
    slot: Vector3,
    others: tuple[Neighbour, ...],
    heard: list[Flyer],
) -> Pilot:
    """It goes on with the search among those that do too, here and there and over the launch line."""
    steered = Steered(limits, others)
    steered.heard = heard
    target = [slot]

    def pilot(now_s: float, flyer: Flyer) -> Vector3:
        if dice.random() < 0.05 * STEP_S:
            target[0] = (slot[0] + dice.uniform(-60.0, 60.0), slot[1] + dice.uniform(-60.0, 60.0), slot[2])
        return steered.velocity(now_s, flyer, GoTo(target[0]))

    return pilot


def taking_off(limits: LimitsConfig, layers: Layers, others: tuple[Neighbour, ...]) -> Pilot:
    """An autopilot's take-off to the layer; then it hears that it is alone, and comes down again."""
    home_again = returning(0.0, limits, layers, others)
    up = [False]

    def pilot(now_s: float, flyer: Flyer) -> Vector3:
        up[0] |= flyer.position[2] < 0.5 - layers.agent_above_home_m
        return home_again(now_s, flyer) if up[0] else (0.0, 0.0, -2.0)

    return pilot


def autopilot(at_s: float, layers: Layers, climb_mps: float, waits_s: float) -> Pilot:
    """Straight up, straight over, straight down, whoever is there."""
    over_s: list[float] = []

    def pilot(now_s: float, flyer: Flyer) -> Vector3:
        n, e = flyer.home[0] - flyer.position[0], flyer.home[1] - flyer.position[1]
        away_m, rise_m = math.hypot(n, e), flyer.position[2] + layers.autopilot_above_home_m
        if now_s < at_s:
            return STILL
        if not over_s and away_m > 0.5 and rise_m > 0.3:
            return 0.0, 0.0, -min(climb_mps, max(0.8 * rise_m, 0.1))
        if not over_s and away_m > 0.5:
            speed_mps = min(5.0, 0.8 * away_m)
            return n / away_m * speed_mps, e / away_m * speed_mps, -0.8 * rise_m
        over_s.append(now_s)
        return 0.8 * n, 0.8 * e, 1.5 if now_s - over_s[0] > waits_s else 0.0

    return pilot


def places(dice: random.Random, count: int, least_m: float) -> list[Vector3]:
    """Homes in a line of any bearing, or anywhere on a meadow with room to pass between two."""
    if dice.random() < 0.5:
        bearing, apart_m = dice.uniform(0.0, math.tau), dice.uniform(least_m, 10.0)
        along = [(k - (count - 1) / 2.0) * apart_m for k in range(count)]
        return [(a * math.cos(bearing), a * math.sin(bearing), 0.0) for a in along]
    found: list[Vector3] = []
    while len(found) < count:
        place = (dice.uniform(-40.0, 40.0), dice.uniform(-40.0, 40.0), 0.0)
        if all(math.dist(place, other) >= 2.0 * least_m for other in found):
            found.append(place)
    return found


def swarm(seed: int) -> tuple[list[Flyer], LimitsConfig, list[str]]:
    dice = random.Random(seed)
    count = dice.randint(2, 7)
    members = list(range(1, count + 1))
    limits = LimitsConfig(ceiling_above_home_m=ceiling_needed_m(count, FORMATION))
    layout = make_layout(FORMATION.layout, FORMATION.spacing_m)
    homes = places(dice, count, limits.separation_m + 2.0)
    middle = dice.uniform(-60.0, 60.0), dice.uniform(-60.0, 60.0)
    roles = [dice.choice(("returning", "returning", "searching", "taking off", "landing")) for _ in members]
    if dice.random() < 0.7:
        roles[dice.randrange(count)] = "autopilot"
    starts: list[Vector3] = []
    own = [layers_of(drone, members, FORMATION, limits) for drone in members]
    for index, role in enumerate(roles):
        n, e = layout.offset_m(index)
        n, e, d = middle[0] + n, middle[1] + e, -FORMATION.above_home_m
        if role in ("taking off", "landing"):
            n, e, d = homes[index][0], homes[index][1], -dice.uniform(1.0, own[index].agent_above_home_m)
        starts.append((n, e, d))
    heard = [
        Neighbour(drone, start, STILL, 0.0, True, home_ned_m=home)
        for drone, start, home in zip(members, starts, homes, strict=True)
    ]
    flyers: list[Flyer] = []
    searchers: list[Flyer] = []
    for index, role in enumerate(roles):
        others = tuple(heard[:index] + heard[index + 1 :])
        at_s = dice.uniform(0.0, GOES_WITHIN_S)
        match role:
            case "returning":
                pilot = returning(at_s, limits, own[index], others)
            case "searching":
                pilot = searching(dice, limits, starts[index], others, searchers)
            case "taking off":
                pilot = taking_off(limits, own[index], others)
            case "landing":
                pilot = lambda _now_s, flyer: down(flyer)  # noqa: E731
            case _:  # ArduPilot, PX4
                pilot = autopilot(at_s, own[index], *dice.choice(((2.5, 0.0), (3.0, 0.5))))
        flyers.append(Flyer(members[index], starts[index], homes[index], pilot))
        if role == "searching":
            searchers.append(flyers[-1])
    return flyers, limits, roles


def near_misses(seed: int) -> Iterator[str]:
    flyers, limits, roles = swarm(seed)
    in_formation = [one for one in flyers if roles[one.drone - 1] not in ("taking off", "landing")]
    over_home = [one for one in flyers if one not in in_formation]
    if any(horizontal_m(a.position, b.position) < 6.0 for a in in_formation for b in over_home):
        return  # while they hear each other nobody stands over one that takes off or lands
    for tick in range(int(FLIGHT_S / STEP_S)):
        for flyer in flyers:
            flyer.step(tick * STEP_S)
        for a, b in itertools.combinations([one for one in flyers if not one.landed], 2):
            apart_m = math.dist(a.position, b.position)
            if apart_m < limits.separation_m:
                yield (
                    f"seed {seed}, {tick * STEP_S:.1f} s: {roles[a.drone - 1]} {a.drone} and {roles[b.drone - 1]} "
                    f"{b.drone}: {apart_m:.1f} m"
                )
                return
    for flyer, role in zip(flyers, roles, strict=True):
        if role != "searching" and not flyer.landed:
            yield f"seed {seed}: {role} {flyer.drone} is not down, but at {flyer.position}"


@pytest.mark.parametrize("seed", range(12))
def test_whoever_comes_home_unheard_keeps_apart(seed: int) -> None:
    assert list(near_misses(seed)) == []
