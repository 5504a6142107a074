"""The ticks of an agent, on a clock that a test sets, with ends that nobody waits for."""

from __future__ import annotations

import logging
import pathlib
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from flightstack.agent import Agent, AgentStatus, Inputs, Outputs, PeerMessage
from flightstack.config import DroneConfig
from flightstack.config_file import load
from flightstack.recording.agent_recording import AgentRecording
from flightstack.recording.clock import SimulatedClock
from flightstack.recording.recorder import Record, read_recording
from flightstack.recording.replay import replay
from flightstack.runner import TWIN_S, Runner
from flightstack.shell import Shell
from flightstack.stop_signals import StopSignals
from flightstack.swarm.topics import COMMAND, STATE
from flightstack.swarm.wire import Command, CommandName, Event, Phase, Severity
from flightstack.transport import TransportError
from flightstack.transport.memory import MemoryRadio, MemoryTransport
from mission.documents.yaml_file import DocumentError
from mission.geometry.frames import LocalFrame
from mission.strategies.contract import TreePlace

EXAMPLE = pathlib.Path(__file__).parents[3] / "examples" / "drone.yaml"
IDLE = AgentStatus(
    phase=Phase.DISARMED,
    connected=True,
    airborne=False,
    steerable=False,
    waiting_for="",
    comes_second=False,
    place=TreePlace(0, -1, {}, None, (), None, None, -1, False),
)
FLYING = msgspec.structs.replace(IDLE, phase=Phase.SEARCHING, airborne=True, steerable=True)


class ScriptedLink:
    """A link in memory: what is to be read is put in `incoming`."""

    describe = "a test's link"
    problem = ""
    reconnects = 0
    dropped_bytes = 0

    def __init__(self) -> None:
        self.incoming = b""
        self.written: list[bytes] = []
        self.closed = False

    def read(self) -> bytes:
        data, self.incoming = self.incoming, b""
        return data

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def close(self) -> None:
        self.closed = True


class ScriptedAgent:
    """Stands for an agent: says what a test wants it to say, and may take its time."""

    def __init__(self, config: DroneConfig, clock: SimulatedClock) -> None:
        self.config = config
        self.status = IDLE
        self.events: tuple[Event, ...] = ()
        self.takes_s = 0.0
        self.got: list[tuple[float, Inputs]] = []
        self._clock = clock

    def step(self, now_s: float, inputs: Inputs) -> Outputs:
        self.got.append((now_s, inputs))
        self._clock.sleep_until(now_s + self.takes_s)
        return Outputs(b"to the autopilot", (), ((STATE.name, b"state"),), self.events, self.status)


class RunnerRig:
    def __init__(self, directory: pathlib.Path, agent: Agent | None = None, **config: Any) -> None:
        self.config = msgspec.structs.replace(load(EXAMPLE), record_to=str(directory), **config)
        self.clock = SimulatedClock(50.0)
        self.real_s = 1000.0
        self.radio = MemoryRadio(seed=1)
        self.link = ScriptedLink()
        self.stop = StopSignals()
        self.scripted = ScriptedAgent(self.config, self.clock)
        self.recording = AgentRecording(self.config, 7, self.clock.now_s(), "drone.yaml")
        self.peer: MemoryTransport = self.radio.join("ground")
        self.shell = Shell(self.link, {}, self.radio.join("1"))
        self.runner = Runner(
            agent or self.scripted,  # type: ignore[arg-type]
            self.shell,
            self.recording,
            self.clock,
            self.stop,
            "drone.yaml",
            real_s=lambda: self.real_s,
        )

    def ticks(self, count: int) -> None:
        for _ in range(count):
            assert self.runner.tick()

    def recorded(self) -> list[Record]:
        self.recording.close()
        return list(read_recording(self.recording.path))


@pytest.fixture
def rig(tmp_path: pathlib.Path) -> Iterator[RunnerRig]:
    made = RunnerRig(tmp_path)
    yield made
    made.recording.close()


