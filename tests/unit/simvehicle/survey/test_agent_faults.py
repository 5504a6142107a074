"""Kills and freezes as the command line says them."""

from __future__ import annotations

import pytest

from mission.documents.yaml_file import DocumentError
from simvehicle.survey.agent_faults import Freeze, Kill, check_drones, parse_freezes, parse_kill


def test_kills_from_the_command_line() -> None:
    kill = parse_kill("3@60")
    assert (kill.drone, kill.at_s) == (3, 60.0)
    with pytest.raises(DocumentError, match="DRONE@SECONDS"):
        parse_kill("3")


def test_a_freeze_lasts_until_the_next_unfreeze_of_its_drone() -> None:
    assert parse_freezes(["6@90", "2@10", "6@200"], ["6@130.5", "2@200"]) == (
        Freeze(2, 10.0, 200.0),
        Freeze(6, 90.0, 130.5),
        Freeze(6, 200.0, None),
    )
    assert parse_freezes(["6@90", "6@130"], ["6@130", "6@140"]) == (
        Freeze(6, 90.0, 130.0),
        Freeze(6, 130.0, 140.0),
    )
    assert parse_freezes([], []) == ()


@pytest.mark.parametrize(
    ("freezes", "unfreezes", "problem"),
    [
        ([], ["6@130"], r"^--unfreeze 6@130: nothing froze it before"),
        (["5@90"], ["6@130"], r"^--unfreeze 6@130: nothing froze it before"),
        (["6@90"], ["6@90"], r"^--unfreeze 6@90: nothing froze it before"),
        (["6@90", "6@100"], ["6@130"], r"^--freeze 6@100: it is frozen at that time already"),
        (["six@90"], [], r"^--freeze six@90: write DRONE@SECONDS"),
        (["6@90"], ["6"], r"^--unfreeze 6: write DRONE@SECONDS"),
    ],
)
def test_freezes_that_do_not_fit_are_named(freezes: list[str], unfreezes: list[str], problem: str) -> None:
    with pytest.raises(DocumentError, match=problem):
        parse_freezes(freezes, unfreezes)


def test_a_drone_that_is_not_there_is_named() -> None:
    check_drones([1, 2], [Kill(1, 5.0)], [Freeze(2, 5.0)])
    with pytest.raises(DocumentError, match=r"^--kill 9@5: there is no drone 9, but \[1, 2\]"):
        check_drones([1, 2], [Kill(9, 5.0)], [])
    with pytest.raises(DocumentError, match=r"^--freeze 9@5: there is no drone 9"):
        check_drones([1, 2], [], [Freeze(9, 5.0)])
