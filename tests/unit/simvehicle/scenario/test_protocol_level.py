"""The protocol's own scenarios: what is drawn, what holds, and that a swarm which goes wrong is found out."""

from __future__ import annotations

from typing import Any

import pytest

from flightstack.transport.radio_model import RadioModel
from mission.documents.yaml_file import DocumentError
from mission.documents.yaml_values import text_of
from simvehicle.faults.fault_table import SWARM_FAULTS
from simvehicle.scenario.kinematic_drone import KinematicDrone
from simvehicle.scenario.kinematic_swarm import KinematicSwarm
from simvehicle.scenario.protocol_level import ProtocolLevel, parse_protocol_scenario
from simvehicle.scenario.scenario_result import ScenarioResult

NOT_OF_THE_PROTOCOL = {"ground_gone"}
"""There is no ground station."""


def document(count: int, *faults: dict[str, Any], loss: float = 0.0) -> dict[str, Any]:
    return {
        "name": "told",
        "launch_line": {"count": count},
        "radio": {"loss": loss} if loss else {},
        "seed": 3,
        "swarm_faults": list(faults),
    }


def flown(count: int, *faults: dict[str, Any], loss: float = 0.0) -> ScenarioResult:
    return ProtocolLevel().run(document(count, *faults, loss=loss))


def kinds(result: ScenarioResult) -> set[str]:
    return {violation.kind for violation in result.violations}


def test_every_drawn_scenario_can_be_flown_and_every_fault_is_drawn() -> None:
    drawn: set[str] = set()
    for seed in range(200):
        scenario = parse_protocol_scenario(text_of(ProtocolLevel().draw(seed)), f"seed {seed}")
        assert 5 <= scenario.launch_line.count <= 20
        assert scenario.swarm_faults
        drawn |= {fault.kind for fault in scenario.swarm_faults}
    assert drawn == SWARM_FAULTS.keys() - NOT_OF_THE_PROTOCOL


def test_a_seed_is_one_scenario_and_one_flight() -> None:
    level = ProtocolLevel()
    assert level.draw(7) == level.draw(7)
    assert level.draw(7) != level.draw(8)
    first, again = level.run(level.draw(7)), level.run(level.draw(7))
    assert first == again
    assert level.run_text(text_of(level.draw(7)), "seed 7") == first


def test_a_swarm_that_nothing_befalls_flies_on_as_it_is() -> None:
    result = flown(9, loss=0.1)
    assert result.violations == ()
    assert [line for line in result.transcript if "table" in line] == [
        "   0 s  -           table of drone 1: 1@0 2@1 3@2 4@3 5@4 6@5 7@6 8@7 9@8"
    ]


@pytest.mark.parametrize(
    "faults",
    [
        pytest.param([{"kind": "kill", "drone": 9, "at_s": 3.0}], id="leaf"),
        pytest.param([{"kind": "kill", "drone": 1, "at_s": 3.0}], id="root"),
        pytest.param([{"kind": "kill", "drone": d, "at_s": 3.0} for d in range(1, 6)], id="half"),
        pytest.param([{"kind": "kill", "drone": d, "at_s": 3.0} for d in range(1, 9)], id="all but one"),
        pytest.param([{"kind": "freeze", "drone": 1, "at_s": 3.0, "until_s": 9.0}], id="frozen and back"),
        pytest.param([{"kind": "reboot", "drone": 2, "at_s": 3.0, "until_s": 6.0}], id="reboot"),
        pytest.param([{"kind": "radio_dead", "drone": 1, "at_s": 3.0, "until_s": 9.0}], id="dead radio"),
        pytest.param(
            [{"kind": "partition", "parts": [[1, 2, 3], [4, 5, 6], [7, 8, 9]], "at_s": 6.0, "until_s": 20.0}],
            id="three parts",
        ),
        pytest.param([{"kind": "command", "command": "rtl", "drone": 2, "at_s": 3.0}], id="departure"),
        pytest.param([{"kind": "one_way", "drone": 2, "towards": 1, "at_s": 3.0}], id="one way"),
    ],
)
def test_a_swarm_agrees_and_goes_on_after(faults: list[dict[str, Any]]) -> None:
    assert flown(9, *faults, loss=0.1).violations == ()


def test_a_drone_whose_table_stands_still_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    step = KinematicDrone.step

    def stuck(drone: KinematicDrone, now_s: float) -> None:
        if drone.drone != 5 or now_s < 2.0:
            step(drone, now_s)

    monkeypatch.setattr(KinematicDrone, "step", stuck)
    assert "agreement" in kinds(flown(6, {"kind": "kill", "drone": 2, "at_s": 3.0}))


def test_a_root_that_orders_nothing_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KinematicDrone, "_search", lambda *_: None)
    late = {"kind": "one_way", "drone": 2, "towards": 3, "at_s": 1.0, "until_s": 1.2}
    monkeypatch.setattr("simvehicle.scenario.table_invariants.SEARCHES_WITHIN_S", 2.0)
    assert kinds(flown(5, late)) == {"search"}


def test_drones_that_fly_in_one_place_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        KinematicDrone, "_towards", lambda drone, _: setattr(drone, "position_ned_m", (0.0,) * 3) or 0.0
    )
    assert "separation" in kinds(flown(5))


def test_a_file_that_cannot_be_is_told_with_its_line() -> None:
    wrong = document(5, {"kind": "kill", "drone": 6, "at_s": 3.0})
    with pytest.raises(DocumentError, match=r"told\.yaml:\d+: swarm_faults\[0\]\.drone: there is no drone 6"):
        ProtocolLevel().run_text(text_of(wrong), "told.yaml")
    with pytest.raises(DocumentError, match="there is no drone 6"):
        ProtocolLevel().run(wrong)
    with pytest.raises(DocumentError, match="launch_line"):
        ProtocolLevel().run({"name": "none"})


def test_who_is_out_of_range_is_heard_by_way_of_others() -> None:
    """Each hears only the slots next to its own; an order comes to the outermost all the same, a hop a tick."""
    swarm = KinematicSwarm(19, 10.0, RadioModel(range_m=14.5), 1)
    assert swarm.radio.audible("1") == {str(drone) for drone in range(2, 8)}
    for _ in range(60):
        swarm.step()
    orders = {member.drone.table.order for member in swarm.members.values()}
    assert None not in orders
    assert min(order.sequence for order in orders if order is not None) > 2
