"""The agent, one tick at a time, with an autopilot's bytes: it starts, steers, holds, obeys, lets go and tells."""

from __future__ import annotations

import pathlib
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.agent import Agent, AgentStatus, Inputs, Outputs, PeerMessage
from flightstack.config import DroneConfig
from flightstack.config_file import load
from flightstack.flight.transitions import TRANSITIONS, FlightEvent
from flightstack.recording.fingerprint import fingerprint
from flightstack.swarm import topics
from flightstack.swarm.wire import (
    Command,
    CommandName,
    CommandOutcome,
    DroneState,
    OrderState,
    Phase,
    Result,
    Severity,
    TableState,
)
from mission.geometry.frames import LocalFrame
from mission.strategies.contract import TreePlace

EXAMPLE = pathlib.Path(__file__).parents[3] / "examples" / "drone.yaml"
GUIDED, LOITER, RTL, LAND = 4, 5, 6, 9
TICK_S = 0.1


def example(**changes: Any) -> DroneConfig:
    """A drone that is a swarm of its own, without parameters to set: it forms up at once."""
    config = load(EXAMPLE)
    return msgspec.structs.replace(
        config,
        swarm=msgspec.structs.replace(config.swarm, members=(1,)),
        autopilot=msgspec.structs.replace(config.autopilot, parameters={}),
        **changes,
    )


class AgentFlight:
    """One agent and its autopilot, tick by tick; keeps what went in and came out."""

    def __init__(self, config: DroneConfig, autopilot: Any) -> None:
        self.agent = Agent(config, incarnation=7)
        self.autopilot = autopilot(config.drone, LocalFrame(config.origin))
        self.now_s = 100.0
        self.inputs: list[tuple[float, Inputs]] = []
        self.outputs: list[Outputs] = []
        self.setpoints: list[Any] = []
        """Of the newest tick."""

    def tick(
        self,
        *commands: CommandName,
        silent: bool = False,
        beside: bytes = b"",
        storage: str = "",
        without_recording: bool = False,
    ) -> Outputs:
        """`beside`: what others say on the vehicle's link; `storage`: why nothing is recorded."""
        self.now_s += TICK_S
        said = beside + (b"" if silent else self.autopilot.say(self.now_s))
        peers = tuple(
            PeerMessage(
                "command",
                "ground",
                topics.COMMAND.codec.encode(
                    Command(f"{name}-{len(self.inputs)}", "ground", 0, name, without_recording)
                ),
            )
            for name in commands
        )
        inputs = Inputs(said, (), peers, storage=storage)
        outputs = self.agent.step(self.now_s, inputs)
        self.inputs.append((self.now_s, inputs))
        self.outputs.append(outputs)
        self.setpoints = self.autopilot.hear(outputs.autopilot)
        return outputs

    def until(self, phase: Phase, *, within_s: float = 20.0) -> Outputs:
        for _ in range(round(within_s / TICK_S)):
            outputs = self.tick()
            if outputs.status.phase is phase:
                return outputs
        raise AssertionError(f"still {self.outputs[-1].status}")

    def to(self, phase: Phase) -> AgentFlight:
        """Fly the ordinary way until `phase`."""
        self.tick()
        self.tick(CommandName.START)
        self.until(Phase.FORMING)
        if phase is not Phase.FORMING:
            self.autopilot.up_m = 10.0  # over home, where the root's slot is
            self.until(Phase.SEARCHING)
        if phase is Phase.HOLDING:
            self.tick(CommandName.PAUSE)
        return self

    def events(self, code: str) -> list[tuple[Severity, str]]:
        return [(e.severity, e.text) for outputs in self.outputs for e in outputs.events if e.code == code]


@pytest.fixture
def flight(obedient_autopilot: Any) -> AgentFlight:
    return AgentFlight(example(), obedient_autopilot)


def told(outputs: Outputs, kind: type) -> list[Any]:
    messages = [topics.TOPICS[name].codec.decode(payload) for name, payload in outputs.peers]
    return [message for message in messages if isinstance(message, kind)]


def test_without_an_autopilot_it_waits_and_says_for_what(flight: AgentFlight) -> None:
    outputs = flight.tick(silent=True)
    assert outputs.status == AgentStatus(
        phase=Phase.DISARMED,
        connected=False,
        airborne=False,
        steerable=False,
        waiting_for="no heartbeat of the autopilot yet",
        comes_second=False,
        place=TreePlace(0, 0, {1: 0}, None, (), None, None, 1, False),
    )
    assert flight.setpoints == []
    (state,) = told(outputs, DroneState)
    assert state.position_ned_m is None
    for _ in range(40):
        outputs = flight.tick(silent=True)
    assert outputs.status.waiting_for == (
        "no heartbeat of the autopilot: check the cable, the baud rate and autopilot.link"
    )


