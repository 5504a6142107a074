"""Damaged plans, fences and parameter files: what is in them is read or named, or one line says why not."""

from __future__ import annotations

import contextlib
import json
import math
import pathlib
import re
from collections.abc import Callable, Sequence
from typing import Any

import mutations
import pytest
from reader import assert_tried, reading
from trial import run_cases

from flightstack.mavlink.modes import Flavour
from gcs.plans.checks import check_plan
from gcs.plans.mission_items import fence_items, mission_items, plan_items, rally_items
from mission.documents.flight_plan import Plan
from mission.documents.parameter_file import read_parameters
from mission.documents.plan_file import parse_plan, plan_text, read_plan, waypoints_text
from mission.documents.yaml_file import DocumentError
from mission.geometry.geofence import Geofence
from sensors.calibration.side_by_side import load as load_calibrations
from sensors.serial.captures import read_samples

DATA = pathlib.Path(__file__).parent.parent / "data"


def files(*patterns: str) -> list[bytes]:
    found = [
        path for pattern in patterns for path in sorted(DATA.glob(pattern)) if path.stat().st_size < 60_000
    ]
    assert found
    return [path.read_bytes() for path in found]


def areas(fence: Geofence | None) -> int:
    if fence is None:
        return 0
    circles = len(fence.inclusion_circles) + len(fence.exclusion_circles)
    return len(fence.inclusion) + len(fence.exclusion) + circles


def check_flyable(plan: Plan, file: str) -> None:
    """Every number is one, every place is one, and everything that is made of a plan can be made."""
    for item in plan.items:
        assert all(value is None or math.isfinite(value) for value in item.params), item
    for point in (*plan.rally, *((plan.home,) if plan.home else ())):
        assert abs(point.latitude_deg) <= 90.0
        assert abs(point.longitude_deg) <= 180.0
        assert math.isfinite(point.amsl_m)
    assert all(warning.isprintable() and warning for warning in plan.warnings), plan.warnings
    check = check_plan(plan, file)
    for line in (*check.errors, *check.warnings):
        assert line.isprintable(), line
    if check.errors:
        return
    for flavour in (Flavour.ARDUPILOT, Flavour.PX4):
        items = mission_items(plan, flavour)
        again, _ = plan_items(items, flavour)
        assert [item.command for item in again] == [item.command for item in plan.items]
    if plan.geofence is not None:
        fence_items(plan.geofence)
    rally_items(plan.rally)
    assert_same(parse_plan(plan_text(plan), file), plan)


def assert_same(again: Plan, plan: Plan) -> None:
    """What was written is read again as the same plan."""
    assert [(i.command, i.frame, i.params, i.auto_continue) for i in again.items] == [
        (i.command, i.frame, i.params, i.auto_continue) for i in plan.items
    ]
    assert (again.home, again.rally, again.cruise_mps, again.hover_mps) == (
        plan.home,
        plan.rally,
        plan.cruise_mps,
        plan.hover_mps,
    )
    assert areas(again.geofence) == areas(plan.geofence)


# --- plans ---


def check_accounted(plan: Plan, text: str) -> None:
    """Everything that a QGroundControl file counts is in the plan, or told of."""
    content = json.loads(text)
    mission = content.get("mission")
    listed = mission.get("items") if isinstance(mission, dict) else content.get("items")
    fence = content.get("geoFence") if isinstance(content.get("geoFence"), dict) else {}
    rally = content.get("rallyPoints") if isinstance(content.get("rallyPoints"), dict) else {}
    told = len(plan.warnings)
    if isinstance(listed, list):
        assert len(plan.items) + told >= len(listed)
    polygons = [*(fence.get("polygons") or ()), *(fence.get("circles") or ())]
    assert areas(plan.geofence) + told >= len(polygons)
    assert len(plan.rally) + told >= len(rally.get("points") or ())


@pytest.mark.parametrize("kind", ["plan", "mission"])
def test_a_damaged_plan(kind: str, cases: int, tmp_path: pathlib.Path) -> None:
    seeds = files("plans/*.plan", "cases/*.plan") if kind == "plan" else files("cases/*.mission")
    documents = []
    for seed in seeds:
        with contextlib.suppress(ValueError, RecursionError):
            documents.append(json.loads(seed))
    mutator = mutations.Mutator(kind, seeds, documents=documents)

    def take(path: pathlib.Path) -> None:
        plan = read_plan(path)
        check_flyable(plan, str(path))
        text = path.read_text("utf-8-sig")
        if text.lstrip().startswith("{"):
            check_accounted(plan, text)

    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / f"case.{kind}", take)))


def waypoint_seeds() -> list[bytes]:
    found = [
        data for data in files("cases/*.waypoints", "cases/w*.txt") if data.lstrip().startswith(b"QGC WPL")
    ]
    for path in sorted(DATA.glob("plans/*.plan")):
        with contextlib.suppress(DocumentError, ValueError):
            found.append(waypoints_text(read_plan(path)).encode())
    return found


