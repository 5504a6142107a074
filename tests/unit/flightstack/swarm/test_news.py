"""An autopilot's texts as notes: each once."""

from __future__ import annotations

import pytest

from flightstack.mavlink.statustext import StatusText
from flightstack.swarm.news import REPEATED_S, TextNotes, TreeNews, tree_notes
from flightstack.swarm.wire import Severity
from mission.strategies.contract import Order, Stage

PREARM = StatusText(2, "PreArm: Need Position Estimate")


def test_what_keeps_it_on_the_ground_is_told_once_in_a_while_however_often_it_comes() -> None:
    notes = TextNotes()
    told = [note.text for tick in range(20) for note in notes.notes(30.0 * tick, [PREARM])]
    assert told == [PREARM.text] * 2
    assert REPEATED_S == 300.0
    assert [n.text for n in notes.notes(601.0, [StatusText(2, "PreArm: Battery failsafe")])] != []


@pytest.mark.parametrize("text", ["Polygon fence breached", "Potential Thrust Loss (1)", "Battery Failsafe"])
def test_what_happens_again_is_told_again(text: str) -> None:
    notes = TextNotes()
    assert len([note for at in range(3) for note in notes.notes(float(at), [StatusText(2, text)])]) == 3


def test_severities_are_ours() -> None:
    texts = [StatusText(severity, f"severity {severity}") for severity in range(8)]
    got = [note.severity for note in TextNotes().notes(1.0, texts)]
    assert got == [Severity.CRITICAL] * 3 + [Severity.WARNING] * 2 + [Severity.INFO] * 3


def test_a_source_is_told_with_how_well_it_is_known_where_that_is_said() -> None:
    source = (12.34, -5.0, -20.0)
    found = Order(3, Stage.FOUND, source, 0.0, source)
    (plain,) = tree_notes(TreeNews(order=found), {})
    assert plain.text == "source at 12.3 m north, -5.0 m east, 20.0 m up"
    (told,) = tree_notes(TreeNews(order=Order(3, Stage.FOUND, source, 0.0, source, source_sd_m=3.21)), {})
    assert told.text == f"{plain.text}, known to 3.2 m (standard deviation)"
