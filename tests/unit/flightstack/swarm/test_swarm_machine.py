"""Whatever befalls a swarm in whatever order, its tables come together: a search by property-based state machine.

Loss, duplication and reordering are the radio's; crash and restart, freezing, partitions, one-way links and clocks
that jump are rules. The invariants of the protocol level are looked at in every tick.
"""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from flightstack.transport.radio_model import RadioModel
from simvehicle.faults.fault_table import SwarmFaultSpec
from simvehicle.scenario.kinematic_swarm import KinematicSwarm
from simvehicle.scenario.table_invariants import AGREED_WITHIN_S, TableInvariants

MOST = 8
DRONES = st.integers(1, MOST)
APART = "apart"


class SwarmMachine(RuleBasedStateMachine):
    swarm: KinematicSwarm
    table_invariants: TableInvariants
    apart: SwarmFaultSpec | None = None

    @initialize(
        count=st.integers(2, MOST),
        loss=st.sampled_from((0.0, 0.1, 0.3)),
        duplication=st.sampled_from((0.0, 0.2)),
        reordering=st.sampled_from((0.0, 0.2)),
        delay_s=st.sampled_from((0.0, 0.05)),
        seed=st.integers(0, 1000),
    )
    def begin(
        self, count: int, loss: float, duplication: float, reordering: float, delay_s: float, seed: int
    ) -> None:
        radio = RadioModel(loss=loss, duplication=duplication, reordering=reordering, delay_s=delay_s)
        self.swarm = KinematicSwarm(count, 10.0, radio, seed)
        self.table_invariants = TableInvariants(self.swarm)
        self.one_way: set[tuple[int, int]] = set()
        self.pass_time(1.0)

    def one(self, drone: int) -> int:
        """A drone that there is."""
        return 1 + (drone - 1) % len(self.swarm.ids)

    @rule(seconds=st.sampled_from((0.1, 0.3, 0.7, 1.5, 4.0, 11.0)))
    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.swarm.step()
            self.table_invariants.look()
        assert self.table_invariants.violations == ()

    @precondition(lambda self: sum(m.alive for m in self.swarm.members.values()) > 1)
    @rule(drone=DRONES)
    def crash(self, drone: int) -> None:
        self.swarm.kill(self.one(drone))

    @rule(drone=DRONES)
    def restart(self, drone: int) -> None:
        self.swarm.start_again(self.one(drone))

    @rule(drone=DRONES, frozen=st.booleans())
    def freeze_or_thaw(self, drone: int, frozen: bool) -> None:
        self.swarm.set_frozen(self.one(drone), frozen)

    @rule(drone=DRONES, working=st.booleans())
    def switch_radio(self, drone: int, working: bool) -> None:
        self.swarm.set_radio(self.one(drone), working)

    @rule(drone=DRONES, towards=DRONES, heard=st.booleans())
    def turn_deaf(self, drone: int, towards: int, heard: bool) -> None:
        if self.one(drone) != self.one(towards):
            self.one_way.add((self.one(drone), self.one(towards)))
            self.swarm.set_one_way(self.one(drone), self.one(towards), heard)

    @rule(numbers=st.sets(DRONES, min_size=1, max_size=MOST - 1))
    def part(self, numbers: set[int]) -> None:
        some = {self.one(drone) for drone in numbers}
        others = set(self.swarm.ids) - some
        if others and self.apart is None:
            self.apart = SwarmFaultSpec(
                kind="partition", at_s=self.swarm.now_s, parts=(tuple(sorted(others)), tuple(sorted(some)))
            )
            self.swarm.set_parts(self.apart, True)

    @rule()
    def meet_again(self) -> None:
        if self.apart is not None:
            self.swarm.set_parts(self.apart, False)
            self.apart = None

    @rule(drone=DRONES, by_s=st.sampled_from((0.3, 1.0, 5.0)))
    def jump(self, drone: int, by_s: float) -> None:
        self.swarm.advance_clock(self.one(drone), by_s)

    def teardown(self) -> None:
        """Everything is mended: then all that live have one table, and go on."""
        if not hasattr(self, "swarm"):
            return
        self.meet_again()
        for drone in self.swarm.ids:
            self.swarm.set_frozen(drone, False)
            self.swarm.set_radio(drone, True)
        for drone, towards in self.one_way:
            self.swarm.set_one_way(drone, towards, True)
        self.pass_time(AGREED_WITHIN_S + 3.0)


class LongSwarmMachine(SwarmMachine):
    """The same with more examples."""


TestSwarm = SwarmMachine.TestCase
TestSwarm.settings = settings(max_examples=8, stateful_step_count=12, deadline=None)
TestSwarmForLong = pytest.mark.long(LongSwarmMachine.TestCase)
TestSwarmForLong.settings = settings(max_examples=1000, stateful_step_count=30, deadline=None)
