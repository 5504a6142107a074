"""Where the nodes of a simulated flight are, for all its processes: the vehicles' process tells, every node reads."""

from __future__ import annotations

import array
import math
import pathlib
from typing import Final

from flightstack.mapped_numbers import MappedNumbers
from mission.geometry.frames import Vector3

_NOWHERE: Final = (math.nan, math.nan, math.nan)


class NodePlaces(MappedNumbers):
    """North, east and down (m) of one node after the other; who has no place yet is not a number.

    A place may be read while it is written: it is then off by what the node moves between two steps.
    """

    def __init__(self, path: str | pathlib.Path) -> None:
        super().__init__(path, "no places of nodes")

    @staticmethod
    def make(path: pathlib.Path, nodes: int) -> NodePlaces:
        """A new file of nodes without places."""
        path.write_bytes(array.array("d", _NOWHERE * nodes).tobytes())
        return NodePlaces(path)

    def __len__(self) -> int:
        return len(self.values) // len(_NOWHERE)

    def tell(self, node: int, position_ned_m: Vector3) -> None:
        """Where the `node`-th is from now on."""
        for axis, value_m in enumerate(position_ned_m, len(_NOWHERE) * node):
            self.values[axis] = value_m

    def of(self, node: int) -> Vector3 | None:
        """Where the `node`-th was last told to be."""
        north_m, east_m, down_m = self.values[len(_NOWHERE) * node : len(_NOWHERE) * (node + 1)]
        return None if math.isnan(down_m) else (north_m, east_m, down_m)
