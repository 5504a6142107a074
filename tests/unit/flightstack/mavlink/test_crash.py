"""What tells a crash from everything that only looks like one."""

from __future__ import annotations

import math

import pytest

from flightstack.mavlink.crash import CrashWatch

G = 9.8


class Faller:
    """One vehicle over the ground, its motion told `rate_hz` times a second."""

    def __init__(self, height_m: float = 20.0, rate_hz: float = 10.0) -> None:
        self.watch = CrashWatch()
        self.now_s = 100.0
        self.height_m = height_m
        self.down_mps = 0.0
        self.step_s = 1.0 / rate_hz
        self.landing = False
        self.armed = True

    def tell(self, down_mps: float, north_mps: float = 0.0) -> None:
        self.now_s += self.step_s
        self.down_mps = down_mps
        self.height_m = max(self.height_m - down_mps * self.step_s, 0.0)
        self.watch.moved(
            self.now_s,
            (north_mps, 0.0, down_mps),
            300.0 + self.height_m,
            self.height_m,
            landing=self.landing,
            armed=self.armed,
        )

    def fall(self) -> float:
        """Down to the ground; returns the speed there."""
        while self.height_m > 0.0:
            self.tell(self.down_mps + G * self.step_s)
        return self.down_mps

    def rest(self, seconds: float) -> None:
        for _ in range(round(seconds / self.step_s)):
            self.tell(0.0)


@pytest.mark.parametrize("rate_hz", [10.0, 4.0])
@pytest.mark.parametrize("height_m", [3.0, 5.0, 60.0])
def test_a_fall_that_ends_on_the_ground_is_a_crash(rate_hz: float, height_m: float) -> None:
    vehicle = Faller(height_m, rate_hz)
    speed_mps = vehicle.fall()
    assert vehicle.watch.reason == "", "it may still be caught"
    vehicle.rest(2.5)
    assert vehicle.watch.reason == f"fell and hit the ground at {speed_mps:.1f} m/s"


def test_an_impact_that_the_estimator_takes_a_second_to_believe_is_one_too() -> None:
    vehicle = Faller(10.0)
    vehicle.fall()
    for part in (0.8, 0.7, 0.6, 0.5, 0.45, 0.42, 0.3, 0.2, 0.1, 0.05, 0.0):
        vehicle.tell(10.0 * part)
    vehicle.rest(4.0)
    assert vehicle.watch.reason.startswith("fell")


def test_what_the_autopilot_said_on_the_way_down_is_told_with_it() -> None:
    vehicle = Faller()
    vehicle.watch.told("Potential Thrust Loss (2)")
    assert vehicle.watch.reason == ""
    vehicle.fall()
    vehicle.rest(3.0)
    assert vehicle.watch.reason.endswith('after "Potential Thrust Loss (2)"')


@pytest.mark.parametrize("descent_mps", [1.5, 2.5, 3.9])
def test_a_commanded_descent_and_its_touchdown_is_none(descent_mps: float) -> None:
    vehicle = Faller(40.0)
    while vehicle.height_m > 0.0:
        vehicle.tell(descent_mps if vehicle.height_m > 2.0 else min(descent_mps, 0.7))
    vehicle.rest(10.0)
    assert vehicle.watch.reason == ""


def test_a_quick_return_that_brakes_and_lands_is_none() -> None:
    """Six metres a second down, as PX4 may be told to, and slowly at the end."""
    vehicle = Faller(80.0)
    vehicle.landing = True
    while vehicle.height_m > 12.0:
        vehicle.tell(6.0)
    while vehicle.down_mps > 0.7:
        vehicle.tell(vehicle.down_mps - 0.4)
    while vehicle.height_m > 0.0:
        vehicle.tell(0.7)
    vehicle.rest(10.0)
    assert vehicle.watch.reason == ""


def test_a_fall_that_is_caught_is_none() -> None:
    vehicle = Faller(60.0)
    for _ in range(10):
        vehicle.tell(vehicle.down_mps + 0.8)
    while vehicle.down_mps > 0.0:
        vehicle.tell(max(vehicle.down_mps - 0.5, 0.0))
    vehicle.rest(20.0)
    assert vehicle.watch.reason == ""


def test_a_fall_of_which_the_end_was_not_heard_is_one_low_over_home_and_none_above() -> None:
    for height_m, crashed in ((0.4, True), (12.0, False)):
        vehicle = Faller(60.0)
        for _ in range(8):
            vehicle.tell(vehicle.down_mps + G * vehicle.step_s)
        vehicle.height_m = height_m
        vehicle.now_s += 2.0
        vehicle.rest(6.0)
        assert bool(vehicle.watch.reason) is crashed


