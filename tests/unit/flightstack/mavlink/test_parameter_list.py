"""All parameters of an autopilot over a link that loses some."""

from __future__ import annotations

import random
import types

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.exchanges import Answer
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_list import ParameterList
from flightstack.mavlink.vehicle_state import VehicleState

NAMES = [f"P_{index}" for index in range(70)]
REAL32 = mavlink.MAV_PARAM_TYPE_REAL32


def told(index: int, name: str | None = None, value: float | None = None) -> types.SimpleNamespace:
    return types.SimpleNamespace(
        param_id=name or NAMES[index],
        param_value=float(index) if value is None else value,
        param_type=REAL32,
        param_count=len(NAMES),
        param_index=index,
    )


def read(loss: float, limit_s: float = 300.0) -> tuple[ParameterList, list[str]]:
    everything, vehicle, lost = ParameterList(), VehicleState(1, 1, None), random.Random(4)
    now_s, asked = 0.0, []
    while everything.answer is Answer.PENDING and now_s < limit_s:
        now_s += 0.1
        for message in everything.step(now_s, vehicle):
            asked.append(message.get_type())
            is_list = message.get_type() == "PARAM_REQUEST_LIST"
            for index in range(len(NAMES)) if is_list else (message.param_index,):
                if lost.random() >= loss:
                    everything.value(now_s, Flavour.ARDUPILOT, told(index))
    return everything, asked


def test_a_good_link_needs_one_question():
    everything, asked = read(0.0)
    assert (everything.answer, asked) == (Answer.ACCEPTED, ["PARAM_REQUEST_LIST"])
    assert {name: value.value for name, value in everything.found.items()} == {
        name: float(index) for index, name in enumerate(NAMES)
    }


@pytest.mark.parametrize("loss", [0.1, 0.5])
def test_what_was_lost_is_asked_for_by_its_index(loss):
    everything, asked = read(loss)
    assert everything.answer is Answer.ACCEPTED
    assert sorted(everything.found) == sorted(NAMES)
    assert asked.count("PARAM_REQUEST_LIST") == 1
    assert "PARAM_REQUEST_READ" in asked


def test_silence_has_an_end():
    everything, asked = read(1.0)
    assert everything.answer is Answer.SILENCE
    assert everything.reason.startswith("the parameters did not come: none; ")
    assert set(asked) == {"PARAM_REQUEST_LIST"}


def test_what_belongs_to_no_list_is_not_counted():
    everything = ParameterList()
    everything.step(0.0, VehicleState(1, 1, None))
    everything.value(0.1, Flavour.PX4, told(65535, "_HASH_CHECK"))
    assert everything.found == {}
    everything.value(0.2, Flavour.PX4, told(3))
    everything.value(0.3, Flavour.PX4, told(65535, NAMES[3], 8.0))
    assert everything.found[NAMES[3]].value == 8.0, "it has been changed since"
