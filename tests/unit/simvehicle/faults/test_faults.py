"""The table of faults and their schedule, against a drone that writes down what is done to it."""

from __future__ import annotations

import typing

import pytest

from simvehicle.faults.fault_table import FAULTS, FaultKind, FaultSpec, Unheard
from simvehicle.faults.schedule import FaultSchedule


class Noted:
    """A `Victim`."""

    def __init__(self) -> None:
        self.done: list[tuple[str, object]] = []

    def set_plugged(self, instrument: str, plugged: bool) -> None:
        self.done.append((instrument, plugged))

    def set_stuck(self, instrument: str, stuck: bool) -> None:
        self.done.append((f"{instrument} stuck", stuck))

    def set_lying(self, instrument: str, by_ppm: float) -> None:
        self.done.append((f"{instrument} lies", by_ppm))

    def set_gps_error(self, north_m: float) -> None:
        self.done.append(("gps error", north_m))

    def set_heard(self, what: Unheard, heard: bool) -> None:
        self.done.append((what, heard))

    def set_gps(self, working: bool) -> None:
        self.done.append(("gps", working))

    def set_motors(self, working: bool) -> None:
        self.done.append(("motors", working))

    def set_turned_over(self, turned_over: bool) -> None:
        self.done.append(("turned over", turned_over))

    def set_range_finder(self, *, silent: bool, lies_m: float) -> None:
        self.done.append(("range finder", (silent, lies_m)))

    def set_silent(self, silent: bool) -> None:
        self.done.append(("silent", silent))

    def weaken_battery(self) -> None:
        self.done.append(("battery", "weak"))


@pytest.mark.parametrize(
    ("kind", "begins", "ends"),
    [
        ("unplug", ("co2", False), [("co2", True)]),
        ("stuck", ("co2 stuck", True), [("co2 stuck", False)]),
        ("lying", ("co2 lies", 500.0), [("co2 lies", 0.0)]),
        ("gps_jump", ("gps error", 10.0), [("gps error", 0.0)]),
        ("failsafe", ("remote_control", False), [("remote_control", True)]),
        ("range_silent", ("range finder", (True, 0.0)), [("range finder", (False, 0.0))]),
        ("range_lying", ("range finder", (False, 10.0)), [("range finder", (False, 0.0))]),
        ("gps_loss", ("gps", False), [("gps", True)]),
        ("motor", ("motors", False), [("motors", True)]),
        ("tumble", ("turned over", True), []),
        ("silence", ("silent", True), [("silent", False)]),
        ("battery_low", ("battery", "weak"), []),
    ],
)
def test_what_a_fault_does_it_undoes_where_that_can_be(
    kind: FaultKind, begins: tuple[str, object], ends: list[tuple[str, object]]
) -> None:
    victim = Noted()
    fault = FaultSpec(drone=1, at_s=2.0, until_s=5.0, kind=kind, instrument="co2", unheard="remote_control")
    schedule = FaultSchedule([fault])
    schedule.strike(1.99, {1: victim})
    assert not victim.done
    schedule.strike(2.0, {1: victim})
    assert victim.done == [begins]
    schedule.strike(4.99, {1: victim})
    assert victim.done == [begins]
    schedule.strike(5.0, {1: victim})
    schedule.strike(100.0, {1: victim})
    assert victim.done == [begins, *ends]


def test_every_kind_that_a_file_may_name_is_in_the_table() -> None:
    victims = {1: Noted()}
    for kind in typing.get_args(FaultKind):
        fault = FaultSpec(drone=1, at_s=0.0, kind=kind, unheard="ground_link")
        FaultSchedule([fault]).strike(0.0, victims)
    assert len(victims[1].done) == len(FAULTS)


def test_faults_come_in_the_order_of_their_times_to_whom_they_are_for() -> None:
    schedule = FaultSchedule(
        [
            FaultSpec(drone=2, at_s=3.0, kind="silence"),
            FaultSpec(drone=1, at_s=1.0, kind="gps_loss", until_s=3.0),
            FaultSpec(drone=2, at_s=2.0, kind="unplug", instrument="wind"),
        ]
    )
    first, second = Noted(), Noted()
    schedule.strike(10.0, {1: first, 2: second})  # all at once after a pause
    assert first.done == [("gps", False), ("gps", True)]
    assert second.done == [("wind", False), ("silent", True)]


def test_at_one_time_what_begins_comes_before_what_ends() -> None:
    schedule = FaultSchedule(
        [
            FaultSpec(drone=1, at_s=1.0, kind="gps_loss", until_s=4.0),
            FaultSpec(drone=1, at_s=4.0, kind="motor"),
        ]
    )
    victim = Noted()
    schedule.strike(4.0, {1: victim})
    assert victim.done == [("gps", False), ("motors", False), ("gps", True)]
