"""What is done on purpose to the agents' processes of a survey: `kill -9`, and SIGSTOP until SIGCONT."""

from __future__ import annotations

import re
from collections.abc import Iterable

import msgspec

from mission.documents.yaml_file import DocumentError


class Kill(msgspec.Struct, frozen=True):
    """kill -9 of a drone's agent, `at_s` simulated seconds after the first take-off."""

    drone: int
    at_s: float


class Freeze(msgspec.Struct, frozen=True):
    """A drone's agent stands still from `at_s` to `until_s`, simulated seconds after the first take-off."""

    drone: int
    at_s: float
    until_s: float | None = None
    """None: to the end."""


def parse_kill(text: str) -> Kill:
    """A kill as the command line says it: "3@60"."""
    return Kill(*_drone_and_time("--kill", text))


def parse_freezes(freezes: Iterable[str], unfreezes: Iterable[str]) -> tuple[Freeze, ...]:
    """Freezes as the command line says them, "6@90" and "6@130": each lasts until the drone's next unfreeze.

    `DocumentError` where they do not alternate.
    """
    begins = {_drone_and_time("--freeze", text) for text in freezes}
    ends = {_drone_and_time("--unfreeze", text) for text in unfreezes}
    marks = sorted([(*begin, True) for begin in begins] + [(*end, False) for end in ends])
    found: list[Freeze] = []
    since: tuple[int, float] | None = None
    for drone, at_s, begin in marks:
        frozen = since is not None and since[0] == drone
        if begin and frozen:
            raise DocumentError(
                f"--freeze {drone}@{at_s:g}", "it is frozen at that time already: --unfreeze it before"
            )
        if not begin and not (frozen and since is not None and at_s > since[1]):
            raise DocumentError(
                f"--unfreeze {drone}@{at_s:g}", f"nothing froze it before: add --freeze {drone}@SECONDS"
            )
        if begin:
            if since is not None:
                found.append(Freeze(*since))
            since = (drone, at_s)
        elif since is not None:
            found.append(Freeze(*since, until_s=at_s))
            since = None
    if since is not None:
        found.append(Freeze(*since))
    return tuple(found)


def check_drones(drones: Iterable[int], kills: Iterable[Kill], freezes: Iterable[Freeze]) -> None:
    """`DocumentError` for a fault of a drone that is not there."""
    ids = list(drones)
    given = [("--kill", kill.drone, kill.at_s) for kill in kills]
    given += [("--freeze", freeze.drone, freeze.at_s) for freeze in freezes]
    for option, drone, at_s in given:
        if drone not in ids:
            raise DocumentError(f"{option} {drone}@{at_s:g}", f"there is no drone {drone}, but {ids}")


def _drone_and_time(option: str, text: str) -> tuple[int, float]:
    match = re.fullmatch(r"(\d+)@(\d+(?:\.\d+)?)", text, re.ASCII)
    if match is None:
        raise DocumentError(f"{option} {text}", "write DRONE@SECONDS, such as 3@60")
    return int(match[1]), float(match[2])