def lean(watch: CrashWatch, roll_deg: float, pitch_deg: float, seconds: float) -> None:
    for tick in range(round(seconds * 10)):
        watch.leaned(200.0 + 0.1 * tick, math.radians(roll_deg), math.radians(pitch_deg))


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(180.0, 0.0), (0.0, 175.0), (-90.0, 0.0), (60.0, 80.0)])
def test_a_vehicle_that_lies_on_its_side_or_back_has_crashed(roll_deg: float, pitch_deg: float) -> None:
    watch = CrashWatch()
    lean(watch, roll_deg, pitch_deg, 1.5)
    assert watch.reason == "", "it may be a flip"
    lean(watch, roll_deg, pitch_deg, 2.5)
    assert watch.reason.startswith("lies turned over by")


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, 0.0), (45.0, 0.0), (40.0, 40.0), (0.0, -60.0)])
def test_leaning_is_flying(roll_deg: float, pitch_deg: float) -> None:
    watch = CrashWatch()
    lean(watch, roll_deg, pitch_deg, 30.0)
    assert watch.reason == ""


@pytest.mark.parametrize(
    "text", ["Crash: Disarming: AngErr=47>30, Accel=0.2<3.0", "Crash: Disarming", "Crash detected"]
)
def test_the_autopilots_own_word_counts_at_once(text: str) -> None:
    watch = CrashWatch()
    watch.told(text)
    assert watch.reason == f'the autopilot says "{text}"'


@pytest.mark.parametrize(
    "text",
    [
        "Crash dumps present on SD card",
        "PreArm: Crash",
        "Potential Thrust Loss (1)",
        "Motors: crash check off",
    ],
)
def test_other_texts_do_not(text: str) -> None:
    watch = CrashWatch()
    watch.told(text)
    assert watch.reason == ""


@pytest.mark.parametrize("down_mps", [5.0, 60.0, 300.0])
def test_one_wrong_velocity_between_right_ones_is_no_fall(down_mps: float) -> None:
    vehicle = Faller(20.0)
    vehicle.rest(1.0)
    height_m = vehicle.height_m
    vehicle.tell(down_mps)
    vehicle.height_m = height_m
    vehicle.rest(6.0)
    assert vehicle.watch.reason == ""


def test_a_velocity_that_the_estimator_makes_up_and_takes_back_is_no_fall() -> None:
    """A reset of its height: for a second it sinks at 5 m/s, from one moment to the next and back. It hovers."""
    vehicle = Faller(40.0)
    vehicle.rest(2.0)
    for _ in range(10):
        vehicle.tell(5.0)
    vehicle.rest(20.0)
    assert vehicle.watch.reason == ""


def wreck(how: str = "") -> Faller:
    """What is taken for one, high up."""
    vehicle = Faller(60.0)
    vehicle.rest(1.0)
    vehicle.watch.reason = how or "fell and hit the ground at 5.0 m/s"
    return vehicle


@pytest.mark.parametrize(
    ("down_mps", "north_mps", "seconds"), [(0.5, 0.0, 4.5), (-1.0, 0.0, 3.2), (0.0, 4.0, 3.2)]
)
def test_what_lands_climbs_or_travels_was_no_wreck(down_mps: float, north_mps: float, seconds: float) -> None:
    vehicle = wreck()
    for _ in range(round(seconds * 10)):
        vehicle.tell(down_mps, north_mps)
    assert vehicle.watch.reason == ""
    for _ in range(100):
        vehicle.tell(down_mps, north_mps)
    vehicle.rest(10.0)
    assert vehicle.watch.reason == "", "and it has not crashed since"


@pytest.mark.parametrize(("down_mps", "north_mps"), [(0.05, 0.0), (-0.15, 0.0), (0.0, 0.8)])
def test_an_estimate_that_drifts_is_no_flight(down_mps: float, north_mps: float) -> None:
    vehicle = wreck()
    for _ in range(1800):
        vehicle.tell(down_mps, north_mps)
    assert vehicle.watch.reason


def test_a_wreck_that_shakes_does_not_fly() -> None:
    vehicle = wreck()
    for tick in range(1000):
        vehicle.tell(1.5 * math.sin(0.7 * tick))
    assert vehicle.watch.reason


@pytest.mark.parametrize("why", ["disarmed", "turned over", "the autopilot said so"])
def test_what_cannot_fly_stays_a_wreck_whatever_its_estimate_does(why: str) -> None:
    vehicle = wreck()
    if why == "disarmed":
        vehicle.armed = False
    elif why == "turned over":
        vehicle.watch.leaned(vehicle.now_s, math.pi, 0.0)
    else:
        vehicle.watch.told("Crash: Disarming")
    for _ in range(100):
        vehicle.tell(1.0, 5.0)
    assert vehicle.watch.reason


def test_a_fall_that_upsets_the_estimator_at_its_beginning_is_one_all_the_same() -> None:
    vehicle = Faller(30.0)
    vehicle.rest(2.0)
    vehicle.tell(5.0)
    speed_mps = vehicle.fall()
    vehicle.rest(3.0)
    assert vehicle.watch.reason == f"fell and hit the ground at {speed_mps:.1f} m/s"
