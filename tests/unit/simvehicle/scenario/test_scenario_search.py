"""The search's own parts: what is drawn, how a failing scenario shrinks, what the store keeps. Flights stand in
tests/scenario."""

from __future__ import annotations

import pathlib
from typing import Any

import pytest

from mission.documents.yaml_file import DocumentError
from mission.documents.yaml_values import text_of
from simvehicle.faults.fault_table import FAULTS, SWARM_FAULTS
from simvehicle.scenario.drawn_scenario import draw
from simvehicle.scenario.scenario_file import parse_scenario
from simvehicle.scenario.scenario_result import Violation
from simvehicle.scenario.search import ResultStore, SeedResult, sources_identity, summarized
from simvehicle.scenario.shrinking import shrunk

ENDLESS = {"kill", "pilot", "command", "clock_jump"}
NEAR = (Violation("separation", 12.0, "drones 1 and 2: 3.0 m apart"),)


def test_every_drawn_scenario_can_be_flown_and_every_fault_is_drawn() -> None:
    kinds: set[str] = set()
    for seed in range(200):
        scenario = parse_scenario(text_of(draw(seed)), f"seed {seed}")
        assert 5 <= len(scenario.survey.drones) <= 10
        kinds |= {fault.kind for fault in scenario.config.faults}
        kinds |= {fault.kind for fault in scenario.config.swarm_faults}
        assert scenario.config.faults or scenario.config.swarm_faults
    of_range_finders = {"range_silent", "range_lying"}  # which drawn drones do not carry
    assert kinds == {*FAULTS, *SWARM_FAULTS} - of_range_finders


def test_a_seed_is_one_scenario() -> None:
    assert draw(7) == draw(7)
    assert draw(7) != draw(8)


def test_nothing_drawn_waits_for_an_operator_for_ever() -> None:
    paused = 0
    for seed in range(200):
        faults = draw(seed)["swarm_faults"]
        last_s = max([fault.get("until_s", fault["at_s"]) for fault in (*faults, *draw(seed)["faults"])])
        if any(fault.get("command") == "pause" for fault in faults):
            paused += 1
            assert any(fault.get("command") == "resume" and fault["at_s"] == last_s for fault in faults)
        for fault in faults:
            assert fault["kind"] in ENDLESS or "until_s" in fault
    assert paused


def document(*kinds: str) -> dict[str, Any]:
    faults = [{"kind": kind, "drone": 3, "at_s": 10.4 + n} for n, kind in enumerate(kinds)]
    return {**draw(1), "faults": [], "swarm_faults": faults}


def test_a_failing_scenario_shrinks_to_what_makes_it_fail() -> None:
    def fails(candidate: dict[str, Any]) -> bool:
        return {"kill", "pilot"} <= {fault["kind"] for fault in candidate["swarm_faults"]}

    small = shrunk(document("freeze", "kill", "radio_dead", "pilot", "kill"), fails)
    assert sorted(fault["kind"] for fault in small["swarm_faults"]) == ["kill", "pilot"]
    assert {fault["drone"] for fault in small["swarm_faults"]} == {1}, "the same drone, of as few as can be"
    assert small["launch_line"]["count"] == 2
    assert all(fault["at_s"] == int(fault["at_s"]) for fault in small["swarm_faults"])
    parse_scenario(text_of(small), "small")


def test_a_partition_shrinks_to_those_whom_it_takes_apart_and_its_time() -> None:
    apart = {"kind": "partition", "parts": [[1, 2], [3, 4, 7], [5, 6]], "at_s": 10.0, "until_s": 42.0}
    drawn = {**draw(1), "faults": [], "swarm_faults": [apart]}

    def fails(candidate: dict[str, Any]) -> bool:
        if not candidate["swarm_faults"]:
            return False
        (fault,) = candidate["swarm_faults"]
        last = candidate["launch_line"]["count"] > 2 and fault["until_s"] - fault["at_s"] > 7.0
        return last and all(fault["parts"]) and len(fault["parts"]) > 1

    (small,) = shrunk(drawn, fails)["swarm_faults"]
    assert sorted(small["parts"]) == [[1], [2]]
    assert small["until_s"] == 18.0