def test_ticks_come_by_the_period_and_carry_what_came_in_between(rig: RunnerRig) -> None:
    rig.link.incoming = b"from the autopilot"
    command = COMMAND.codec.encode(Command("c1", "ground", 0, CommandName.START))
    rig.peer.publish(COMMAND, command)
    rig.radio.step(60.0)
    rig.ticks(3)
    assert [now_s for now_s, _ in rig.scripted.got] == pytest.approx([50.0, 50.1, 50.2])
    first = Inputs(b"from the autopilot", (), (PeerMessage("command", "ground", command),), 0)
    assert [inputs for _, inputs in rig.scripted.got] == [first, Inputs(), Inputs()]


def test_what_an_agent_says_is_sent(rig: RunnerRig) -> None:
    rig.ticks(1)
    rig.radio.step(60.0)
    assert rig.link.written == [b"to the autopilot"]
    assert [(r.topic, r.sender, r.payload) for r in rig.peer.receive()] == [(STATE, "1", b"state")]


def test_ticks_that_took_too_long_are_told_to_the_agent_and_not_made_up(rig: RunnerRig) -> None:
    rig.ticks(1)
    rig.scripted.takes_s = 0.35
    rig.ticks(1)
    rig.scripted.takes_s = 0.0
    rig.ticks(2)
    assert [now_s for now_s, _ in rig.scripted.got] == pytest.approx([50.0, 50.1, 50.5, 50.6])
    assert [inputs.late_ticks for _, inputs in rig.scripted.got] == [0, 0, 3, 3]
    assert (rig.runner.deadlines.ticks, rig.runner.deadlines.late) == (7, 3)


def test_events_are_logged_by_their_severity(rig: RunnerRig, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "flightstack")
    rig.scripted.events = (Event(1, 1, Severity.CRITICAL, "down", "landed: disarmed during the survey"),)
    rig.ticks(1)
    rig.scripted.events = ()
    rig.ticks(1)
    assert caplog.record_tuples == [
        ("flightstack", logging.ERROR, "down: landed: disarmed during the survey"),
        ("flightstack", logging.INFO, "drone 1 ready: autopilot on a test's link, swarm crater"),
    ]


def test_a_signal_on_the_ground_ends_the_agent_before_another_tick(rig: RunnerRig) -> None:
    rig.ticks(1)
    rig.stop.count = 1
    assert not rig.runner.tick()
    assert len(rig.scripted.got) == 1


def test_a_signal_before_the_first_tick_ends_the_agent(rig: RunnerRig) -> None:
    rig.stop.count = 1
    assert not rig.runner.tick()
    assert rig.scripted.got == []


def test_the_first_signal_in_the_air_brings_the_drone_home_and_the_second_ends_the_agent(
    rig: RunnerRig,
) -> None:
    rig.scripted.status = FLYING
    rig.ticks(1)
    rig.stop.count = 1
    rig.ticks(3)
    told = [COMMAND.codec.decode(m.payload) for _, inputs in rig.scripted.got for m in inputs.peers]
    assert told == [Command("signal-1", "signal", 1, CommandName.ABORT)]
    rig.stop.count = 2
    assert not rig.runner.tick()


def test_after_a_signal_the_agent_ends_when_it_is_down(rig: RunnerRig) -> None:
    rig.scripted.status = FLYING
    rig.ticks(1)
    rig.stop.count = 1
    rig.ticks(5)
    rig.scripted.status = msgspec.structs.replace(IDLE, phase=Phase.LANDED)
    rig.ticks(1)
    assert not rig.runner.tick()


def test_a_hang_up_is_no_order_to_come_home(rig: RunnerRig) -> None:
    rig.scripted.status = FLYING
    rig.ticks(1)
    rig.stop.hung_up = True
    rig.ticks(5)
    assert all(inputs.peers == () for _, inputs in rig.scripted.got)
    rig.scripted.status = IDLE
    rig.ticks(1)
    assert not rig.runner.tick()


