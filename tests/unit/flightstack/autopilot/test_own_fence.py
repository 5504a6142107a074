"""The fence that an autopilot keeps by itself, asked of simulated ones over links that lose a part of everything."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot import AutopilotSession, OwnFence
from flightstack.config import AutopilotConfig
from flightstack.mavlink.framing import FrameFinder
from mission.geometry.frames import Geodetic, LocalFrame, Vector3
from mission.geometry.geofence import Circle
from simvehicle.autopilot.missions import StoredItem
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world

ORIGIN = Geodetic(38.4040, 14.9630, 300.0)
FENCE = mavlink.MAV_MISSION_TYPE_FENCE
SQUARE = ((38.4050, 14.9620), (38.4050, 14.9640), (38.4030, 14.9640), (38.4030, 14.9620))
HOLE = Circle(38.4041, 14.9631, 6.5)


def stored(command: int, p1: float, latitude_deg: float, longitude_deg: float) -> StoredItem:
    place = round(latitude_deg * 1e7), round(longitude_deg * 1e7)
    return StoredItem(mavlink.MAV_FRAME_GLOBAL, command, p1, 0.0, 0.0, 0.0, *place, 0.0)


UPLOADED = [
    *(stored(5001, 4.0, *corner) for corner in SQUARE),
    stored(5004, HOLE.radius_m, HOLE.latitude_deg, HOLE.longitude_deg),
]


class Asked:
    """A session that arms a simulated vehicle, and what it found of its fence."""

    def __init__(
        self, flavour: str, parameters: dict[str, float], *, loss: float = 0.0, conflict: str = ""
    ) -> None:
        spec = VehicleSpec(
            id=3,
            flavour=flavour,  # type: ignore[arg-type]
            links=("udpout:127.0.0.1:9",),
            parameters=parameters | ({"COM_OBL_RC_ACT": 3.0} if flavour == "px4" else {}),
        )
        fleet = FleetConfig(origin=ORIGIN, vehicles=(spec,), ready_after_s=3.0)
        self.vehicle = SimulatedVehicle(spec, make_world(fleet), seed=1, ready_after_s=3.0)
        self.vehicle.autopilot.lists[FENCE] = list(UPLOADED)
        self.found: list[OwnFence] = []
        self.results: list[Any] = []
        self._random = np.random.default_rng(4)
        self._loss = loss
        self._conflict = conflict
        self.session = AutopilotSession(
            3, LocalFrame(ORIGIN), AutopilotConfig(link="udpin:127.0.0.1:1"), self._judge
        )

    def _judge(self, fence: OwnFence, _home_ned_m: Vector3) -> str:
        self.found.append(fence)
        return self._conflict

    def _arrives(self, data: bytes) -> bytes:
        frames = FrameFinder().find(data + bytes(1))
        return b"".join(frame.data for frame in frames if self._random.random() >= self._loss)

    def run(self, limit_s: float = 60.0) -> OwnFence:
        for tick in range(round(limit_s * 10)):
            now_s = tick / 10
            self.vehicle.step(now_s)
            self.session.receive(now_s, self._arrives(b"".join(data for _, data in self.vehicle.drain())))
            self.session.arm()
            self.vehicle.receive(0, self._arrives(self.session.step(now_s)))
            self.results += self.session.take_results()
            if self.results or self.session.report.armed:
                break
        return self.found[-1]


@pytest.mark.parametrize("loss", [0.0, 0.15])
def test_an_ardupilots_fence_is_read_whole(loss: float) -> None:
    parameters = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 7.0, "FENCE_ALT_MAX": 80.0, "FENCE_MARGIN": 2.5}
    asked = Asked("ardupilot", parameters, loss=loss)
    fence = asked.run()
    assert (fence.radius_m, fence.ceiling_m, fence.floor_m, fence.margin_m) == (300.0, 80.0, None, 2.5)
    (polygon,) = fence.inclusions
    assert isinstance(polygon, tuple)
    assert [point for corner in polygon for point in corner] == pytest.approx(
        [point for corner in SQUARE for point in corner]
    )
    (circle,) = fence.exclusions
    assert isinstance(circle, Circle)
    assert circle.radius_m == HOLE.radius_m
    assert asked.vehicle.armed


@pytest.mark.parametrize("kinds", [1, 2, 8])
def test_only_the_kinds_that_are_on_count(kinds: int) -> None:
    fence = Asked("ardupilot", {"FENCE_ENABLE": 1.0, "FENCE_TYPE": float(kinds), "AVOID_ENABLE": 0.0}).run()
    assert fence.margin_m == 0.0
    assert fence.inclusions == fence.exclusions == ()
    known = (fence.ceiling_m, fence.radius_m, fence.floor_m)
    assert [number for number in known if number is not None] == [{1: 100.0, 2: 300.0, 8: -10.0}[kinds]]


def test_a_px4s_fence_is_read_whole() -> None:
    fence = Asked("px4", {"GF_ACTION": 3.0, "GF_MAX_HOR_DIST": 120.0, "GF_MAX_VER_DIST": 50.0}).run()
    assert (fence.radius_m, fence.ceiling_m, fence.margin_m, fence.any_inclusion) == (120.0, 50.0, 0.0, True)
    assert (len(fence.inclusions), len(fence.exclusions)) == (1, 1)


@pytest.mark.parametrize(
    ("flavour", "parameters"),
    [
        ("ardupilot", {"FENCE_ENABLE": 0.0, "FENCE_TYPE": 7.0}),
        ("px4", {"GF_ACTION": 0.0, "GF_MAX_HOR_DIST": 20.0}),
        ("px4", {"GF_ACTION": 1.0, "GF_MAX_HOR_DIST": 20.0}),
    ],
)
def test_a_fence_that_does_nothing_is_none(flavour: str, parameters: dict[str, float]) -> None:
    assert Asked(flavour, parameters).run().is_none


def test_a_conflict_ends_the_arming_with_its_reason() -> None:
    asked = Asked("ardupilot", {"FENCE_ENABLE": 1.0}, conflict="the circle is too small")
    asked.run()
    assert [result.reason for result in asked.results] == ["the circle is too small"]
    assert not asked.vehicle.armed


@pytest.mark.parametrize(
    ("silent", "noted"),
    [
        ((b"FENCE_ENABLE", b"FENCE_AUTOENABLE"), ["FENCE_ENABLE, FENCE_AUTOENABLE"]),
        ((b"FENCE_ENABLE",), ["FENCE_ENABLE"]),
        ((b"FENCE_AUTOENABLE",), []),
    ],
)
def test_an_autopilot_that_does_not_tell_whether_it_keeps_a_fence_is_armed_and_that_is_noted(
    silent: tuple[bytes, ...], noted: list[str]
) -> None:
    asked = Asked("ardupilot", {"FENCE_ENABLE": 0.0})
    receive = asked.vehicle.receive

    def deaf_to_parameters(link: int, data: bytes) -> None:
        frames = FrameFinder().find(data + bytes(1))
        read = mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ
        heard = (
            frame.data
            for frame in frames
            if frame.kind != read or not any(name in frame.data for name in silent)
        )
        receive(link, b"".join(heard))

    asked.vehicle.receive = deaf_to_parameters  # type: ignore[method-assign]
    assert asked.run().is_none
    assert asked.vehicle.armed
    notes = [note for note in asked.session.report.notes if "fence" in note]
    assert notes == [f"autopilot does not tell {names}: its own fence is not known" for names in noted]
