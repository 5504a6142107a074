"""What an operator sees of a survey while it flies."""

from __future__ import annotations

import pytest
from rich.console import Console

from flightstack.swarm import topics
from flightstack.swarm.wire import DroneState, Phase
from simvehicle.fleet.truth import TruthRow
from simvehicle.survey.progress import Lines, LiveTable
from simvehicle.survey.supervisor import Supervisor
from simvehicle.survey.watch import SurveyWatch


@pytest.fixture
def watch() -> SurveyWatch:
    return SurveyWatch([1, 2])


@pytest.fixture
def supervisor(watch: SurveyWatch) -> Supervisor:
    return Supervisor(watch, launcher="launcher", survey="test", time_limit_s=600.0, kills=())


def fly(watch: SurveyWatch, now_s: float) -> None:
    """Drone 1 is heard in flight."""
    state = DroneState(
        sender=1, incarnation=1, sequence=1, frame=7, phase=Phase.SEARCHING, position_ned_m=(30.0, 40.0, -10.0),
        velocity_ned_mps=None, heading_rad=None, home_ned_m=None, armed=True, airborne=True, mode="GUIDED",
        battery_fraction=0.83, co2_ppm=512.0, excess_co2_ppm=None, wind=None, epoch=0, slot=0, parent=None,
        healing=False, tracking_best_ppm=None, notes=("co2: zeroing",),
    )  # fmt: skip
    watch.hear(now_s, topics.STATE, topics.STATE.codec.encode(state))
    watch.see(now_s, [TruthRow(40.0, 1, (30.0, 40.0, -10.0), True, True, "GUIDED", 512.0, 0.83)])


def test_lines_without_a_terminal(
    watch: SurveyWatch, supervisor: Supervisor, capsys: pytest.CaptureFixture[str]
) -> None:
    with Lines(watch, supervisor, 5.0) as lines:
        lines.show(0.0, wall_s=0.0, note="")
        fly(watch, 100.0)
        lines.show(100.0, wall_s=9.9, note="")  # not yet: a line every ten seconds
        lines.show(100.0, wall_s=10.0, note="landing everybody")
    assert capsys.readouterr().err.splitlines() == [
        "starting up | 0 s elapsed, at most 5x | 2 of 2 agents run | nobody heard yet",
        "starting up | 60 s simulated | 10 s elapsed, at most 5x | 2 of 2 agents run | best 512 ppm, 0 m away"
        " | landing everybody | 1:searching",
    ]


def test_the_table_on_a_terminal(watch: SurveyWatch, supervisor: Supervisor) -> None:
    fly(watch, 100.0)
    console = Console(width=100)
    with console.capture() as shown:
        console.print(LiveTable(watch, supervisor, 5.0).table(100.0))
    _, first, second = shown.get().splitlines()
    assert first.split() == ["1", "searching", "GUIDED", "0", "10.0", "83%", "co2:", "zeroing"]
    assert second.split() == ["2", "not", "heard", "yet"]


def test_a_drone_that_is_no_longer_heard_is_silent_and_a_killed_one_dead(
    watch: SurveyWatch, supervisor: Supervisor
) -> None:
    fly(watch, 100.0)
    table = LiveTable(watch, supervisor, 5.0)
    assert table.phase(1, watch.states[1], 104.0) == "searching"
    assert table.phase(1, watch.states[1], 106.0) == "silent"
    supervisor.alive.discard(1)
    assert table.phase(1, watch.states[1], 106.0) == "dead"
