"""Parameter files of MAVProxy, Mission Planner, QGroundControl and our own."""

from __future__ import annotations

import pytest

from mission.documents.parameter_file import FileParameter, parse_parameters, read_parameters
from mission.documents.yaml_file import DocumentError

MAVPROXY = """\
# saved by mavproxy
RTL_ALT          1500.000000
COMPASS_OFS_X    -5.250000  # in the hangar

FENCE_ENABLE     1
"""
MISSION_PLANNER = """\
#NOTE: 27.11.2026 09:12:33: Frame : QUAD
RTL_ALT,1500
COMPASS_OFS_X,-5.25
FENCE_ENABLE,1
"""
QGROUNDCONTROL = (
    "# Onboard parameters for Vehicle 1\n#\n# Vehicle-Id Component-Id Name Value Type\n"
    "1\t1\tRTL_ALT\t1500\t6\n1\t1\tCOMPASS_OFS_X\t-5.250000000000000000\t9\n1\t1\tFENCE_ENABLE\t1\t2\n"
)
OURS = "RTL_ALT 1500\nCOMPASS_OFS_X -5.25\nfence_enable 1\n"


@pytest.mark.parametrize("text", [MAVPROXY, MISSION_PLANNER, QGROUNDCONTROL, OURS])
def test_every_form_says_the_same(text):
    found = {each.name: each.value for each in parse_parameters(text, "a.param")}
    assert found == {"RTL_ALT": 1500.0, "COMPASS_OFS_X": -5.25, "FENCE_ENABLE": 1.0}


def test_what_a_file_marks_as_read_only_is_known_as_that():
    (parameter,) = parse_parameters("BRD_TYPE 3 @READONLY\n", "defaults.parm")
    assert parameter == FileParameter("BRD_TYPE", 3.0, 1, is_read_only=True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("RTL_ALT 1500\nRTL_ALT 2500\n", "a.param:2: RTL_ALT stands in line 1 with another value"),
        ("1 1 RTL_ALT 5 6\nRTL_ALT 6\n", "a.param:2: RTL_ALT stands in line 1 with another value"),
        ("1 1 RTL_ALT 5 6\n2 1 RTL_ALT 6 6\n", "a.param:2: RTL_ALT stands in line 1 with another value"),
        ("RTL_ALT\n", "a.param:1: 'RTL_ALT' is no parameter; write NAME VALUE"),
        ("RTL_ALT 1,500\n", "a.param:1: 'RTL_ALT 1 500' is no parameter"),
        ("RTL_ALT 15m\n", "a.param:1: RTL_ALT: '15m' is no number"),
        ("RTL_ALT nan\n", "a.param:1: RTL_ALT: 'nan' is no number"),
        ("RTL_ALT 1e999\n", "a.param:1: RTL_ALT: '1e999' is no number"),
        ("RTL_ALT 0x10\n", "a.param:1: RTL_ALT: '0x10' is no number"),
        ("RTL_ALT 1_500\n", "a.param:1: RTL_ALT: '1_500' is no number"),
        ("RTL_ALTITUDE_OF_ALL 3\n", "a.param:1: 'RTL_ALTITUDE_OF_ALL' is no parameter's name"),
        ("{\"a\": 1}\n", "a.param:1: '{\"a\":' is no parameter's name"),
    ],
)  # fmt: skip
def test_a_line_that_is_none_is_named(text, says):
    with pytest.raises(DocumentError) as error:
        parse_parameters(text, "a.param")
    assert str(error.value).startswith(says)


def test_a_parameter_that_stands_twice_with_one_value_counts_once():
    assert len(parse_parameters("RTL_ALT 1500\nRTL_ALT 1500.0\n", "a.param")) == 1


def test_a_file_without_any_is_refused(tmp_path):
    file = tmp_path / "empty.param"
    file.write_text("# nothing\n")
    with pytest.raises(DocumentError, match=r"empty\.param: there are no parameters in it"):
        read_parameters(file)
