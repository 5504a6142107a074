"""A parameter file beside what a vehicle holds."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour
from flightstack.mavlink.parameter_values import ParameterValue, single
from gcs.plans.parameter_load import Change, is_read_only, plan_load
from mission.documents.parameter_file import parse_parameters

INT8, INT32, REAL32 = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_REAL32,
)
HELD = {
    "RTL_ALT": ParameterValue(1500.0, INT32),
    "FENCE_ACTION": ParameterValue(1.0, INT8),
    "ATC_ANG_RLL_P": ParameterValue(single(4.6), REAL32),
    "STAT_BOOTCNT": ParameterValue(12.0, INT32),
    "COMPASS_DEV_ID": ParameterValue(97539.0, INT32),
    "SYSID_THISMAV": ParameterValue(1.0, INT32),
    "BRD_TYPE": ParameterValue(0.0, INT8),
}


def load(text: str):
    return plan_load(parse_parameters(text, "a.param"), HELD, Flavour.ARDUPILOT, 1)


def test_only_what_differs_is_to_be_written():
    plan = load("RTL_ALT 2500\nFENCE_ACTION 1\nATC_ANG_RLL_P 4.6\nSTAT_BOOTCNT 12\n")
    assert plan.changes == (Change("RTL_ALT", 1500.0, 2500.0),)
    assert str(plan.changes[0]) == "RTL_ALT 1500 -> 2500"
    assert plan.same == 3, "a read-only one that is so already is nobody's business"


def test_what_cannot_be_loaded_is_named():
    plan = load("NO_SUCH 1\nSTAT_BOOTCNT 3\nCOMPASS_DEV_ID 1\nSYSID_THISMAV 4\nBRD_TYPE 3 @READONLY\n")
    assert plan.changes == ()
    assert plan.unknown == ("NO_SUCH",)
    assert plan.read_only == ("STAT_BOOTCNT", "COMPASS_DEV_ID", "BRD_TYPE")
    assert [sentence.split(";")[0] for sentence in plan.identity] == ["SYSID_THISMAV 4: this is drone 1"]


def test_cameras_and_other_vehicles_in_a_file_of_qgroundcontrol():
    plan = load("1\t1\tRTL_ALT\t2500\t6\n1\t154\tRTL_ALT\t9\t6\n1\t100\tCAM_MODE\t2\t6\n")
    assert plan.changes == (Change("RTL_ALT", 1500.0, 2500.0),)
    assert plan.other_components == ("RTL_ALT (component 154)", "CAM_MODE (component 100)")
    assert (plan.unknown, plan.other_vehicles) == ((), ())
    assert load("3\t1\tRTL_ALT\t2500\t6\n").other_vehicles == (3,)


def test_values_that_cannot_be_are_told_with_their_line():
    plan = load("# a\nFENCE_ACTION 300\nRTL_ALT 16777217\n")
    assert plan.changes == ()
    assert [sentence.split(":")[0] for sentence in plan.impossible] == ["line 2", "line 3"]
    assert "would become 16777216" in plan.impossible[1]


@pytest.mark.parametrize(
    ("name", "flavour", "read_only"),
    [
        ("MIS_TOTAL", Flavour.ARDUPILOT, True),
        ("INS_ACC2_ID", Flavour.ARDUPILOT, True),
        ("BARO1_GND_PRESS", Flavour.ARDUPILOT, True),
        ("SYSID_SW_MREV", Flavour.ARDUPILOT, True),
        ("RTL_ALT", Flavour.ARDUPILOT, False),
        ("LND_FLIGHT_T_HI", Flavour.PX4, True),
        ("CAL_ACC0_ID", Flavour.PX4, False),
    ],
)
def test_what_autopilots_count_for_themselves(name, flavour, read_only):
    assert is_read_only(name, flavour) is read_only
