"""Scenarios of the swarm's protocol alone: the drones' own swarm code, kinematic drones, the in-process radio.

A file says less than one for whole agents: how many drones, their formation's spacing, the radio, and what goes
wrong. Times count from the beginning, when everybody is in the air and in its slot.
"""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta

from flightstack.config import Section
from flightstack.swarm.wire import Phase
from flightstack.transport.radio_model import RadioModel
from mission.documents.yaml_file import DocumentError, line_of, parse
from simvehicle.faults.fault_table import SwarmFaultSpec
from simvehicle.faults.schedule import SwarmFaultSchedule
from simvehicle.scenario.kinematic_swarm import KinematicSwarm
from simvehicle.scenario.scenario_file import swarm_fault_problems
from simvehicle.scenario.scenario_result import ScenarioResult
from simvehicle.scenario.table_invariants import AGREED_WITHIN_S, TableInvariants, words
from simvehicle.scenario.transcript import Transcript

WATCHED_S: Final = 4.0
"""How long the swarm is watched after it must have agreed."""


class KinematicLine(Section, frozen=True, kw_only=True):
    count: Annotated[int, Meta(ge=1, le=255)]


class KinematicFormation(Section, frozen=True, kw_only=True):
    spacing_m: Annotated[float, Meta(gt=0.0)] = 10.0


class ProtocolScenario(Section, frozen=True, kw_only=True):
    """A scenario's file at this level."""

    name: str
    launch_line: KinematicLine
    formation: KinematicFormation = KinematicFormation()
    radio: RadioModel = RadioModel()
    seed: int = 0
    swarm_faults: tuple[SwarmFaultSpec, ...] = ()

    @property
    def last_fault_s(self) -> float:
        return max((fault.until_s or fault.at_s for fault in self.swarm_faults), default=0.0)


def parse_protocol_scenario(text: str, file: str) -> ProtocolScenario:
    """Read and check a scenario's file; `DocumentError` says in one line what is wrong, where, how to mend it."""
    scenario = parse(text, ProtocolScenario, file)
    for place, problem in _problems(scenario):
        raise DocumentError(file, problem, line=line_of(text, place), field=place)
    return scenario


def fly_protocol(scenario: ProtocolScenario) -> ScenarioResult:
    """Fly it until the swarm has been watched for a while after its last fault."""
    swarm = KinematicSwarm(
        scenario.launch_line.count, scenario.formation.spacing_m, scenario.radio, scenario.seed
    )
    faults = SwarmFaultSchedule(scenario.swarm_faults)
    invariants = TableInvariants(swarm)
    transcript = Transcript()
    told: dict[int, Mapping[int, int]] = {}
    phases: dict[int, Phase] = {}
    said: set[str] = set()
    ends_s = scenario.last_fault_s + AGREED_WITHIN_S + WATCHED_S
    while swarm.now_s < ends_s:
        transcript.at(swarm.now_s)
        for begins, fault in faults.strike(swarm.now_s, swarm):
            transcript.fault(begins, fault)
        swarm.step()
        for number, member in swarm.members.items():
            slots, phase = member.drone.table.slots, member.drone.phase
            if phases.get(number) is not phase:
                phases[number] = phase
                transcript.phase(number, phase)
            if told.get(number) is not slots:
                told[number] = slots
                if (text := words(slots)) not in said:
                    said.add(text)
                    transcript.say(f"table of drone {number}: {text}")
        invariants.look()
    for violation in invariants.violations:
        transcript.say(f"VIOLATION {violation.kind} at {violation.at_s:g} s: {violation.text}")
    return ScenarioResult(invariants.violations, transcript.lines, {"simulated_s": round(swarm.now_s, 1)})


class ProtocolLevel:
    """The swarm's protocol alone, with kinematic drones."""

    def draw(self, seed: int) -> dict[str, Any]:
        return _Draw(seed).document()

    def run(self, document: dict[str, Any]) -> ScenarioResult:
        try:
            scenario = msgspec.convert(document, ProtocolScenario)
        except msgspec.ValidationError as error:
            raise DocumentError("drawn scenario", str(error)) from error
        for place, problem in _problems(scenario):
            raise DocumentError("drawn scenario", problem, field=place)
        return fly_protocol(scenario)

    def run_text(self, text: str, file: str) -> ScenarioResult:
        return fly_protocol(parse_protocol_scenario(text, file))


def _problems(scenario: ProtocolScenario) -> list[tuple[str, str]]:
    """(field, what is wrong with it)."""
    drones = list(range(1, scenario.launch_line.count + 1))
    return [
        (f"swarm_faults[{index}].{field}", problem)
        for index, fault in enumerate(scenario.swarm_faults)
        for field, problem in swarm_fault_problems(fault, drones)
    ]