def test_a_start_that_cannot_be_is_refused_in_the_same_tick(flight: AgentFlight) -> None:
    (outcome,) = told(flight.tick(CommandName.START, silent=True), CommandOutcome)
    assert (outcome.result, outcome.sender) == (Result.REFUSED, 1)
    assert outcome.reason == "the autopilot does not answer: check its link and power"
    assert told(flight.outputs[-1], TableState) == []


def test_a_start_arms_takes_off_and_tells_everybody(flight: AgentFlight) -> None:
    flight.tick()
    outputs = flight.tick(CommandName.START)
    assert outputs.status.phase is Phase.ARMING
    assert [outcome.result for outcome in told(outputs, CommandOutcome)] == [Result.ACCEPTED]
    (table,) = told(outputs, TableState)
    assert (table.survey, table.held) == ("start-1", {1: 0})
    outputs = flight.until(Phase.FORMING)
    assert flight.autopilot.armed
    assert flight.autopilot.mode == GUIDED
    assert outputs.status.airborne
    assert outputs.status.steerable
    flown = [outputs.status.phase for outputs in flight.outputs]
    assert list(dict.fromkeys(flown)) == [Phase.DISARMED, Phase.ARMING, Phase.TAKEOFF, Phase.FORMING]


def test_no_setpoint_leaves_before_the_phase_steers_and_one_in_every_tick_while_it_does(
    flight: AgentFlight,
) -> None:
    flight.tick()
    flight.tick(CommandName.START)
    for _ in range(200):
        outputs = flight.tick()
        steering = outputs.status.phase in (Phase.FORMING, Phase.SEARCHING)
        assert len(flight.setpoints) == (1 if steering else 0)
        if outputs.status.phase is Phase.FORMING:
            flight.autopilot.up_m = max(10.0, flight.autopilot.up_m - 0.2)
    assert flight.outputs[-1].status.phase is Phase.SEARCHING


def test_forming_up_leads_to_the_slot_and_ends_there(flight: AgentFlight) -> None:
    flight.to(Phase.FORMING)
    flight.tick()
    assert flight.setpoints[-1].vz > 0.0, "down from its layer to the root's slot"
    flight.autopilot.up_m = 10.0
    assert flight.tick().status.phase is Phase.SEARCHING
    assert flight.events("phase")[-1] == (Severity.INFO, "searching: in formation")


def test_a_pause_holds_the_place(flight: AgentFlight) -> None:
    flight.to(Phase.HOLDING)
    flight.tick()
    (held,) = flight.setpoints
    assert (held.lat_int, held.lon_int) == pytest.approx(
        (flight.agent.config.origin.latitude_deg * 1e7, flight.agent.config.origin.longitude_deg * 1e7),
        abs=10,
    )
    flight.autopilot.north_m = 3.0  # a gust
    flight.tick()
    assert flight.setpoints[-1].vx < 0.0, "back to where it held"
    assert flight.tick(CommandName.RESUME).status.phase is Phase.FORMING


@pytest.mark.parametrize(
    ("name", "mode", "phase"),
    [(CommandName.LAND, LAND, Phase.LANDING), (CommandName.RTL, RTL, Phase.RTL)],
)
def test_a_command_that_brings_it_down_gives_the_vehicle_to_the_autopilot(
    flight: AgentFlight, name: CommandName, mode: int, phase: Phase
) -> None:
    flight.to(Phase.SEARCHING)
    assert flight.tick(name).status.phase is phase
    assert flight.setpoints == []
    for _ in range(5):
        flight.tick()
        assert flight.setpoints == []
    assert flight.autopilot.mode == mode
    flight.autopilot.armed, flight.autopilot.up_m = False, 0.0
    assert flight.tick().status.phase is Phase.LANDED


FULL = "flights/drone-1-7.mcap: recording has ended: No space left on device"


def test_a_flight_that_cannot_be_recorded_is_not_started_unless_told_otherwise(flight: AgentFlight) -> None:
    flight.tick(storage=FULL)
    (outcome,) = told(flight.tick(CommandName.START, storage=FULL), CommandOutcome)
    assert (outcome.result, flight.outputs[-1].status.phase) == (Result.REFUSED, Phase.DISARMED)
    assert outcome.reason == f"{FULL}; mend it, or start with --without-recording"
    (outcome,) = told(flight.tick(CommandName.START, storage=FULL, without_recording=True), CommandOutcome)
    assert (outcome.result, flight.outputs[-1].status.phase) == (Result.ACCEPTED, Phase.ARMING)


