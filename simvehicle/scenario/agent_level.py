"""A scenario flown by whole agents with simulated autopilots, its invariants looked at in every tick."""

from __future__ import annotations

import logging
from typing import Final

from flightstack.agent import Inputs, Outputs
from flightstack.swarm.wire import CommandName
from simvehicle.faults.schedule import SwarmFaultSchedule, Timetable
from simvehicle.scenario.afflicted_swarm import AfflictedSwarm
from simvehicle.scenario.ground_keeper import GroundKeeper
from simvehicle.scenario.invariants import Invariants
from simvehicle.scenario.own_matters import kept_up
from simvehicle.scenario.scenario_file import FlownScenario
from simvehicle.scenario.scenario_result import ScenarioResult
from simvehicle.scenario.swarm import Scenario
from simvehicle.scenario.transcript import Transcript
from simvehicle.survey.draft import draft, in_process

_log = logging.getLogger(__name__)

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
        self.flight = Scenario(
            parts.drones, parts.fleet, config.radio, ground_ned_m=config.ground_ned_m, ground_beats=True
        )
        self._config = config
        self._swarm = AfflictedSwarm(self.flight)
        self._faults = SwarmFaultSchedule(config.swarm_faults)
        self._vehicle_faults = Timetable(config.faults)
        """For the transcript: they strike by the vehicles' own schedule."""
        self._keeper = GroundKeeper(self.flight) if config.ground_brings_home else None
        self._invariants = Invariants(self.flight, self._swarm, self._keeper)
        self._transcript = Transcript()
        self._down_s = 0.0
        """When somebody who ought to be down was last seen not to be."""
        self.flight.tap = self._tap

    def run(self) -> ScenarioResult:
        try:
            self._fly()
        except Exception as error:  # noqa: BLE001 - it would end an agent's process: it is what a search looks for
            _log.exception("a scenario has ended by an error")
            self._invariants.violated("error", "", f"{type(error).__name__}: {error}")
        return self._told()

    def _fly(self) -> None:
        flight, config = self.flight, self._config
        flight.run(HEARD_AFTER_S)
        flight.command(CommandName.START)
        if not flight.run_until(
            lambda: flight.first_takeoff_s is not None, config.ready_after_s + TAKES_OFF_WITHIN_S
        ):
            self._invariants.violated("ends", "", "nobody took off")
        elif not flight.run_until(self._over, config.last_fault_s + config.ends_within_s):
            late = sorted(self._up() - self._kept_up().keys())
            text = f"not on the ground with motors off {config.ends_within_s:g} s after the last fault"
            self._invariants.violated("ends", f"drones {' '.join(map(str, late))}", text)

    def _told(self) -> ScenarioResult:
        flight = self.flight
        for drone, reason in self._kept_up().items():
            if drone in self._up():
                self._transcript.left_up(drone, reason)
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
        since_s = self._time_s()
        for begins, fault in self._faults.strike(since_s, self._swarm):
            self._transcript.fault(begins, fault)
        if self._keeper is not None and self._swarm.ground_here:
            for drone in self._keeper.step():
                self._transcript.sent_home(drone)
        self._invariants.look()
        if since_s <= self._config.last_fault_s or self._up() - self._kept_up().keys():
            self._down_s = flight.now_s
        return flight.now_s - self._down_s > DOWN_FOR_S

    def _time_s(self) -> float:
        """Since the first take-off. The transcript knows it, and what happened to vehicles up to now."""
        flight = self.flight
        since_s = flight.now_s - (flight.first_takeoff_s or flight.now_s)
        self._transcript.at(since_s)
        for begins, own in self._vehicle_faults.due(since_s) if flight.first_takeoff_s is not None else ():
            self._transcript.fault(begins, own)
        return since_s

    def _up(self) -> set[int]:
        return {drone for drone, m in self.flight.members.items() if not m.vehicle.at_rest}

    def _kept_up(self) -> dict[int, str]:
        return kept_up(self.flight, self._swarm, ground_brings_home=self._keeper is not None)

    def _tap(self, drone: int, _agents_s: float, _heard: Inputs, said: Outputs) -> None:
        self._time_s()
        self._invariants.hear(drone, said)
        self._transcript.phase(drone, said.status.phase)
        agreement = self._invariants.agreement
        self._transcript.table(drone, agreement.places[drone].epoch, agreement.whole_table(drone))
        for event in said.events:
            self._transcript.event(drone, event.code, event.text)


def fly_scenario(scenario: FlownScenario) -> ScenarioResult:
    """Fly it from the operator's start to everybody on the ground."""
    return AgentFlight(scenario).run()
