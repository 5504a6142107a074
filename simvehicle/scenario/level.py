"""How finely scenarios are simulated: what every level is to the search, and which levels there are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol, TypeAlias

from mission.documents.yaml_values import text_of
from simvehicle.scenario.agent_level import fly_scenario
from simvehicle.scenario.drawn_scenario import draw
from simvehicle.scenario.protocol_level import ProtocolLevel
from simvehicle.scenario.scenario_file import parse_scenario
from simvehicle.scenario.scenario_result import ScenarioResult

Document: TypeAlias = dict[str, Any]
"""A scenario's file as plain data."""


class ScenarioLevel(Protocol):
    def draw(self, seed: int) -> Document:
        """The scenario of a seed: the same for the same seed."""
        ...

    def run(self, document: Document) -> ScenarioResult:
        """`DocumentError` for what is no scenario."""
        ...

    def run_text(self, text: str, file: str) -> ScenarioResult:
        """The same from the text of a file, which stands in the errors."""
        ...


class AgentLevel:
    """Whole agents with simulated autopilots of both flavours."""

    def draw(self, seed: int) -> Document:
        return draw(seed)

    def run(self, document: Document) -> ScenarioResult:
        return self.run_text(text_of(document), "drawn scenario")

    def run_text(self, text: str, file: str) -> ScenarioResult:
        return fly_scenario(parse_scenario(text, file))


LEVELS: Final[dict[str, Callable[[], ScenarioLevel]]] = {"agent": AgentLevel, "protocol": ProtocolLevel}
"""By the names of `simvehicle scenario search --level`."""
