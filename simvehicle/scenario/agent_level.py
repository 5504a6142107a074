"""A scenario flown by whole agents with simulated autopilots, its invariants looked at in every tick."""

from __future__ import annotations

from typing import Final

from flightstack.agent import Inputs, Outputs
from flightstack.swarm.wire import CommandName
from simvehicle.faults.schedule import SwarmFaultSchedule, Timetable
from simvehicle.scenario.afflicted_swarm import AfflictedSwarm
from simvehicle.scenario.ground_keeper import GroundKeeper
from simvehicle.scenario.invariants import Invariants
from simvehicle.scenario.scenario_file import FlownScenario
from simvehicle.scenario.scenario_result import ScenarioResult
from simvehicle.scenario.swarm import Scenario
from simvehicle.scenario.transcript import Transcript
from simvehicle.survey.draft import draft, in_process

HEARD_AFTER_S: Final = 2.0
"""From power-up until everybody was heard: then the operator starts the survey."""
TAKES_OFF_WITHIN_S: Final = 60.0
"""From when the autopilots are ready: parameters and fence are written before, and the climb takes seconds."""
DOWN_FOR_S: Final = 2.0
"""So long everybody must stand on the ground with the motors off before the scenario is over."""


class AgentFlight:
    """One scenario being flown; `run` flies it to its end."""

    def __init__(self, scenario: FlownScenario) -> None:
        config = scenario.config
        parts = draft(scenario.survey, in_process(scenario.survey))
        self.flight = Scenario(parts.drones, parts.fleet, config.radio, ground_ned_m=config.ground_ned_m)
        self._config = config
        self._swarm = AfflictedSwarm(self.flight)
        self._faults = SwarmFaultSchedule(config.swarm_faults)
        self._vehicle_faults = Timetable(
            config.faults
        )  # for the transcript: the vehicles' own schedule strikes
        self._invariants = Invariants(self.flight, self._swarm)
        self._transcript = Transcript()
        self._keeper = GroundKeeper(self.flight) if config.ground_brings_home else None
        self._down_s = 0.0
        """When somebody was last seen to fly, or to be about to."""
        self.flight.tap = self._tap

    def run(self) -> ScenarioResult:
        flight, config = self.flight, self._config
        flight.run(HEARD_AFTER_S)
        flight.command(CommandName.START)
        if not flight.run_until(
            lambda: flight.first_takeoff_s is not None, config.ready_after_s + TAKES_OFF_WITHIN_S
        ):
            self._invariants.violated("ends", "", "nobody took off")
        elif not flight.run_until(self._over, config.last_fault_s + config.ends_within_s):
            flying = [str(d) for d, m in flight.members.items() if m.vehicle.airborne]
            text = f"{config.ends_within_s:g} s after the last fault not everybody is on the ground with motors off"
            self._invariants.violated("ends", f"drones {', '.join(flying)}" if flying else "", text)
        self._transcript.say("over" if flight.source_ned_m is None else "over, source found")
        for violation in self._invariants.violations:
            self._transcript.say(f"VIOLATION {violation.kind} at {violation.at_s:g} s: {violation.text}")
        return ScenarioResult(
            self._invariants.violations,
            self._transcript.lines,
            {
                "simulated_s": round(flight.now_s, 1),
                "min_separation_m": round(min(flight.min_separation_m, 1e6), 2),
            },
        )

    def _over(self) -> bool:
        """Called once a tick, after it."""
        flight = self.flight
        since_s = flight.now_s - (flight.first_takeoff_s or flight.now_s)
        self._transcript.at(since_s)
        for begins, fault in self._faults.strike(since_s, self._swarm):
            self._transcript.fault(begins, fault)
        for begins, own in self._vehicle_faults.due(since_s):
            self._transcript.fault(begins, own)
        if self._keeper is not None and self._swarm.ground_here:
            for drone in self._keeper.step():
                self._transcript.sent_home(drone)
        self._invariants.look()
        down = not any(m.vehicle.airborne or m.vehicle.armed for m in flight.members.values())
        if not down or since_s <= self._config.last_fault_s:
            self._down_s = flight.now_s
        return flight.now_s - self._down_s > DOWN_FOR_S

    def _tap(self, drone: int, _agents_s: float, _heard: Inputs, said: Outputs) -> None:
        self._invariants.hear(drone, said)
        self._transcript.phase(drone, said.status.phase)
        table = self._invariants.tables.get(drone)
        if table is not None:
            self._transcript.table(table)
        for event in said.events:
            self._transcript.event(drone, event.code, event.text)


def fly_scenario(scenario: FlownScenario) -> ScenarioResult:
    """Fly it from the operator's start to everybody on the ground."""
    return AgentFlight(scenario).run()
