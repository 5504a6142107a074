"""The smallest scenario that still fails as a given one does: faults left out, drones left out, times rounded."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any, Final

from mission.documents.yaml_file import DocumentError

_LISTS: Final = ("faults", "swarm_faults")
_FEWEST: Final = 2
"""Drones; what a single one does is not the swarm's matter."""


def shrunk(
    document: dict[str, Any], fails: Callable[[dict[str, Any]], bool], *, tries: int = 60
) -> dict[str, Any]:
    """Reduce while `fails` says that the same kind of violation is left, at most `tries` times asked."""
    smallest = document
    progress = True
    while progress:
        progress = False
        for candidate in _smaller(smallest):
            if tries <= 0:
                return smallest
            tries -= 1
            try:
                failing = fails(candidate)
            except DocumentError:  # it left out what another part of it needs
                continue
            if failing:
                smallest, progress = candidate, True
                break
    return smallest


def _smaller(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Documents with less in them, those that leave out most first."""
    for name in _LISTS:
        faults = document.get(name, [])
        if len(faults) > 1:
            yield {**copy.deepcopy(document), name: faults[: len(faults) // 2]}
            yield {**copy.deepcopy(document), name: faults[len(faults) // 2 :]}
        for index in range(len(faults)):
            yield {**copy.deepcopy(document), name: [*faults[:index], *faults[index + 1 :]]}
    count = document["launch_line"]["count"]
    named = [drone for name in _LISTS for fault in document.get(name, []) for drone in _named(fault)]
    for fewer in sorted({max(_FEWEST, *named, (count + 1) // 2), count - 1}):
        if max([_FEWEST, *named]) <= fewer < count:
            yield {**document, "launch_line": {**document["launch_line"], "count": fewer}}
    if document.get("radio", {}).get("loss"):
        yield {**document, "radio": {}}
    rounded = copy.deepcopy(document)
    for name in _LISTS:
        for fault in rounded.get(name, []):
            for field in ("at_s", "until_s"):
                if field in fault:
                    fault[field] = float(round(fault[field]))
    if rounded != document:
        yield rounded


def _named(fault: dict[str, Any]) -> list[int]:
    """The drones that a fault cannot do without."""
    return [fault[field] for field in ("drone", "towards") if field in fault] + [
        drone for part in fault.get("parts", []) for drone in part
    ]