_FEWEST, _MOST = 5, 20
_FAULTS: Final = (1, 2, 2, 3, 3, 4, 5, 6)
_FIRST_BEGINS_S: Final = 1.0
_LAST_BEGINS_S: Final = 12.0
_LONGEST_FAULT_S: Final = 10.0


class _Draw:
    def __init__(self, seed: int) -> None:
        self._random = random.Random(f"protocol scenario {seed}")
        self.count = self._random.randint(_FEWEST, _MOST)
        self.drones = list(range(1, self.count + 1))
        self.seed = seed

    def document(self) -> dict[str, Any]:
        rng = self._random
        kinds = sorted(_KINDS)
        faults = [self._fault(rng.choice(kinds)) for _ in range(rng.choice(_FAULTS))]
        radio = {
            "loss": rng.choice((0.0, 0.0, 0.05, 0.1, 0.2, 0.3)),
            "delay_s": rng.choice((0.0, 0.0, 0.02, 0.08)),
            "jitter_s": rng.choice((0.0, 0.0, 0.02)),
            "duplication": rng.choice((0.0, 0.0, 0.1)),
            "reordering": rng.choice((0.0, 0.0, 0.1)),
        }
        return {
            "name": f"protocol-{self.seed}",
            "launch_line": {"count": self.count},
            "radio": {name: value for name, value in radio.items() if value},
            "seed": self.seed,
            "swarm_faults": sorted(itertools.chain(*faults), key=lambda fault: float(fault["at_s"])),
        }

    def _fault(self, kind: str) -> list[dict[str, Any]]:
        at_s = round(self._random.uniform(_FIRST_BEGINS_S, _LAST_BEGINS_S), 1)
        drawn = _KINDS[kind](self)
        for fault in drawn:
            fault["at_s"] = at_s
            if "until_s" in fault:
                fault["until_s"] = round(at_s + fault["until_s"], 1)
        return drawn

    def one(self, kind: str) -> list[dict[str, Any]]:
        return [{"kind": kind, "drone": self._random.choice(self.drones)}]

    def a_while(self, kind: str) -> list[dict[str, Any]]:
        """`until_s` is counted from the fault's beginning until `_fault` knows that."""
        return [{**self.one(kind)[0], "until_s": self._random.uniform(0.3, _LONGEST_FAULT_S)}]

    def several(self) -> list[dict[str, Any]]:
        """At one moment, up to all but one: half of the swarm, a branch, the root and its heir."""
        fewest = 2 if self.count > 2 else 1
        most = max(fewest, self._random.choice((3, self.count // 2, self.count - 1)))
        victims = self._random.sample(self.drones, self._random.randint(fewest, most))
        return [{"kind": "kill", "drone": drone} for drone in sorted(victims)]

    def one_way(self) -> list[dict[str, Any]]:
        drone, towards = self._random.sample(self.drones, 2)
        until_s = self._random.uniform(0.3, _LONGEST_FAULT_S)
        return [{"kind": "one_way", "drone": drone, "towards": towards, "until_s": until_s}]

    def partition(self) -> list[dict[str, Any]]:
        order = self._random.sample(self.drones, self.count)
        cuts = sorted(self._random.sample(range(1, self.count), self._random.choice((1, 2))))
        parts = [sorted(order[a:b]) for a, b in itertools.pairwise([0, *cuts, self.count])]
        return [
            {"kind": "partition", "parts": parts, "until_s": self._random.uniform(0.3, 2 * _LONGEST_FAULT_S)}
        ]

    def burst(self) -> list[dict[str, Any]]:
        loss = self._random.choice((0.5, 0.8, 0.95))
        return [{"kind": "loss", "loss": loss, "until_s": self._random.uniform(0.3, _LONGEST_FAULT_S)}]

    def jump(self) -> list[dict[str, Any]]:
        return [{**self.one("clock_jump")[0], "by_s": round(self._random.uniform(0.2, 30.0), 1)}]

    def departure(self) -> list[dict[str, Any]]:
        return [{**self.one("command")[0], "command": self._random.choice(("rtl", "land"))}]


_KINDS: Final[dict[str, Callable[[_Draw], list[dict[str, Any]]]]] = {
    "kill": lambda draw: draw.one("kill"),
    "kill several": _Draw.several,
    "freeze": lambda draw: draw.a_while("freeze"),
    "reboot": lambda draw: draw.a_while("reboot"),
    "radio_dead": lambda draw: draw.a_while("radio_dead"),
    "one_way": _Draw.one_way,
    "partition": _Draw.partition,
    "loss": _Draw.burst,
    "clock_jump": _Draw.jump,
    "pilot": lambda draw: draw.one("pilot"),
    "departure": _Draw.departure,
}