@pytest.mark.parametrize(
    ("status", "ends"),
    [
        (msgspec.structs.replace(IDLE, phase=Phase.PILOT, airborne=True), True),
        (msgspec.structs.replace(IDLE, airborne=True, steerable=True), False),
        (msgspec.structs.replace(IDLE, phase=Phase.ARMING), False),
        (msgspec.structs.replace(FLYING, phase=Phase.LANDING, steerable=False), False),
    ],
    ids=["what a pilot flies", "restarted in the air, in our mode", "arming", "landing"],
)
def test_what_the_agent_steers_is_not_left_behind(rig: RunnerRig, status: AgentStatus, ends: bool) -> None:
    rig.scripted.status = status
    rig.ticks(1)
    rig.stop.count = 1
    assert rig.runner.tick() is not ends


def test_an_autopilot_that_does_not_answer_in_time_is_the_files_fault(rig: RunnerRig) -> None:
    rig.scripted.status = msgspec.structs.replace(IDLE, connected=False, waiting_for="no heartbeat")
    rig.ticks(10)
    rig.real_s += rig.config.autopilot.answer_timeout_s
    rig.ticks(1)
    rig.real_s += 0.1
    with pytest.raises(DocumentError, match=r"drone\.yaml.*autopilot\.link: no autopilot with system id 1"):
        rig.runner.tick()


def test_an_autopilot_that_has_answered_once_may_fall_silent(rig: RunnerRig) -> None:
    rig.ticks(1)
    rig.scripted.status = msgspec.structs.replace(IDLE, connected=False)
    rig.real_s += 1000.0
    rig.ticks(5)
    assert len(rig.scripted.got) == 6


def test_the_younger_of_two_agents_with_one_number_ends(rig: RunnerRig) -> None:
    rig.scripted.status = msgspec.structs.replace(IDLE, comes_second=True)
    with pytest.raises(DocumentError, match="another agent of the swarm is drone 1 already"):
        rig.runner.tick()


@pytest.mark.parametrize(
    ("status", "after_s"), [(FLYING, 0.0), (IDLE, TWIN_S)], ids=["in the air", "later than at the start"]
)
def test_an_agent_that_has_begun_does_not_give_way_to_another(
    rig: RunnerRig, status: AgentStatus, after_s: float
) -> None:
    rig.scripted.status = msgspec.structs.replace(status, comes_second=True)
    rig.real_s += after_s
    rig.ticks(3)
    assert len(rig.scripted.got) == 3


def test_every_tick_is_recorded_and_can_be_flown_again(
    tmp_path: pathlib.Path, obedient_autopilot: Any
) -> None:
    config = msgspec.structs.replace(load(EXAMPLE), record_to=str(tmp_path))
    rig = RunnerRig(tmp_path, Agent(config, incarnation=7))
    autopilot = obedient_autopilot(1, LocalFrame(config.origin))
    start = COMMAND.codec.encode(Command("c1", "ground", 0, CommandName.START))
    for tick in range(60):
        rig.link.incoming = autopilot.say(rig.clock.now_s())
        if tick == 5:
            rig.peer.publish(COMMAND, start)
        rig.radio.step(rig.clock.now_s())
        rig.ticks(1)
        for data in rig.link.written[-1:]:
            autopilot.hear(data)
    records = rig.recorded()
    assert [record.topic for record in records[:3]] == ["/config", "/inputs", "/outputs"]
    assert [r.message["code"] for r in records if r.topic == "/event"][:2] == ["phase", "command"]
    result = replay(rig.recording.path)
    assert (result.ticks, result.differing) == (60, 0)


def test_the_agent_is_told_while_nothing_is_recorded(rig: RunnerRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.ticks(1)
    with monkeypatch.context() as patched:
        patched.setattr(AgentRecording, "problem", "the disk is full")
        rig.ticks(1)
    rig.ticks(1)
    assert [inputs.storage for _, inputs in rig.scripted.got] == ["", "the disk is full", ""]


def test_closing_closes_every_end(rig: RunnerRig) -> None:
    rig.shell.close()
    assert rig.link.closed
    with pytest.raises(TransportError, match="node 1 has left"):
        rig.shell.transport.receive()
