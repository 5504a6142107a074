"""The ticks of one agent, from its start until it is told to end or has to.

Everything that waits, fails or takes time is here, in `flightstack.shell` and in `flightstack.recording`, and not in
`flightstack.agent`.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import pathlib
import time
from collections.abc import Callable

import msgspec

from flightstack.agent import Agent, AgentStatus, Inputs, Outputs, PeerMessage
from flightstack.autopilot.telemetry import NO_HEARTBEAT, NO_HEARTBEAT_YET
from flightstack.config import DroneConfig
from flightstack.deadlines import Deadlines
from flightstack.recording.agent_recording import AgentRecording
from flightstack.recording.clock import Clock, make_clock
from flightstack.recording.start_number import next_start
from flightstack.shell import Shell, open_shell
from flightstack.stop_signals import StopSignals
from flightstack.swarm.topics import COMMAND
from flightstack.swarm.wire import Command, CommandName, Phase, Severity
from mission.documents.yaml_file import fault_of

log = logging.getLogger("flightstack")

LEVEL = {Severity.INFO: logging.INFO, Severity.WARNING: logging.WARNING, Severity.CRITICAL: logging.ERROR}


IDLE = frozenset({Phase.DISARMED, Phase.LANDED, Phase.CRASHED, Phase.PILOT})
"""The phases in which this agent has nothing in the air."""

TWIN_S = 10.0
"""Real seconds after the start in which an agent gives way to an older one with its id; later it stays."""


def run(config: DroneConfig, *, file: str = "configuration") -> int:
    """Fly until told to stop; returns the exit code."""
    stop = StopSignals()
    stop.install()
    clock = make_clock(config.speedup, config.clock)
    incarnation = next_start(pathlib.Path(config.record_to), f"drone-{config.drone}")
    agent = Agent(config, incarnation=incarnation)
    with contextlib.ExitStack() as opened:
        shell = open_shell(config, clock, file)
        opened.callback(shell.close)
        recording = AgentRecording(config, incarnation, clock.now_s(), file)
        opened.callback(recording.close)
        gc.collect()
        gc.freeze()  # what start-up made is never searched again: keeps the collector out of the ticks
        runner = Runner(agent, shell, recording, clock, stop, file)
        while runner.tick():
            pass
        runner.sum_up()
    return 0


class Runner:
    """Gives an agent its ticks; `tick` until it says that it was the last.

    The first signal in the air brings the drone home, the second ends the agent. A hang-up is no order to come home:
    the terminal that the agent was started from is gone, because a radio was. The flight goes on without it, and the
    agent ends when it has nothing in the air.
    """

    def __init__(
        self,
        agent: Agent,
        shell: Shell,
        recording: AgentRecording,
        clock: Clock,
        stop: StopSignals,
        file: str,
        *,
        real_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`clock` may be a simulation's; `real_s` are the seconds that a person waits, whatever the clock does."""
        self._agent = agent
        self._config = agent.config
        self._shell = shell
        self._recording = recording
        self._clock = clock
        self._stop = stop
        self._file = file
        self._real_s = real_s
        self._started_s = real_s()
        self._answered = False
        """The autopilot has been heard."""
        self._told_to_stop = False
        self._status: AgentStatus | None = None
        """Of the tick before, None before the first."""
        self.deadlines = Deadlines(1.0 / agent.config.tick_hz)
        self._due_s = clock.now_s()

    def tick(self) -> bool:
        """Wait for the next tick and take it; False if the agent has ended instead.

        Raises with one clear line where the agent cannot be run as configured: no autopilot answers, or another agent
        is this drone already.
        """
        self._clock.sleep_until(self._due_s)
        inputs = self._shell.gather(self.deadlines.late)
        if self._ends():
            return False
        inputs = self._with_signal(msgspec.structs.replace(inputs, storage=self._recording.problem))
        now_s = self._clock.now_s()
        outputs = self._agent.step(now_s, inputs)
        self._shell.send(outputs)
        self._recording.tick(now_s, inputs, outputs)
        self._log(outputs)
        self._status = outputs.status
        self._check(outputs.status)
        self._due_s = self.deadlines.next_due_s(self._due_s, self._clock.now_s())
        return True

    def sum_up(self) -> None:
        deadlines = self.deadlines
        log.info(
            "drone %d stopped: %d ticks, %d missed (%.2f %%), worst %.0f ms behind",
            self._config.drone,
            deadlines.ticks,
            deadlines.late,
            100.0 * deadlines.late / max(deadlines.ticks, 1),
            1000.0 * deadlines.worst_s / self._config.speedup,
        )

    def _ends(self) -> bool:
        return self._stop.count > 1 or (self._stop.asked and _may_end(self._status))

    def _with_signal(self, inputs: Inputs) -> Inputs:
        """The inputs, and once the command that a signal to this process stands for."""
        if not self._stop.count or self._told_to_stop:
            return inputs
        self._told_to_stop = True
        log.warning("told to stop in flight: going home first; a second signal ends the agent at once")
        drone = self._config.drone
        command = Command(f"signal-{drone}", "signal", drone, CommandName.ABORT)
        told = PeerMessage(COMMAND.name, "signal", COMMAND.codec.encode(command))
        return msgspec.structs.replace(inputs, peers=(*inputs.peers, told))

    def _log(self, outputs: Outputs) -> None:
        for event in outputs.events:
            log.log(LEVEL[event.severity], "%s: %s", event.code, event.text)
        if self.deadlines.ticks == 0:
            log.info(
                "drone %d ready: autopilot on %s, swarm %s",
                self._config.drone,
                self._shell.link.describe,
                self._config.swarm.name,
            )

    def _check(self, status: AgentStatus) -> None:
        """Whether the agent can be run as it is configured."""
        drone, link = self._config.drone, self._shell.link
        running_s = self._real_s() - self._started_s
        self._answered = self._answered or status.connected
        if not self._answered and running_s > self._config.autopilot.answer_timeout_s:
            # By now it is no matter of waiting for the first.
            why = NO_HEARTBEAT if status.waiting_for == NO_HEARTBEAT_YET else status.waiting_for
            raise fault_of(
                self._file,
                "autopilot.link",
                f"no autopilot with system id {drone} answers: "
                f"{link.problem or self._config.autopilot.link}; {why}",
            )
        if status.comes_second and running_s < TWIN_S and not status.airborne:
            raise fault_of(
                self._file,
                "drone",
                f"another agent of the swarm is drone {drone} already; every drone needs its own id",
            )


def _may_end(status: AgentStatus | None) -> bool:
    """Whether the agent leaves nothing behind that it steers. What a pilot flies is never taken to be landed."""
    return status is None or (status.phase in IDLE and not (status.airborne and status.steerable))
