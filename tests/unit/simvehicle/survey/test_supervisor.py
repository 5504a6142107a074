"""The supervisor of a survey, told what it hears and sees, without a process or a clock."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import pytest

from flightstack.swarm import topics, wire
from flightstack.swarm.wire import CommandName, DroneState, OrderState, Phase, Result, TableState
from mission.estimation.estimates import Scalar
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import configured
from simvehicle.fleet.truth import TruthRow
from simvehicle.survey.agent_faults import Freeze, Kill
from simvehicle.survey.late_starts import START_TRIES
from simvehicle.survey.processes import Ended
from simvehicle.survey.supervisor import (
    Action,
    Finish,
    FreezeAgent,
    Give,
    KillAgent,
    Supervisor,
    SurveyOutcome,
    WakeAgent,
)
from simvehicle.survey.watch import SurveyWatch

SPEEDUP = 5.0


def state(drone: int, phase: Phase, mode: str = "GUIDED", *, airborne: bool = False) -> DroneState:
    return DroneState(
        sender=drone, incarnation=1, sequence=1, frame=7, phase=phase, position_ned_m=(0.0, 0.0, -10.0),
        velocity_ned_mps=None, heading_rad=None, home_ned_m=None, armed=airborne, airborne=airborne, mode=mode,
        battery_fraction=None, co2_ppm=None, excess_co2_ppm=None, wind=None, epoch=0, slot=drone - 1, parent=None,
        healing=False, tracking_best_ppm=None,
    )  # fmt: skip


class SupervisedSwarm:
    """Three drones as the supervisor meets them; the test says what they do."""

    def __init__(self, *kills: Kill, time_limit_s: float = 600.0, freezes: tuple[Freeze, ...] = ()) -> None:
        self.watch = SurveyWatch([1, 2, 3])
        self.supervisor = Supervisor(
            self.watch,
            launcher="launcher",
            survey="test",
            time_limit_s=time_limit_s,
            kills=kills,
            freezes=freezes,
        )
        self.now_s = 1000.0
        self.given: list[wire.Command] = []
        self.killed: list[int] = []
        self.frozen: list[tuple[int, bool]] = []
        """(drone, whether it was frozen or woken), in order."""
        self.over: Finish | None = None
        self.answering = True
        self.refusing = ""

    def say(
        self, phase: Phase, drones: Iterable[int] = (1, 2, 3), mode: str = "GUIDED", *, airborne: bool = False
    ) -> None:
        for drone in drones:
            payload = topics.STATE.codec.encode(state(drone, phase, mode, airborne=airborne))
            self.watch.hear(self.now_s, topics.STATE, payload)

    def order(self, stage: Stage, sequence: int = 5) -> None:
        order = Order(
            sequence, stage, (0.0, 0.0, -10.0), 0.0, (1.0, 2.0, -10.0) if stage is Stage.FOUND else None
        )
        claims = tuple(configured((1, 2, 3)).items())
        table = TableState(1, 1, 1, 7, "survey", claims, (), ())
        self.watch.hear(self.now_s, topics.TABLE, topics.TABLE.codec.encode(table))
        ordered = OrderState(1, 1, 1, 7, "survey", order, claims[0][1])
        self.watch.hear(self.now_s, topics.ORDER, topics.ORDER.codec.encode(ordered))

    def world(self, airborne: Iterable[int] = (), drones: Iterable[int] = (1, 2, 3)) -> None:
        flying = set(airborne)
        self.watch.see(
            self.now_s,
            [
                TruthRow(self.now_s, d, (0.0, 0.0, 0.0), d in flying, d in flying, "X", 420.0, 1.0)
                for d in drones
            ],
        )

    def run(self, seconds: float, *, ended: Iterable[Ended] = (), interrupted: bool = False) -> None:
        """Let simulated seconds pass, answering commands as the drones would."""
        deaths = list(ended)
        for _ in range(round(seconds / 0.5)):
            self.now_s += 0.5
            for action in self.supervisor.step(
                self.now_s, self.now_s / SPEEDUP, deaths, interrupted=interrupted
            ):
                self._do(action)
            deaths = []
            if self.over:
                return

    def _do(self, action: Action) -> None:
        match action:
            case Give(command):
                self.given.append(command)
                if self.answering:
                    result = Result.REFUSED if self.refusing else Result.ACCEPTED
                    for drone in (1, 2, 3):
                        outcome = wire.CommandOutcome(command.identity, drone, result, self.refusing)
                        self.watch.hear(self.now_s, topics.OUTCOME, topics.OUTCOME.codec.encode(outcome))
            case KillAgent(drone):
                self.killed.append(drone)
            case FreezeAgent(drone):
                self.frozen.append((drone, True))
            case WakeAgent(drone):
                self.frozen.append((drone, False))
            case Finish():
                self.over = action

    def take_off(self) -> None:
        self.say(Phase.DISARMED)
        self.run(3.0)
        self.say(Phase.SEARCHING, airborne=True)
        self.world(airborne=(1, 2, 3))
        self.run(10.0)

    @property
    def outcome(self) -> SurveyOutcome | None:
        return self.over.outcome if self.over else None


def test_it_starts_when_every_autopilot_answers_and_no_sooner() -> None:
    swarm = SupervisedSwarm()
    swarm.say(Phase.DISARMED, drones=(1, 2))
    swarm.say(Phase.DISARMED, drones=(3,), mode="")
    swarm.run(20.0)
    assert swarm.given == []
    swarm.say(Phase.DISARMED)
    swarm.run(5.0)
    assert [c.name for c in swarm.given] == [CommandName.START]


def test_the_start_is_one_command_however_often_it_is_sent() -> None:
    swarm = SupervisedSwarm()
    swarm.answering = False
    swarm.say(Phase.DISARMED)
    swarm.run(20.0)
    assert len(swarm.given) > 3
    assert len({c.identity for c in swarm.given}) == 1


def test_a_refused_start_is_taken_back_and_tried_again() -> None:
    swarm = SupervisedSwarm()
    swarm.refusing = "battery low"
    swarm.say(Phase.DISARMED)
    swarm.run(200.0)
    names = [c.name for c in swarm.given]
    assert names.count(CommandName.START) == 3
    assert CommandName.ABORT in names
    assert swarm.outcome is SurveyOutcome.FAILED
    assert swarm.over is not None
    assert "battery low" in swarm.over.reason


def test_the_source_is_found_and_all_come_home() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.order(Stage.FOUND)
    swarm.say(Phase.RETURNING, airborne=True)
    swarm.run(60.0)
    assert swarm.over is None, "they are still in the air"
    swarm.say(Phase.LANDED)
    swarm.world()
    swarm.run(5.0)
    assert swarm.outcome is SurveyOutcome.SOURCE_FOUND


def test_who_does_not_come_home_is_not_waited_for_for_ever() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.order(Stage.FOUND)
    swarm.run(1000.0)
    assert swarm.outcome is SurveyOutcome.SOURCE_FOUND


def test_an_exhausted_search() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.order(Stage.GIVE_UP)
    swarm.run(1.0)
    swarm.world()
    swarm.run(5.0)
    assert swarm.outcome is SurveyOutcome.GAVE_UP


def test_the_time_limit_calls_everybody_home() -> None:
    swarm = SupervisedSwarm(time_limit_s=50.0)
    swarm.take_off()
    swarm.run(60.0)
    assert swarm.given[-1].name is CommandName.ABORT
    swarm.world()
    swarm.run(5.0)
    assert swarm.outcome is SurveyOutcome.TIME_LIMIT


def test_an_interrupt_lands_everybody() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.run(2.0, interrupted=True)
    assert swarm.given[-1].name is CommandName.LAND
    assert swarm.over is None
    swarm.world()
    swarm.run(5.0, interrupted=True)
    assert swarm.outcome is SurveyOutcome.ABORTED


def test_an_interrupt_before_anything_flew() -> None:
    swarm = SupervisedSwarm()
    swarm.run(3.0, interrupted=True)
    assert swarm.outcome is SurveyOutcome.ABORTED


def test_a_kill_on_time_and_the_orphan_is_waited_for() -> None:
    swarm = SupervisedSwarm(Kill(3, 30.0))
    swarm.take_off()
    swarm.run(15.0)
    assert swarm.killed == []
    swarm.run(10.0)
    assert swarm.killed == [3]
    assert swarm.supervisor.alive == {1, 2}
    assert swarm.supervisor.kills[3] == pytest.approx(30.0, abs=1.0)
    swarm.order(Stage.FOUND)
    swarm.run(1.0)
    swarm.world(airborne=(3,))
    swarm.run(60.0)
    assert swarm.over is None
    swarm.world()
    swarm.run(5.0)
    assert swarm.outcome is SurveyOutcome.SOURCE_FOUND


def test_a_frozen_agent_goes_on_when_its_time_comes() -> None:
    swarm = SupervisedSwarm(freezes=(Freeze(3, 20.0, 40.0),))
    swarm.take_off()
    swarm.run(5.0)
    assert swarm.frozen == []
    swarm.run(10.0)
    assert swarm.frozen == [(3, True)]
    assert (swarm.supervisor.alive, swarm.supervisor.awake) == ({1, 2, 3}, {1, 2})
    swarm.run(20.0)
    assert swarm.frozen == [(3, True), (3, False)]
    assert swarm.supervisor.awake == {1, 2, 3}
    (freeze,) = swarm.supervisor.freezes
    assert freeze.drone == 3
    assert freeze.at_s == pytest.approx(20.0, abs=1.0)
    assert freeze.until_s == pytest.approx(40.0, abs=1.0)


def test_what_an_agent_slept_through_is_no_missed_deadline() -> None:
    swarm = SupervisedSwarm(freezes=(Freeze(3, 20.0, 40.0),))
    swarm.take_off()
    swarm.run(35.0)

    def say(drone: int, ticks: int, late_ticks: int) -> None:
        said = msgspec.structs.replace(state(drone, Phase.SEARCHING), ticks=ticks, late_ticks=late_ticks)
        swarm.watch.hear(swarm.now_s, topics.STATE, topics.STATE.codec.encode(said))

    say(2, 400, 3)
    say(3, 400, 190)
    log = swarm.watch.log()
    assert (log.ticks, log.late_ticks) == (610, 3), "less late than it slept: none of them was missed"
    say(3, 420, 210)
    log = swarm.watch.log()
    assert log.ticks - 620 == log.late_ticks - 13, "what it did not sleep through counts as ever"
    assert 3 <= log.late_ticks <= 23


def test_a_survey_ends_without_a_word_of_who_is_frozen() -> None:
    swarm = SupervisedSwarm(freezes=(Freeze(3, 20.0),))
    swarm.take_off()
    swarm.run(20.0)
    swarm.order(Stage.FOUND)
    swarm.run(1.0)
    swarm.world(airborne=(3,))
    swarm.run(60.0)
    assert swarm.over is None, "its vehicle is waited for"
    swarm.world()
    swarm.run(5.0)
    assert swarm.outcome is SurveyOutcome.SOURCE_FOUND
    assert swarm.supervisor.freezes[0].until_s is None


def test_a_frozen_agent_that_dies_is_not_woken() -> None:
    swarm = SupervisedSwarm(Kill(3, 30.0), freezes=(Freeze(3, 20.0, 40.0),))
    swarm.take_off()
    swarm.run(40.0)
    assert (swarm.frozen, swarm.killed) == ([(3, True)], [3])
    assert (swarm.supervisor.alive, swarm.supervisor.frozen) == ({1, 2}, set())


def test_not_everybody_frozen_at_once_is_the_end() -> None:
    swarm = SupervisedSwarm(freezes=tuple(Freeze(d, 20.0, 30.0) for d in (1, 2, 3)))
    swarm.take_off()
    swarm.run(15.0)
    assert (swarm.supervisor.awake, swarm.over) == (set(), None)
    swarm.run(10.0)
    assert (swarm.supervisor.awake, swarm.over) == ({1, 2, 3}, None)


def test_an_orphan_that_never_lands_is_given_up() -> None:
    swarm = SupervisedSwarm(Kill(3, 20.0))
    swarm.take_off()
    swarm.run(20.0)
    swarm.order(Stage.FOUND)
    swarm.run(1.0)
    swarm.world(airborne=(3,))
    swarm.run(400.0)
    assert swarm.outcome is SurveyOutcome.SOURCE_FOUND


def test_a_process_that_dies_on_the_ground_ends_it_at_once() -> None:
    swarm = SupervisedSwarm()
    swarm.run(3.0, ended=[Ended("drone-2", 2, "drone-2.yaml: no such port")])
    assert swarm.outcome is SurveyOutcome.FAILED
    assert swarm.over is not None
    assert "no such port" in swarm.over.reason


def test_an_agent_that_dies_in_flight_is_a_loss_and_no_end() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.run(5.0, ended=[Ended("drone-2", 1, "")])
    assert swarm.over is None
    assert swarm.supervisor.alive == {1, 3}


def test_the_vehicles_gone_is_the_end() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.run(1.0, ended=[Ended("vehicles", -9, "")])
    assert swarm.outcome is SurveyOutcome.FAILED


def test_nobody_left() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.run(1.0, ended=[Ended(f"drone-{d}", -11, "") for d in (1, 2, 3)])
    assert swarm.over is None, "the vehicles still fly"
    swarm.world()
    swarm.run(5.0)
    assert swarm.outcome is SurveyOutcome.FAILED


def test_all_down_without_a_result() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    swarm.say(Phase.LANDED)
    swarm.world()
    swarm.run(10.0)
    assert swarm.outcome is SurveyOutcome.FAILED


def test_agents_that_never_come_up() -> None:
    swarm = SupervisedSwarm()
    swarm.say(Phase.DISARMED, drones=(1, 3))
    swarm.run(700.0)
    assert swarm.outcome is SurveyOutcome.FAILED
    assert swarm.over is not None
    assert "drone 2 did not report" in swarm.over.reason


def test_the_log_counts_from_the_first_take_off() -> None:
    swarm = SupervisedSwarm()
    swarm.take_off()
    log = swarm.watch.log()
    assert [mark.time_s for mark in log.phases if mark.phase is Phase.SEARCHING] == [0.0] * 3
    assert all(mark.time_s < 0.0 for mark in log.phases if mark.phase is Phase.DISARMED)
    assert msgspec.json.decode(msgspec.json.encode(log))["heals"] == 0


def test_garbage_on_the_air_is_counted_and_changes_nothing() -> None:
    watch = SurveyWatch([1])
    watch.hear(1.0, topics.STATE, b"\x01nonsense")
    watch.hear(2.0, topics.STATE, b"")
    assert watch.states == {}
    assert sum(watch.unreadable.values()) == 2


def test_the_takeoff_is_when_the_worlds_record_has_it_not_when_it_was_read() -> None:
    watch = SurveyWatch([1])
    watch.see(51.0, [TruthRow(50.2, 1, (0.0, 0.0, -0.1), True, True, "GUIDED", 420.0, 1.0)])
    assert watch.since_takeoff_s(52.2) == pytest.approx(2.0)


def test_the_best_reading_is_what_an_instrument_said_in_the_air() -> None:
    watch = SurveyWatch([1])
    for airborne, co2_ppm, filtered_ppm in ((False, 900.0, 0.0), (True, 700.0, 900.0), (True, 600.0, 9000.0)):
        said = msgspec.structs.replace(
            state(1, Phase.TRACKING, airborne=airborne),
            co2_ppm=co2_ppm,
            excess_co2_ppm=Scalar(filtered_ppm, 1.0, 0.1),
        )
        watch.hear(1.0, topics.STATE, topics.STATE.codec.encode(said))
    assert watch.best_co2_ppm == 700.0


def test_who_wakes_on_the_ground_is_started_again_and_who_flies_is_not() -> None:
    swarm = SupervisedSwarm(freezes=(Freeze(2, 20.0, 30.0), Freeze(3, 20.0, 30.0)))
    swarm.take_off()
    swarm.run(15.0)
    before = len(swarm.given)
    swarm.run(10.0)
    assert len(swarm.given) == before, "nothing was heard of them since they were woken"
    swarm.say(Phase.RTL, drones=(2,), airborne=True)
    swarm.say(Phase.LANDED, drones=(3,))
    swarm.run(5.0)
    assert {(c.name, c.target) for c in swarm.given[before:]} == {(CommandName.START, 3)}
    swarm.say(Phase.LANDED, drones=(2,))
    swarm.run(5.0)
    assert {c.target for c in swarm.given[before:]} == {2, 3}
    assert len({c.identity for c in swarm.given[before:]}) == 2, "one start each, however long it flies"


def test_a_refused_late_start_is_given_again_but_not_for_ever() -> None:
    swarm = SupervisedSwarm(freezes=(Freeze(3, 20.0, 30.0),))
    swarm.take_off()
    swarm.run(25.0)
    swarm.refusing = "not ready"
    swarm.say(Phase.LANDED, drones=(3,))
    before = len(swarm.given)
    swarm.run(60.0)
    assert len({c.identity for c in swarm.given[before:]}) == START_TRIES
    assert swarm.over is None


def test_nobody_is_started_again_once_the_survey_is_over() -> None:
    swarm = SupervisedSwarm(freezes=(Freeze(3, 20.0, 30.0),))
    swarm.take_off()
    swarm.run(15.0)
    swarm.order(Stage.FOUND)
    swarm.run(10.0)
    before = len(swarm.given)
    swarm.say(Phase.LANDED, drones=(3,))
    swarm.run(5.0)
    assert len(swarm.given) == before