def test_a_disk_that_fills_up_in_flight_is_told_and_ends_nothing(flight: AgentFlight) -> None:
    flight.to(Phase.SEARCHING)
    for _ in range(10):
        outputs = flight.tick(storage=FULL)
        assert outputs.status.phase is Phase.SEARCHING
        assert len(flight.setpoints) == 1
    states = [state for tick in flight.outputs[-5:] for state in told(tick, DroneState)]
    assert {state.storage for state in states} == {FULL}
    (outcome,) = told(flight.tick(CommandName.START, storage=FULL), CommandOutcome)
    assert outcome.result is Result.ACCEPTED, "it flies already"
    for _ in range(3):
        flight.tick()
    assert flight.events("recording") == [
        (Severity.WARNING, FULL),
        (Severity.INFO, "the flight is recorded again"),
    ]
    assert [s.storage for tick in flight.outputs[-2:] for s in told(tick, DroneState)] == [""]


def test_a_drone_whose_number_another_agent_has_is_not_started(flight: AgentFlight) -> None:
    flight.tick()
    (state,) = [s for tick in [flight.tick(), flight.tick()] for s in told(tick, DroneState)]
    twin = msgspec.structs.replace(state, incarnation=99)
    message = PeerMessage("state", "1", topics.STATE.codec.encode(twin))
    start = PeerMessage(
        "command", "ground", topics.COMMAND.codec.encode(Command("s", "ground", 0, CommandName.START))
    )
    flight.now_s += TICK_S
    outputs = flight.agent.step(
        flight.now_s, Inputs(flight.autopilot.say(flight.now_s), (), (message, start))
    )
    (outcome,) = told(outputs, CommandOutcome)
    assert outcome.result is Result.REFUSED
    assert "another agent says that it is drone 1 too" in outcome.reason
    for _ in range(60):
        flight.tick()
    (outcome,) = told(flight.tick(CommandName.START), CommandOutcome)
    assert outcome.result is Result.ACCEPTED, "the twin is gone"


STRANGERS = (
    "ping0",
    "ping8",
    "gimbal0",
    "gimbal3",
    "camera",
    "companion",
    "copter154",
    "qgc",
    "other2",
    "sys0",
)


@pytest.mark.parametrize("kind", [*STRANGERS, "veh255"])
def test_what_else_is_on_the_link_is_never_the_vehicle(
    flight: AgentFlight, neighbours: Any, kind: str
) -> None:
    """It talks beside the vehicle, then alone while that is silent, then beside it again."""
    flight.to(Phase.SEARCHING)
    for tick in range(100):
        outputs = flight.tick(silent=True, beside=neighbours.talkative(kind) if tick % 5 == 0 else b"")
        assert outputs.status.phase is Phase.SEARCHING
        assert outputs.status.airborne
    assert not outputs.status.connected
    for tick in range(30):
        outputs = flight.tick(beside=neighbours.talkative(kind) if tick % 5 == 0 else b"")
    states = [state for tick in flight.outputs for state in told(tick, DroneState)]
    assert not any(state.mode.startswith("MODE_") for state in states)
    assert (outputs.status.phase, outputs.status.airborne, outputs.status.steerable) == (
        Phase.SEARCHING,
        True,
        True,
    )
    assert len(flight.setpoints) == 1
    assert flight.events("pilot") == []
    assert flight.events("statustext") == []


@pytest.mark.parametrize("kind", [*STRANGERS, "generic1", "rover1", "gcs1", "veh251"])
def test_what_is_heard_first_or_alone_is_never_the_vehicle(
    flight: AgentFlight, neighbours: Any, kind: str
) -> None:
    for _ in range(20):
        outputs = flight.tick(silent=True, beside=neighbours.talkative(kind))
    assert (outputs.status.connected, outputs.status.airborne, outputs.status.phase) == (
        False,
        False,
        Phase.DISARMED,
    )
    (state,) = [s for tick in flight.outputs[-2:] for s in told(tick, DroneState)]
    assert (state.mode, state.position_ned_m, state.battery_fraction) == ("", None, None)
    assert flight.to(Phase.SEARCHING).outputs[-1].status.steerable


def test_an_answer_of_another_component_is_none(flight: AgentFlight, neighbours: Any) -> None:
    """A refusal from a gimbal must not end a start that the autopilot has not answered yet."""
    flight.autopilot.obeys = False
    flight.autopilot.ready = False
    flight.tick()
    flight.tick(CommandName.START)
    for _ in range(20):
        flight.tick(beside=neighbours.talkative("gimbal3"))
    assert flight.outputs[-1].status.phase is Phase.ARMING
    assert flight.events("arming") == []