def test_a_damaged_waypoint_file(cases: int, tmp_path: pathlib.Path) -> None:
    mutator = mutations.Mutator("wpl", waypoint_seeds())

    def take(path: pathlib.Path) -> None:
        plan = read_plan(path)
        check_flyable(plan, str(path))
        text = path.read_text("utf-8-sig")
        if text.lstrip().startswith("QGC WPL"):
            rows = [
                line
                for line in re.split(r"\r\n?|\n", text)
                if line.strip() and not line.strip().startswith("#")
            ]
            fence = plan.geofence or Geofence()
            corners = sum(len(polygon) for polygon in (*fence.inclusion, *fence.exclusion))
            circles = len(fence.inclusion_circles) + len(fence.exclusion_circles)
            read = len(plan.items) + corners + circles + len(plan.rally) + (plan.home is not None)
            assert read + len(plan.warnings) >= len(rows) - 1

    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / "case.waypoints", take)))


@pytest.mark.parametrize(
    ("kind", "patterns", "mutation"),
    [
        ("kml", ("cases/*.kml",), mutations.tags),
        ("geojson", ("cases/*.geojson",), mutations.lines),
        ("fence", ("cases/w07*.txt",), mutations.lines),
    ],
)
def test_a_damaged_fence_file(
    kind: str, patterns: Sequence[str], mutation: mutations.Mutation, cases: int, tmp_path: pathlib.Path
) -> None:
    seeds = files(*patterns)
    documents = [json.loads(seed) for seed in seeds] if kind == "geojson" else []
    mutator = mutations.Mutator(kind, seeds, (*mutations.BYTES, mutation), documents)

    def take(path: pathlib.Path) -> None:
        plan = read_plan(path)
        check_flyable(plan, str(path))
        if kind == "kml":
            rings = path.read_bytes().count(b"</Polygon>")
            assert areas(plan.geofence) + len(plan.warnings) >= min(rings, 1)

    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / f"case.{kind}", take)))


# --- parameters and what instruments' tools write ---

PARAMETERS = (
    b"# stock\nRTL_ALT 1500\nFENCE_ENABLE,1\nFENCE_TYPE 7 # all\nWPNAV_SPEED 500.000000\n",
    b"# Onboard parameters for Vehicle 1\n#\n1\t1\tMPC_XY_VEL_MAX\t12.000000000\t9\n1\t1\tCOM_OBL_RC_ACT\t0\t6\n",
    b"SYSID_THISMAV,3\r\nATC_RAT_PIT_P,0.135\r\nCOMPASS_DEV_ID 658433 @READONLY\r\nGPS_TYPE=1\r\n",
)


def test_a_damaged_parameter_file(cases: int, tmp_path: pathlib.Path) -> None:
    mutator = mutations.Mutator("parameters", PARAMETERS)

    def take(path: pathlib.Path) -> None:
        found = read_parameters(path)
        assert all(math.isfinite(parameter.value) for parameter in found)
        said = [line.partition("#")[0].strip() for line in path.read_text("utf-8-sig").splitlines()]
        names = {
            name for line in said if line for name in line.upper().replace(",", " ").replace("=", " ").split()
        }
        lines_read = {parameter.line for parameter in found}
        again = [n for n, line in enumerate(said, 1) if line.strip(" ,=\t") and n not in lines_read]
        assert all(parameter.name in names for parameter in found)
        # What is not read stands there a second time.
        assert len({said[n - 1].upper() for n in again} & {said[n - 1].upper() for n in lines_read}) <= len(
            again
        )
        assert len(again) < len(said) or not found

    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / "case.param", take)))


CALIBRATION = {
    "drone-1": {"offset_ppm": -3.2, "scale": 1.02, "scatter_ppm": 0.4, "seconds": 60, "made_at": "2026"}
}
SAMPLES = (
    b'{"time_s":0.1,"instrument":"co2","state":"measuring","status":"00","reason":"","quantity":"co2","co2_ppm":431.5}\n'
    b'{"time_s":0.2,"instrument":"co2","state":"error","status":"","reason":"damaged","quantity":"co2"}\n'
)


@pytest.mark.parametrize(
    ("kind", "seed", "take"),
    [
        ("calibration", json.dumps(CALIBRATION).encode(), load_calibrations),
        ("samples", SAMPLES, read_samples),
    ],
)
def test_a_damaged_file_of_the_bench(
    kind: str, seed: bytes, take: Callable[[pathlib.Path], Any], cases: int, tmp_path: pathlib.Path
) -> None:
    documents = [json.loads(line) for line in seed.splitlines()]
    mutator = mutations.Mutator(kind, [seed], documents=documents)
    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / "case.json", take)))
