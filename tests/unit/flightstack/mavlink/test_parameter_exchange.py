"""Reading and setting one parameter, against answers as autopilots give them."""

from __future__ import annotations

import types

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.exchanges import REPEAT_S, REPEATS, Answer, ParameterExchange, ParameterQuery
from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.vehicle_state import VehicleState

INT8, INT32, REAL32 = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_REAL32,
)


@pytest.fixture
def vehicle() -> VehicleState:
    vehicle = VehicleState(1, 1, None)
    vehicle.flavour = Flavour.ARDUPILOT
    return vehicle


def told(name: str, value: float, kind: int) -> types.SimpleNamespace:
    return types.SimpleNamespace(param_id=name, param_value=value, param_type=kind)


def kinds(messages) -> list[str]:
    return [message.get_type() for message in messages]


def test_what_the_vehicle_holds_already_is_not_written(vehicle):
    exchange = ParameterExchange("FENCE_TYPE", 7.0)
    assert kinds(exchange.step(0.0, vehicle)) == ["PARAM_REQUEST_READ"]
    exchange.value(Flavour.ARDUPILOT, told("FENCE_TYPE", 7.0, INT8))
    assert (exchange.answer, exchange.written) == (Answer.ACCEPTED, False)


def test_an_answer_of_another_type_with_the_right_value_counts(vehicle):
    exchange = ParameterExchange("FENCE_TYPE", 7.0)
    exchange.step(0.0, vehicle)
    exchange.value(Flavour.ARDUPILOT, told("FENCE_TYPE", 4.0, INT8))
    (sent,) = exchange.step(0.1, vehicle)
    assert (sent.param_value, sent.param_type) == (7.0, INT8)
    exchange.value(Flavour.ARDUPILOT, told("FENCE_TYPE", 7.0, REAL32))
    assert (exchange.answer, exchange.written, exchange.kind) == (Answer.ACCEPTED, True, INT8)


def test_an_answer_with_another_value_is_looked_into(vehicle):
    """ArduPilot tells the default where a value is nearly that; the parameter itself says what it is."""
    exchange = ParameterExchange("WPNAV_SPEED", 1000.05)
    exchange.step(0.0, vehicle)
    exchange.value(Flavour.ARDUPILOT, told("WPNAV_SPEED", 1000.0, REAL32))
    assert kinds(exchange.step(0.1, vehicle)) == ["PARAM_SET"]
    exchange.value(Flavour.ARDUPILOT, told("WPNAV_SPEED", 1000.0, REAL32))
    assert kinds(exchange.step(0.2, vehicle)) == ["PARAM_REQUEST_READ"]
    exchange.value(Flavour.ARDUPILOT, told("WPNAV_SPEED", 1000.05, REAL32))
    assert exchange.answer is Answer.ACCEPTED


def test_a_vehicle_that_keeps_another_value_is_told_of(vehicle):
    exchange = ParameterExchange("RTL_ALT", 5.0)
    exchange.step(0.0, vehicle)
    now_s, sent = 0.0, []
    while exchange.answer is Answer.PENDING and now_s < 60.0:
        exchange.value(Flavour.ARDUPILOT, told("RTL_ALT", 30.0, INT32))
        now_s += 0.1
        sent += kinds(exchange.step(now_s, vehicle))
    assert (exchange.answer, exchange.reason) == (Answer.REFUSED, "RTL_ALT is 30 now, it should be 5")
    assert not exchange.is_impossible
    assert sent.count("PARAM_SET") == 3


def test_what_the_type_does_not_take_is_never_sent(vehicle):
    exchange = ParameterExchange("FENCE_ACTION", 300.0)
    exchange.step(0.0, vehicle)
    exchange.value(Flavour.ARDUPILOT, told("FENCE_ACTION", 1.0, INT8))
    assert exchange.answer is Answer.REFUSED
    assert exchange.is_impossible
    assert exchange.reason == ("FENCE_ACTION cannot be 300: it is within -128 to 127 (int8); it stays 1")
    assert exchange.step(1.0, vehicle) == []
    assert not exchange.written


@pytest.mark.parametrize("exchange", [ParameterQuery("NO_SUCH"), ParameterExchange("NO_SUCH", 1.0)])
def test_silence_and_errors_have_an_end(vehicle, exchange):
    sent = sum(len(exchange.step(tick * REPEAT_S, vehicle)) for tick in range(REPEATS + 3))
    assert (sent, exchange.answer) == (REPEATS + 1, Answer.SILENCE)
    assert exchange.reason == "NO_SUCH does not answer: does this autopilot have it?"
    other = type(exchange)(*(("NO_SUCH",) if isinstance(exchange, ParameterQuery) else ("NO_SUCH", 1.0)))
    other.error(types.SimpleNamespace(param_id="NO_SUCH", error=mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST))
    assert (other.answer, other.reason) == (Answer.REFUSED, "NO_SUCH: does not exist")


def test_a_query_tells_value_and_type(vehicle):
    query = ParameterQuery("RTL_ALT")
    assert kinds(query.step(0.0, vehicle)) == ["PARAM_REQUEST_READ"]
    query.value(Flavour.ARDUPILOT, told("RTL_SPEED", 0.0, INT32))
    assert query.answer is Answer.PENDING
    query.value(Flavour.ARDUPILOT, told("RTL_ALT", 1500.0, INT32))
    assert (query.answer, query.found, query.kind) == (Answer.ACCEPTED, 1500.0, INT32)