def test_when_the_pilot_takes_the_mode_nothing_more_is_sent_in_the_same_tick(flight: AgentFlight) -> None:
    flight.to(Phase.SEARCHING)
    flight.autopilot.mode = LOITER
    sent = len(flight.autopilot.commands)
    for _ in range(20):
        assert flight.tick().status.phase is Phase.PILOT
        assert flight.setpoints == []
    modes = [c for c in flight.autopilot.commands[sent:] if c == mavlink.MAV_CMD_DO_SET_MODE]
    assert modes == [], "what the pilot has is not taken back"


def test_a_low_battery_brings_it_home(flight: AgentFlight) -> None:
    flight.to(Phase.SEARCHING)
    flight.autopilot.battery_percent = 10
    flight.until(Phase.RETURNING, within_s=4.0)
    assert flight.events("leaving") == [(Severity.WARNING, "returning: battery at 10%, below 30%")]


def test_an_autopilot_that_falls_silent_in_the_air_keeps_its_agent(flight: AgentFlight) -> None:
    flight.to(Phase.SEARCHING)
    for _ in range(100):
        outputs = flight.tick(silent=True)
    assert not outputs.status.connected
    assert outputs.status.phase is Phase.SEARCHING
    (state,) = told(flight.tick(silent=True), DroneState) or told(flight.tick(silent=True), DroneState)
    assert any("own position is" in note for note in state.notes)


def test_what_the_autopilot_says_is_told_with_its_weight(flight: AgentFlight) -> None:
    text = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, b"EKF variance")
    flight.tick()
    packed = flight.autopilot._packed(text)
    flight.autopilot._answers += packed
    flight.tick()
    assert flight.events("statustext") == [(Severity.CRITICAL, "EKF variance")]


def test_a_strategy_that_fails_brings_its_drone_home_instead_of_ending_the_agent(
    flight: AgentFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight.to(Phase.SEARCHING)

    def broken(*_: object) -> None:
        raise ZeroDivisionError("no way")

    monkeypatch.setattr(flight.agent._strategy, "decide", broken)
    flight.tick()
    flight.until(Phase.RETURNING, within_s=2.0)
    ((severity, text),) = flight.events("leaving")
    assert severity is Severity.WARNING
    assert "ZeroDivisionError" in text


def test_an_illegal_transition_is_told_once_and_the_drone_is_steered_on(
    flight: AgentFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A defect of ours must not end the agent of a drone in the air."""
    flight.to(Phase.FORMING)
    monkeypatch.delitem(TRANSITIONS, (Phase.FORMING, FlightEvent.SEARCH))
    flight.autopilot.up_m = 10.0
    for _ in range(5):
        assert flight.tick().status.phase is Phase.FORMING
        assert len(flight.setpoints) == 1
    assert flight.events("defect") == [
        (Severity.CRITICAL, "in the flight software: search cannot be in phase forming")
    ]
    assert [o.result for o in told(flight.tick(CommandName.PAUSE), CommandOutcome)] == [Result.ACCEPTED]
    assert flight.outputs[-1].status.phase is Phase.HOLDING


def test_the_same_inputs_give_the_same_outputs(flight: AgentFlight) -> None:
    flight.to(Phase.HOLDING)
    flight.tick(CommandName.RTL)
    again = Agent(flight.agent.config, incarnation=7)
    assert [again.step(now_s, inputs) for now_s, inputs in flight.inputs] == flight.outputs


def test_the_status_stays_on_the_drone_and_out_of_its_fingerprint(flight: AgentFlight) -> None:
    outputs = flight.to(Phase.SEARCHING).outputs[-1]
    other = msgspec.structs.replace(outputs.status, waiting_for="something else", comes_second=True)
    assert fingerprint(msgspec.structs.replace(outputs, status=other)) == fingerprint(outputs)
    assert fingerprint(msgspec.structs.replace(outputs, autopilot=b"")) != fingerprint(outputs)


def test_of_a_survey_before_nothing_is_remembered(flight: AgentFlight) -> None:
    flight.to(Phase.SEARCHING)
    flight.tick(CommandName.LAND)
    flight.autopilot.armed, flight.autopilot.up_m = False, 0.0
    flight.until(Phase.LANDED)
    flight.autopilot.mode = GUIDED
    before = flight.agent._strategy
    outputs = flight.tick(CommandName.START)
    (table,) = told(outputs, TableState) or told(flight.tick(), TableState)
    assert table.survey != "start-1"
    (ordered,) = told(outputs, OrderState) or told(flight.tick(), OrderState)
    assert (ordered.survey, ordered.order.sequence) == (table.survey, 1)
    assert flight.agent._strategy is not before
