"""The shell around the agent: opens links, ports and the network, and gives the agent its ticks.

Everything that waits, fails or takes time is here and not in `flightstack.agent`. One thread ticks; draining
never blocks; what cannot be sent now is dropped and counted by the link that could not send it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import logging
import pathlib
import random
import signal
import time
import zlib
from types import FrameType

import msgspec

from flightstack.agent import Agent, Inputs, Outputs, PeerMessage
from flightstack.config import DroneConfig
from flightstack.mavlink.link import ByteLink, LinkError, open_link
from flightstack.recording.clock import Clock, make_clock
from flightstack.recording.recorder import FlightRecorder, RecordingError, unused
from flightstack.sensing.filter_stage import PortInput
from flightstack.swarm import topics
from flightstack.swarm.peers import RECEIVED_BY_DRONES
from flightstack.swarm.wire import VERSION, Command, CommandName, Phase, Severity
from flightstack.transport import Transport, TransportError
from flightstack.transport.endpoints import faulty_field
from flightstack.transport.zenoh_transport import ZenohTransport
from mission.documents.yaml_file import fault_of
from sensors.instruments.registry import instrument_type
from sensors.serial.port import InstrumentPort

log = logging.getLogger("flightstack")

LEVEL = {Severity.INFO: logging.INFO, Severity.WARNING: logging.WARNING, Severity.CRITICAL: logging.ERROR}


IDLE = frozenset({Phase.DISARMED, Phase.LANDED, Phase.PILOT})
"""The phases in which this agent has nothing in the air."""

TWIN_S = 10.0
"""Real seconds after the start in which an agent gives way to an older one with its id; later it stays."""


@dataclasses.dataclass
class Deadlines:
    """Which ticks were missed: those whose outputs left more than one period after they were due."""

    period_s: float
    ticks: int = 0
    late: int = 0
    worst_s: float = 0.0

    def next_due_s(self, due_s: float, finished_s: float) -> float:
        """Count the tick that was due at `due_s` and tell when the next one is; missed ones are not made up."""
        self.ticks += 1
        behind_s = finished_s - due_s
        self.worst_s = max(self.worst_s, behind_s)
        missed = max(0, int(behind_s / self.period_s))
        self.late += missed
        self.ticks += missed
        return due_s + (missed + 1) * self.period_s


@dataclasses.dataclass
class Shell:
    """The open ends of one agent."""

    link: ByteLink
    ports: dict[str, InstrumentPort]
    transport: Transport

    def gather(self, late_ticks: int) -> Inputs:
        ports: list[PortInput] = []
        for name, port in self.ports.items():
            data, events = port.read(), port.events()
            ports += [PortInput(name, connected=True) for event in events if event.connected]
            if data:
                ports.append(PortInput(name, data))
            ports += [PortInput(name, lost=event.reason) for event in events if not event.connected]
        peers = tuple(PeerMessage(r.topic.name, r.sender, r.payload) for r in self.transport.receive())
        return Inputs(self.link.read(), tuple(ports), peers, late_ticks)

    def send(self, outputs: Outputs) -> None:
        if outputs.autopilot:
            self.link.write(outputs.autopilot)
        for name, data in outputs.ports:
            self.ports[name].write(data)
        for topic, payload in outputs.peers:
            self.transport.publish(topics.TOPICS[topic], payload)

    def close(self) -> None:
        for port in self.ports.values():
            port.close()
        self.transport.close()
        self.link.close()


def open_shell(config: DroneConfig, clock: Clock, file: str = "configuration") -> Shell:
    """Open everything that the configuration names. What cannot be opened raises with one clear line."""
    try:
        link = open_link(config.autopilot.link)
    except LinkError as error:
        raise fault_of(file, "autopilot.link", str(error)) from error
    try:
        transport = ZenohTransport(
            config.swarm.name,
            config.drone,
            listen=config.swarm.listen,
            connect=config.swarm.connect,
            receives=RECEIVED_BY_DRONES,
            tls=config.swarm.tls,
        )
    except TransportError as error:
        link.close()
        raise fault_of(file, faulty_field(error), str(error)) from error
    except BaseException:
        link.close()
        raise
    ports = {
        item.name: InstrumentPort(
            item.port, item.baud or instrument_type(item.type).baud or 9600, clock.now_s
        )
        for item in config.instruments
        if item.port != "mavlink"
    }
    return Shell(link, ports, transport)


class Stop:
    """Signals, remembered: the first one in the air brings the drone home, the second ends the agent.

    A hang-up is no order to come home: the terminal that the agent was started from is gone, because a radio was. The
    flight goes on without it, and the agent ends when it has nothing in the air.
    """

    def __init__(self) -> None:
        self.count = 0
        self.hung_up = False

    def install(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as nohup wants it
            signal.signal(signal.SIGHUP, self._on_hang_up)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1

    def _on_hang_up(self, _number: int, _frame: FrameType | None) -> None:
        self.hung_up = True


def run(config: DroneConfig, *, file: str = "configuration") -> int:
    """Fly until told to stop; returns the exit code."""
    stop = Stop()
    stop.install()
    clock = make_clock(config.speedup, config.clock)
    incarnation = random.SystemRandom().getrandbits(31)
    agent = Agent(config, incarnation=incarnation)
    with contextlib.ExitStack() as opened:
        shell = open_shell(config, clock, file)
        opened.callback(shell.close)
        recorder = _open_recorder(config, incarnation, file)
        opened.callback(recorder.close)
        about = {"config": config, "incarnation": incarnation, "wire": VERSION}
        recorder.record("/config", clock.now_s(), about)
        gc.collect()
        gc.freeze()  # what start-up made is never searched again: keeps the collector out of the ticks
        return _loop(agent, shell, recorder, clock, stop, file)


def _open_recorder(config: DroneConfig, incarnation: int, file: str) -> FlightRecorder:
    directory = pathlib.Path(config.record_to)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        return FlightRecorder(unused(directory / f"drone-{config.drone}-{incarnation:08x}.mcap"))
    except OSError as error:
        problem = f"{directory} cannot be made: {error.strerror}; name another directory"
        raise fault_of(file, "record_to", problem) from error
    except RecordingError as error:
        raise fault_of(file, "record_to", str(error)) from error


def _loop(agent: Agent, shell: Shell, recorder: FlightRecorder, clock: Clock, stop: Stop, file: str) -> int:
    config = agent.config
    deadlines = Deadlines(1.0 / config.tick_hz)
    started_s = time.monotonic()
    answer_by_s: float | None = started_s + config.autopilot.answer_timeout_s
    told = False
    due_s = clock.now_s()
    while True:
        clock.sleep_until(due_s)
        inputs = shell.gather(deadlines.late)
        vehicle = agent.session.report
        if stop.count > 1 or ((stop.count or stop.hung_up) and _may_end(agent)):
            break
        if stop.count and not told:
            told = True
            log.warning("told to stop in flight: going home first; a second signal ends the agent at once")
            inputs = msgspec.structs.replace(inputs, peers=(*inputs.peers, _abort(config.drone)))
        now_s = clock.now_s()
        outputs = agent.step(now_s, inputs)
        shell.send(outputs)
        _record(recorder, now_s, inputs, outputs)
        if deadlines.ticks == 0:
            log.info(
                "drone %d ready: autopilot on %s, swarm %s",
                config.drone,
                shell.link.describe,
                config.swarm.name,
            )
        if answer_by_s is not None and vehicle.connected:
            answer_by_s = None
        if answer_by_s is not None and time.monotonic() > answer_by_s:
            raise fault_of(
                file,
                "autopilot.link",
                f"no autopilot with system id {config.drone} answers: "
                f"{shell.link.problem or config.autopilot.link}; {vehicle.ready_reason}",
            )
        if agent.comes_second and time.monotonic() - started_s < TWIN_S and not vehicle.airborne:
            raise fault_of(
                file,
                "drone",
                f"another agent of the swarm is drone {config.drone} already; every drone needs its own id",
            )
        due_s = deadlines.next_due_s(due_s, clock.now_s())
    log.info(
        "drone %d stopped: %d ticks, %d missed (%.2f %%), worst %.0f ms behind",
        config.drone,
        deadlines.ticks,
        deadlines.late,
        100.0 * deadlines.late / max(deadlines.ticks, 1),
        1000.0 * deadlines.worst_s / config.speedup,
    )
    return 0


def _may_end(agent: Agent) -> bool:
    """Whether the agent leaves nothing behind that it steers. What a pilot flies is never taken to be landed."""
    vehicle = agent.session.report
    return agent.phase.phase in IDLE and not (vehicle.airborne and vehicle.mode_ours)


def _abort(drone: int) -> PeerMessage:
    """The command that a signal to this process stands for."""
    command = Command(f"signal-{drone}", "signal", drone, CommandName.ABORT)
    return PeerMessage(topics.COMMAND.name, "signal", topics.COMMAND.codec.encode(command))


def _record(recorder: FlightRecorder, now_s: float, inputs: Inputs, outputs: Outputs) -> None:
    """Keep the tick: its inputs whole, so that the flight can be replayed, and a fingerprint of its outputs."""
    recorder.record("/inputs", now_s, inputs)
    recorder.record("/outputs", now_s, {"crc32": fingerprint(outputs)})
    for event in outputs.events:
        log.log(LEVEL[event.severity], "%s: %s", event.code, event.text)
        recorder.record("/event", now_s, event)


def fingerprint(outputs: Outputs) -> int:
    """One number that differs where two ticks' outputs differ."""
    return zlib.crc32(msgspec.msgpack.encode(outputs))
