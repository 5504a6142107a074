"""Whether a drone goes where it is sent, and what only looks as if it did not."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import pytest

from flightstack.autopilot import AutopilotSession, VehicleReport
from flightstack.config import AutopilotConfig
from flightstack.flight.guard import PositionTarget, Setpoint, VelocityTarget
from flightstack.flight.obedience import Obedience
from mission.geometry.frames import Geodetic, LocalFrame, Vector3

FLOOR_M = 2.0
REPORT: VehicleReport = msgspec.structs.replace(
    AutopilotSession(
        2, LocalFrame(Geodetic(-5.06, 151.3, 500.0)), AutopilotConfig(link="udpin:127.0.0.1:1")
    ).report,
    armed=True,
    airborne=True,
    mode="GUIDED",
    mode_ours=True,
    position_ned_m=(0.0, 0.0, -10.0),
    position_age_s=0.1,
    velocity_ned_mps=(0.0, 0.0, 0.0),
)


class Vehicle:
    """Follows what it is told with a lag of a second, through `turn`."""

    def __init__(self, turn: Callable[[Vector3], Vector3] = lambda velocity: velocity) -> None:
        self.obedience = Obedience(FLOOR_M)
        self.turn = turn
        self.now_s = 50.0
        self.velocity: Vector3 = (0.0, 0.0, 0.0)
        self.height_m = 10.0
        self.told: list[str] = []
        self.facts: dict[str, object] = {}

    def fly(self, seconds: float, asked: Vector3 | None) -> list[str]:
        """What is told in the meantime. None: it stays, by a position target."""
        before = len(self.told)
        for _ in range(round(seconds * 10)):
            self.now_s += 0.1
            wanted = self.turn(asked or (0.0, 0.0, 0.0))
            n, e, d = (v + 0.1 * (w - v) for v, w in zip(self.velocity, wanted, strict=True))
            self.velocity = n, e, d
            setpoint: Setpoint = PositionTarget((0.0, 0.0, -10.0)) if asked is None else VelocityTarget(asked)
            report = msgspec.structs.replace(
                REPORT,
                velocity_ned_mps=self.velocity,
                position_ned_m=(0.0, 0.0, -self.height_m),
                **self.facts,
            )
            notes = self.obedience.step(self.now_s, setpoint, report)
            self.told += [f"{note.severity}: {note.text}" for note in notes]
        return self.told[before:]


def slide(velocity: Vector3) -> Vector3:
    """Nothing of the northward part is flown: a fence lies there."""
    return 0.0, velocity[1], velocity[2]


def test_a_drone_that_slides_along_a_fence_says_so_once_within_seconds_and_when_it_is_over() -> None:
    vehicle = Vehicle(slide)
    (told,) = vehicle.fly(7.0, (4.0, 1.0, 0.0))
    assert told.startswith("warning: does not go where it is sent: asked for ")
    assert "flies 1.0 m/s towards 090 degrees" in told or "flies 0." in told
    assert vehicle.obedience.astray in told
    assert vehicle.fly(30.0, (4.0, 1.0, 0.0)) == []
    assert vehicle.fly(15.0, (-1.0, 3.0, 0.0)) != []
    vehicle.turn = lambda velocity: velocity
    vehicle.fly(15.0, (-1.0, 3.0, 0.0))
    assert vehicle.told[-1] == "info: goes where it is sent again"
    assert vehicle.obedience.astray == ""


def test_one_that_is_pushed_to_and_fro_says_so_too() -> None:
    vehicle = Vehicle(slide)
    for _ in range(4):
        vehicle.fly(3.0, (4.0, 3.0, 0.0))
        vehicle.fly(1.0, (0.0, -3.0, 0.0))
    assert len(vehicle.told) == 1


@pytest.mark.parametrize("drift", [(2.0, 0.0, 0.0), (0.0, 0.0, 1.5)], ids=["wind", "sinks"])
def test_one_that_is_told_to_stay_and_does_not_says_so(drift: Vector3) -> None:
    vehicle = Vehicle(lambda _: drift)
    assert len(vehicle.fly(9.0, None)) == 1
    assert "asked for nothing" in vehicle.told[0]


@pytest.mark.parametrize("asked", [(5.0, 0.0, 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, -2.0), (3.0, 3.0, 1.5)])
def test_one_that_follows_slowly_says_nothing(asked: Vector3) -> None:
    vehicle = Vehicle()
    for _ in range(5):
        vehicle.fly(6.0, asked)
        vehicle.fly(4.0, (-asked[0], -asked[1], -asked[2]))
        vehicle.fly(5.0, None)
    assert vehicle.told == []


def test_an_autopilot_that_climbs_more_slowly_than_it_is_asked_to_is_none_of_it() -> None:
    vehicle = Vehicle(lambda velocity: (velocity[0], velocity[1], max(velocity[2], -1.5)))
    assert vehicle.fly(20.0, (0.0, 0.0, -2.5)) == []


@pytest.mark.parametrize(
    "facts", [{"mode_ours": False}, {"armed": False}, {"position_age_s": 3.0}, {"position_ned_m": None}]
)
def test_nothing_is_said_while_the_vehicle_is_not_ours_or_its_motion_not_known(
    facts: dict[str, object],
) -> None:
    vehicle = Vehicle(slide)
    vehicle.facts = facts
    if "position_ned_m" in facts:
        del vehicle.facts["position_ned_m"]
        vehicle.facts["velocity_ned_mps"] = None
        for _ in range(200):
            vehicle.now_s += 0.1
            report = msgspec.structs.replace(REPORT, position_ned_m=None)
            assert vehicle.obedience.step(vehicle.now_s, VelocityTarget((5.0, 0.0, 0.0)), report) == ()
        return
    assert vehicle.fly(20.0, (5.0, 0.0, 0.0)) == []


@pytest.mark.parametrize(("height_m", "airborne"), [(0.1, True), (30.0, False)], ids=["low", "landed"])
def test_one_that_stands_on_the_ground_and_is_told_to_rise_is_grounded(
    height_m: float, airborne: bool
) -> None:
    vehicle = Vehicle(lambda _: (0.0, 0.0, 0.0))
    vehicle.height_m, vehicle.facts = height_m, {"airborne": airborne}
    vehicle.fly(4.0, (0.0, 0.0, -1.0))
    assert vehicle.obedience.grounded == ""
    vehicle.fly(3.0, (0.0, 0.0, -1.0))
    assert vehicle.obedience.grounded.startswith("stands on the ground, armed")


def test_one_that_hovers_low_or_high_is_not() -> None:
    for height_m, asked in ((0.5, None), (20.0, (0.0, 0.0, -1.0)), (0.5, (0.0, 0.0, 0.2))):
        vehicle = Vehicle(lambda _: (0.0, 0.0, 0.0))
        vehicle.height_m = height_m
        vehicle.fly(20.0, asked)
        assert vehicle.obedience.grounded == ""
        assert math.hypot(*vehicle.velocity) < 0.1
