"""Why a drone leaves the survey by itself, or does not begin one."""

from __future__ import annotations

import pytest

from flightstack.config import LimitsConfig
from flightstack.flight.leaving import Leaving, LeavingFacts
from flightstack.swarm.parting import GOES_HOME_BECAUSE, Part

AMSL_M = 500.0


def leaving(**limits: float) -> Leaving:
    return Leaving(LimitsConfig(**limits), None, AMSL_M)


def battery(fraction: float | None) -> LeavingFacts:
    return LeavingFacts(battery_fraction=fraction)


def ground(heard_s: float | None) -> LeavingFacts:
    return LeavingFacts(battery_fraction=1.0, ground_heard_s=heard_s)


def test_a_sag_of_the_battery_is_no_reason_to_leave_and_a_low_one_is() -> None:
    reasons = leaving()
    assert reasons.step(0.0, battery(0.2)) == ""
    assert reasons.step(2.0, battery(0.3)) == ""
    assert reasons.step(3.0, battery(0.2)) == ""
    assert reasons.step(6.5, battery(0.2)) == "battery at 20%, below 25%"
    assert reasons.step(7.0, battery(None)) == ""


def test_a_silent_ground_station_is_a_reason_only_where_it_is_configured() -> None:
    assert leaving().step(100.0, ground(1.0)) == ""
    reasons = leaving(ground_lost_s=30.0)
    assert reasons.step(100.0, ground(None)) == ""
    assert reasons.step(30.0, ground(1.0)) == ""
    assert reasons.step(32.0, ground(1.0)) == "ground station silent for more than 30 s"


@pytest.mark.parametrize(
    "other",
    [
        LeavingFacts(battery_fraction=0.2, armed=True, part=Part.SMALLER),
        LeavingFacts(battery_fraction=0.2, armed=True, strategy_failure="the strategy failed"),
        LeavingFacts(battery_fraction=0.2, launch_ned_m=(0.0, 0.0, -30.0)),
    ],
    ids=["cut off", "strategy", "launch point"],
)
def test_a_battery_runs_low_also_while_there_is_another_reason(other: LeavingFacts) -> None:
    """Every reason has its own clock, and each clock runs in every tick."""
    reasons = leaving()
    for tick in range(40):
        reason = reasons.step(0.1 * tick, other)
        assert reason
        assert "battery" not in reason
    assert reasons.step(4.0, battery(0.2)) == "battery at 20%, below 25%"


def test_only_a_drone_with_its_motors_on_leaves_because_of_the_swarm_or_its_strategy() -> None:
    reasons = leaving()
    assert reasons.step(0.0, LeavingFacts(part=Part.SMALLER, strategy_failure="broken")) == ""
    assert reasons.step(0.1, LeavingFacts(armed=True, part=Part.LARGER)) == ""
    assert reasons.step(0.2, LeavingFacts(armed=True, part=Part.SMALLER)) == GOES_HOME_BECAUSE
    both = LeavingFacts(armed=True, part=Part.SMALLER, strategy_failure="broken")
    assert reasons.step(0.3, both) == "broken"


def test_where_a_drone_stands_may_be_no_place_to_start_from() -> None:
    reason = leaving().step(0.0, LeavingFacts(launch_ned_m=(0.0, 0.0, -30.0)))
    assert reason.startswith("the launch point is 30 m above the origin")
    assert leaving().step(0.0, LeavingFacts(launch_ned_m=(0.0, 0.0, -1.0))) == ""


def test_far_below_its_limit_a_battery_lets_nobody_wait() -> None:
    reasons = leaving(battery_return_fraction=0.25)
    assert [reasons.in_haste(fraction) for fraction in (0.9, 0.24, 0.19, None)] == [False, False, True, False]
