"""The smallest scenario that still fails as a given one does: fewer and shorter faults, fewer drones, round times."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from typing import Any, Final

from mission.documents.yaml_file import DocumentError

_LISTS: Final = ("faults", "swarm_faults")
_SHORTEST_S: Final = 1.0
"""Shorter faults are not halved."""
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
    yield from _with_less_of_a_fault(document, named)
    if document.get("radio", {}).get("loss"):
        yield {**document, "radio": {}}
    rounded = copy.deepcopy(document)
    for name in _LISTS:
        for fault in rounded.get(name, []):
            for field in ("at_s", "until_s"):
                if field in fault:
                    fault[field] = float(round(fault[field]))
            if fault.get("until_s", math.inf) <= fault["at_s"]:
                fault["until_s"] = fault["at_s"] + 1.0
    if rounded != document:
        yield rounded


def _with_less_of_a_fault(document: dict[str, Any], named: list[int]) -> Iterator[dict[str, Any]]:
    """As many faults, for the drones with the lowest numbers, for fewer drones, or shorter."""
    numbers = {drone: number for number, drone in enumerate(sorted(set(named)), 1)}
    if any(drone != number for drone, number in numbers.items()):
        yield _renumbered(document, numbers)
    for index, fault in enumerate(document.get("swarm_faults", [])):
        yield from (_with(document, "swarm_faults", index, parts=parts) for parts in _fewer_apart(fault))
    for name in _LISTS:
        for index, fault in enumerate(document.get(name, [])):
            lasts_s = fault.get("until_s", fault["at_s"]) - fault["at_s"]
            if lasts_s >= _SHORTEST_S:
                yield _with(document, name, index, until_s=round(fault["at_s"] + 0.5 * lasts_s, 1))


def _with(document: dict[str, Any], name: str, index: int, **changed: Any) -> dict[str, Any]:
    """The document with one fault changed."""
    smaller = copy.deepcopy(document)
    smaller[name][index].update(changed)
    return smaller


def _fewer_apart(fault: dict[str, Any]) -> Iterator[list[list[int]]]:
    """Parts of a partition with a drone less in them: who is named in none is in the first."""
    parts: list[list[int]] = fault.get("parts", [])
    for part in parts:
        for drone in part if len(part) > 1 else ():
            yield [[other for other in each if other != drone] for each in parts]
    if len(parts) > 2:
        yield from ([part for part in parts if part is not left_out] for left_out in parts)


def _renumbered(document: dict[str, Any], numbers: dict[int, int]) -> dict[str, Any]:
    """The named drones in the same order with the lowest numbers: they stand nearer to each other."""
    smaller = copy.deepcopy(document)
    for fault in (fault for name in _LISTS for fault in smaller.get(name, [])):
        fault.update({field: numbers[fault[field]] for field in ("drone", "towards") if field in fault})
        if "parts" in fault:
            fault["parts"] = [sorted(numbers[drone] for drone in part) for part in fault["parts"]]
    return smaller


def _named(fault: dict[str, Any]) -> list[int]:
    """The drones that a fault cannot do without."""
    return [fault[field] for field in ("drone", "towards") if field in fault] + [
        drone for part in fault.get("parts", []) for drone in part
    ]
