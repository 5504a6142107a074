"""From points in a file to a fence: what all formats that know nothing but areas have in common."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from mission.documents.flight_plan import Plan
from mission.documents.yaml_file import DocumentError
from mission.geometry.geofence import Geofence, Vertex

_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?", re.ASCII)
"""A decimal number, and none of the other things that Python takes for one."""
_LARGEST: Final = 1e15
NO_HEIGHTS: Final = (
    "the altitudes of its areas are not taken over: a fence stands from the ground to the ceiling"
)


def number(text: str) -> float | str:
    """The number that a text file holds; the text itself where it is none, for `vertex` to refuse."""
    return float(text) if _NUMBER.fullmatch(text) else text


def vertex(latitude: object, longitude: object, file: str, where: str, *, line: int | None = None) -> Vertex:
    """A vertex from two numbers; `DocumentError` for what is none, or no place on earth."""
    place = []
    for name, given, most in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
        if not isinstance(given, int | float) or isinstance(given, bool):
            raise DocumentError(
                file, f"{where}: its {name} is {given!r}; write a number of degrees", line=line
            )
        if not abs(given) <= most:
            shown = f"{given:g}" if not abs(given) > _LARGEST else "a far too large number"
            raise DocumentError(
                file, f"{where}: {name} {shown} is not within -{most:g} to {most:g} degrees", line=line
            )
        place.append(float(given))
    return place[0], place[1]


def height(given: object, file: str, where: str) -> float:
    """The altitude of a vertex, of which it only matters whether it has one."""
    if not isinstance(given, int | float) or isinstance(given, bool):
        raise DocumentError(
            file, f"{where}: its altitude is {given!r}; write a number of metres, or leave it out"
        )
    return float(given)


def ring(vertices: Sequence[Vertex]) -> tuple[Vertex, ...]:
    """A polygon without the vertex that closes it again, which autopilots would take for one more."""
    count = len(vertices)
    while count > 1 and vertices[count - 1] == vertices[0]:
        count -= 1
    return tuple(vertices[:count])


def fence_plan(
    inclusion: Sequence[Sequence[Vertex]],
    exclusion: Sequence[Sequence[Vertex]],
    warnings: Sequence[str],
    file: str,
    nothing: str,
) -> Plan:
    """A plan that is a fence and nothing else. `nothing` completes "there is ..." where there is no area."""
    if not inclusion and not exclusion:
        raise DocumentError(file, f"there is {nothing}")
    fence = Geofence(tuple(map(ring, inclusion)), tuple(map(ring, exclusion)))
    return Plan(geofence=fence, holds=("fence",), warnings=tuple(warnings))
