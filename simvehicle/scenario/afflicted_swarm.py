"""What the faults of the table do to a swarm in one process."""

from __future__ import annotations

import dataclasses
from typing import Final

from flightstack.swarm.wire import CommandName, CommandOutcome, Result
from simvehicle.faults.fault_table import CommandWord, SwarmFaultSpec
from simvehicle.scenario.swarm import GROUND, Scenario

STICKS_MODE: Final = {"ardupilot": 5, "px4": 3 << 16}
"""The custom modes in which the sticks fly and hold the vehicle: ArduPilot's LOITER, PX4's POSCTL."""


class AfflictedSwarm:
    """A `simvehicle.faults.fault_table.SwarmVictim`."""

    def __init__(self, flight: Scenario) -> None:
        self._flight = flight
        self._calm = flight.radio.conditions
        self._pieces: dict[SwarmFaultSpec, list[str]] = {}
        self._given: dict[str, CommandWord] = {}
        """The operator's commands by their identity."""
        self.pilots: dict[int, float] = {}
        """Drones that a pilot has taken, with the time."""
        self.ground_here = True
        self.in_burst = False
        """More is lost on every link than the scenario's radio loses."""

    def kill(self, drone: int) -> None:
        self._flight.kill(drone)

    def start_again(self, drone: int) -> None:
        self._flight.start_again(drone)

    def set_frozen(self, drone: int, frozen: bool) -> None:
        if frozen:
            self._flight.freeze(drone)
        else:
            self._flight.thaw(drone)

    def set_radio(self, node: int | None, working: bool) -> None:
        name = GROUND if node is None else node
        if node is None:
            self.ground_here = working
        if working:
            self._flight.radio.switch_on(name)
        else:
            self._flight.radio.switch_off(name)

    def set_one_way(self, drone: int, towards: int, heard: bool) -> None:
        if heard:
            self._flight.radio.unblock(drone, towards)
        else:
            self._flight.radio.block(drone, towards)

    def set_parts(self, fault: SwarmFaultSpec, apart: bool) -> None:
        radio = self._flight.radio
        if apart:
            # The first part, with all who are named in none, is what the others are cut from.
            names = self._pieces[fault] = [f"{fault.at_s:g} s: {part}" for part in fault.parts[1:]]
            for name, part in zip(names, fault.parts[1:], strict=True):
                radio.cut(name, part)
        else:
            for name in self._pieces.pop(fault, ()):
                radio.mend(name)

    def set_loss(self, loss: float | None) -> None:
        calm = self._calm
        self.in_burst = loss is not None
        self._flight.radio.conditions = calm if loss is None else dataclasses.replace(calm, loss=loss)

    def advance_clock(self, drone: int, by_s: float) -> None:
        self._flight.members[drone].clock_ahead_s += by_s

    def take_by_pilot(self, drone: int) -> None:
        vehicle = self._flight.members[drone].vehicle
        vehicle.switch_mode(STICKS_MODE[vehicle.spec.flavour])
        self.pilots[drone] = self._flight.now_s

    def pilot_flies(self, drone: int) -> bool:
        """Whether a pilot took the vehicle, and nothing else has taken it from him: no command, no failsafe."""
        vehicle = self._flight.members[drone].vehicle
        return drone in self.pilots and vehicle.custom_mode == STICKS_MODE[vehicle.spec.flavour]

    def command(self, word: CommandWord, drone: int) -> None:
        self._given[self._flight.command(CommandName(word), drone)] = word

    def hear(self, outcome: CommandOutcome) -> None:
        """What a drone made of a command: one that it obeys gives it back from its pilot."""
        obeyed = outcome.result is Result.ACCEPTED and self._given.get(outcome.command, "pause") != "pause"
        if obeyed:
            self.pilots.pop(outcome.sender, None)