def test_a_short_fault_still_ends_after_it_begins_when_its_times_are_rounded() -> None:
    short = {"kind": "freeze", "drone": 1, "at_s": 80.9, "until_s": 81.4}
    drawn = {**draw(1), "faults": [], "swarm_faults": [short]}
    small = shrunk(drawn, lambda candidate: bool(candidate["swarm_faults"]))
    assert [(fault["at_s"], fault["until_s"]) for fault in small["swarm_faults"]] == [(81.0, 82.0)]
    parse_scenario(text_of(small), "small")


def test_what_cannot_be_made_smaller_stays_as_it_is_and_is_not_changed_on_the_way() -> None:
    before = document("kill", "pilot")
    kept = text_of(before)
    assert shrunk(before, lambda candidate: text_of(candidate) == kept) is before
    assert text_of(before) == kept


def test_shrinking_ends_after_its_tries() -> None:
    asked = []
    shrunk(document("kill", "pilot"), lambda candidate: bool(asked.append(candidate)), tries=3)
    assert len(asked) == 3


def test_the_store_goes_on_from_what_it_has_and_forgets_other_code(tmp_path: pathlib.Path) -> None:
    store = ResultStore(tmp_path / "out", "agent", "code-1")
    store.add(SeedResult("agent", "code-1", 4, NEAR, 2.0))
    store.add(SeedResult("agent", "code-1", 3, (), 1.5))
    store.close()
    again = ResultStore(tmp_path / "out", "agent", "code-1")
    again.close()
    assert sorted(again.known) == [3, 4]
    assert again.known[4].violations == NEAR
    other = ResultStore(tmp_path / "out", "agent", "code-2")
    other.close()
    assert other.known == {}


def test_a_line_that_a_killed_search_left_unfinished_is_flown_again(tmp_path: pathlib.Path) -> None:
    store = ResultStore(tmp_path, "agent", "code")
    store.add(SeedResult("agent", "code", 1, (), 1.0))
    store.close()
    with (tmp_path / "agent.jsonl").open("ab") as file:
        file.write(b'{"level":"ag')
    broken = ResultStore(tmp_path, "agent", "code")
    broken.add(SeedResult("agent", "code", 2, (), 1.0))
    broken.close()
    whole = ResultStore(tmp_path, "agent", "code")
    whole.close()
    assert sorted(whole.known) == [1, 2]


def test_a_store_that_is_none_is_told_in_one_line(tmp_path: pathlib.Path) -> None:
    (tmp_path / "agent.jsonl").write_text("nonsense\n{}\n")
    with pytest.raises(DocumentError, match=r"agent\.jsonl:1: is no result of a search; remove the line"):
        ResultStore(tmp_path, "agent", "code")
    (tmp_path / "file").write_text("")
    with pytest.raises(DocumentError, match=r"give another --out"):
        ResultStore(tmp_path / "file", "agent", "code")


def test_a_summary_counts_scenarios_by_kind() -> None:
    results = [
        SeedResult("agent", "c", 2, (*NEAR, Violation("separation", 13.0, "drones 1 and 3")), 2.0),
        SeedResult("agent", "c", 0, (), 1.0),
        SeedResult("agent", "c", 1, NEAR, 1.5),
    ]
    summary = summarized("agent", results, 3.0)
    assert summary.violations == {"separation": 2}
    assert summary.failing_seeds == (1, 2)
    assert (summary.seeds, summary.core_s) == (3, 4.5)


def test_the_sources_have_one_name() -> None:
    assert sources_identity() == sources_identity()
    assert len(sources_identity()) == 16
