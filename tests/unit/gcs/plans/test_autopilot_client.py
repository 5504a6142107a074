"""Plans, fences, lists and parameters against simulated vehicles in this process, by the real MAVSDK."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour
from gcs.errors import GroundError
from gcs.plans import autopilot_client, vehicle_link
from gcs.plans.autopilot_client import FENCE, MISSION, RALLY, Vehicle, check_parameter
from gcs.plans.list_transfers import ListTransfers
from gcs.plans.mission_items import FENCE_ACTIONS
from gcs.plans.vehicle_link import VehicleError, find_vehicle
from mission.documents.flight_plan import Plan, PlanItem
from mission.geometry.frames import Geodetic, LocalFrame
from mission.geometry.geofence import Circle, Geofence
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world

FLAVOURS = ("ardupilot", "px4")
FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))


def at(north_m: float, east_m: float) -> tuple[float, float]:
    point = FRAME.to_geodetic((north_m, east_m, 0.0))
    return point.latitude_deg, point.longitude_deg


def item(command: int, north_m: float, east_m: float, above_home_m: float = 20.0) -> PlanItem:
    return PlanItem(
        command=command, frame=3, params=(0.0, 0.0, 0.0, None, *at(north_m, east_m), above_home_m)
    )


ITEMS = (item(22, 0.0, 0.0), item(16, 40.0, 0.0), item(16, 40.0, 40.0))
WALL = Geofence(
    (tuple(at(n, e) for n, e in ((-100.0, -100.0), (-100.0, 100.0), (100.0, 100.0), (100.0, -100.0))),)
)
ROUND = Geofence(inclusion_circles=(Circle(*at(0.0, 0.0), 120.0),))
REFUGE = Geodetic(*at(-20.0, 0.0), 15.0)
WHOLE = Plan(items=ITEMS, home=Geodetic(-5.06, 151.3, 500.0), geofence=WALL, rally=(REFUGE,))
RTL = FENCE_ACTIONS["rtl"]


class SimulatedLink:
    """The link to a simulated vehicle, whose time goes on a little whenever it is read."""

    describe = "simulated"
    problem = ""
    reconnects = 0
    dropped_bytes = 0

    def __init__(self, flavour: str) -> None:
        spec = VehicleSpec(id=1, flavour=flavour, links=("udpout:127.0.0.1:9",))
        config = FleetConfig(origin=Geodetic(-5.06, 151.3, 500.0), vehicles=(spec,))
        self.vehicle = SimulatedVehicle(spec, make_world(config), seed=1, ready_after_s=0.0)
        self.now_s = 0.0
        self.sent: list[Any] = []
        self.says_after: dict[str, str] = {}
        """Kind of a message to it -> what it says of that."""
        self._parser = mavlink.MAVLink(None)
        self.vehicle.step(0.0)

    def read(self) -> bytes:
        self.now_s += 0.05
        self.vehicle.step(self.now_s)
        return b"".join(data for _, data in self.vehicle.drain())

    def write(self, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or ():
            self.sent.append(message)
            text = self.says_after.pop(message.get_type(), None)
            if text is not None:
                self.vehicle.autopilot._announcer.say(mavlink.MAV_SEVERITY_CRITICAL, text)
        self.vehicle.receive(0, data)

    def close(self) -> None:
        pass

    def kinds(self) -> list[str]:
        return [message.get_type() for message in self.sent]


@pytest.fixture(autouse=True)
def short_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle's seconds are short."""
    monkeypatch.setattr(autopilot_client, "LISTENED_S", 0.1)
    monkeypatch.setattr(vehicle_link, "DISCOVERY_S", 1.0)


class Session:
    def __init__(self, flavour: str) -> None:
        self.link = SimulatedLink(flavour)

    def run(self, *steps: Callable[[Vehicle], Awaitable[Any]]) -> list[Any]:
        """What each of the steps gives, one after the other with one vehicle."""

        async def all_of_them() -> list[Any]:
            vehicle = Vehicle(await find_vehicle([self.link], 1, 255), 255)
            try:
                return [await step(vehicle) for step in steps]
            finally:
                vehicle.close()

        return asyncio.run(all_of_them())

    def lists(self) -> dict[int, list[Any]]:
        return self.link.vehicle.autopilot.lists

    def parameter(self, name: str) -> float:
        return self.link.vehicle.autopilot.parameters[name]


@pytest.fixture(params=FLAVOURS)
def session(request) -> Iterator[Session]:
    return Session(request.param)


@pytest.fixture
def ardupilot() -> Session:
    return Session("ardupilot")


@pytest.fixture
def px4() -> Session:
    return Session("px4")


def upload(plan: Plan, **options: Any) -> Callable[[Vehicle], Awaitable[Any]]:
    return lambda vehicle: vehicle.upload_plan(plan, RTL, **options)


def commands(items: Sequence[Any]) -> list[int]:
    return [each.command for each in items]


def test_a_whole_plan_goes_up_and_comes_back(session: Session) -> None:
    _, back = session.run(upload(WHOLE), lambda vehicle: vehicle.download_plan())
    assert [each.command for each in back.items] == [22, 16, 16]
    assert back.geofence is not None
    assert [len(polygon) for polygon in back.geofence.inclusion] == [4]
    assert len(back.rally) == 1


def test_what_a_plan_has_not_is_cleared_and_its_fence_kept(session: Session) -> None:
    _, told = session.run(upload(WHOLE), upload(Plan(home=WHOLE.home)))
    assert told.notes == (
        "it keeps a fence of 1 area; --clear-fence removes it",
        "cleared a mission of 3 items",
        "cleared 1 rally point",
    )
    assert len(session.lists()[FENCE]) == 4
    assert session.lists()[RALLY] == []
    assert len(session.lists()[MISSION]) <= 1, "nothing, or home"


def test_a_fence_is_removed_where_that_is_asked_for(session: Session) -> None:
    _, told = session.run(upload(WHOLE), upload(Plan(items=ITEMS, home=WHOLE.home), clear_fence=True))
    assert told.notes[0] == "cleared a fence of 1 area"
    assert session.lists()[FENCE] == []


def test_what_a_file_says_nothing_of_stays_and_is_named(session: Session) -> None:
    _, told = session.run(upload(WHOLE), upload(Plan(geofence=ROUND, holds=("fence",))))
    assert told.notes == ("it keeps a mission of 3 items", "it keeps 1 rally point")
    assert commands(session.lists()[FENCE]) == [5003]
    assert len(session.lists()[RALLY]) == 1


def test_nothing_is_cleared_where_nothing_is(session: Session) -> None:
    (told,) = session.run(upload(Plan(geofence=WALL)))
    assert told.notes == ()
    assert "MISSION_CLEAR_ALL" not in session.link.kinds()
    assert len(session.lists()[FENCE]) == 4


def test_a_refused_item_is_named_with_what_the_vehicle_holds_now(session: Session) -> None:
    refused = Plan(
        items=(*ITEMS[:2], item(31014, 40.0, 40.0), item(16, 0.0, 40.0)), home=WHOLE.home, geofence=WALL
    )
    seq = 3 if session.link.vehicle.spec.flavour == "ardupilot" else 2
    with pytest.raises(VehicleError) as error:
        session.run(upload(WHOLE), upload(refused))
    assert str(error.value) == (
        f"drone 1: mission refused at item 3 (seq {seq}, command 31014 USER_5): unsupported; "
        "it holds a mission of 3 items now, the first 2 of this file and 1 other: "
        "upload what it takes before it flies; sent before it: fence"
    )


@pytest.mark.parametrize("kind", ["mission", "fence"])
def test_an_interrupted_upload_ends_and_says_what_it_leaves(
    ardupilot: Session, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when Ctrl-C is pressed: MAVSDK waits for the vehicle, and must not be waited for."""
    write = ardupilot.link.write

    async def interrupted(vehicle: Vehicle) -> None:
        task = asyncio.current_task()
        assert task is not None

        def until_the_first_item(data: bytes) -> None:
            if not task.cancelling():  # what comes then does not reach the vehicle
                write(data)
            if "MISSION_ITEM_INT" in ardupilot.link.kinds() and not task.cancelling():
                task.cancel()

        monkeypatch.setattr(ardupilot.link, "write", until_the_first_item)
        await vehicle.upload_plan(WHOLE if kind == "fence" else Plan(items=ITEMS, home=WHOLE.home), RTL)

    words = f"drone 1: interrupted while the {kind} went up: it may hold a part of this file now"
    with pytest.raises(VehicleError, match=words):
        ardupilot.run(interrupted)


def test_a_vehicle_that_disappears_in_the_middle_is_no_refusal(
    ardupilot: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = ardupilot.link.write

    def until_the_first_item(data: bytes) -> None:
        if "MISSION_ITEM_INT" not in ardupilot.link.kinds():
            write(data)

    monkeypatch.setattr(ardupilot.link, "write", until_the_first_item)
    with pytest.raises(VehicleError) as error:
        ardupilot.run(upload(Plan(items=ITEMS, home=WHOLE.home)))
    assert str(error.value).startswith(
        "drone 1: mission not sent: timeout; it may hold a part of this file now"
    )


def test_px4_refuses_by_a_text_after_it_has_accepted(px4: Session) -> None:
    px4.link.says_after["MISSION_ITEM_INT"] = "Geofence violation for waypoint 2\t"
    with pytest.raises(VehicleError) as error:
        px4.run(upload(Plan(items=ITEMS, home=WHOLE.home)))
    assert str(error.value) == (
        "drone 1: mission refused: Geofence violation for waypoint 2; "
        "it holds all of this file now: clear or replace it before it flies"
    )


def test_px4_may_say_other_things_meanwhile(px4: Session) -> None:
    px4.link.says_after["MISSION_ITEM_INT"] = "Low battery level"
    (told,) = px4.run(upload(Plan(items=ITEMS, home=WHOLE.home)))
    assert told.warnings == ("it says: Low battery level",)


def test_what_px4_says_of_the_mission_it_is_to_lose_is_no_refusal(px4: Session) -> None:
    px4.link.says_after["MISSION_COUNT"] = "Geofence violation for waypoint 2"
    (told,) = px4.run(upload(WHOLE))
    assert told.parameters == {"GF_ACTION": 3.0}
    px4.link.says_after["MISSION_COUNT"] = "Geofence invalid, doesn't contain Home position"
    with pytest.raises(VehicleError, match="fence refused: Geofence invalid, doesn't contain Home position"):
        px4.run(upload(WHOLE))


def test_a_fence_acts_although_its_type_is_the_default(ardupilot: Session) -> None:
    (told,) = ardupilot.run(lambda vehicle: vehicle.upload_fence(WALL, RTL))
    assert told.parameters == {"FENCE_TYPE": 7.0, "FENCE_ACTION": 1.0, "FENCE_ENABLE": 1.0}
    set_names = [m.param_id for m in ardupilot.link.sent if m.get_type() == "PARAM_SET"]
    assert set_names == ["FENCE_ENABLE"], "what it holds already is not written"


def test_a_default_of_a_group_is_set_in_spite_of_the_odd_answer(ardupilot: Session) -> None:
    ardupilot.link.vehicle.autopilot.parameters._values["FENCE_ACTION"] = 2.0
    (written,) = ardupilot.run(lambda vehicle: vehicle.set_parameter("FENCE_ACTION", 1.0))
    assert written
    assert ardupilot.parameter("FENCE_ACTION") == 1.0


@pytest.mark.parametrize(
    ("flavour", "name", "value", "says"),
    [
        ("ardupilot", "FENCE_ACTION", 300.0, "FENCE_ACTION cannot be 300"),
        ("ardupilot", "RTL_ALT", 16_777_217.0, "RTL_ALT cannot be 16777217"),
        ("px4", "GF_ACTION", 2.5, "GF_ACTION is an integer"),
    ],
)
def test_what_a_parameter_cannot_be_is_not_sent(flavour: str, name: str, value: float, says: str) -> None:
    session = Session(flavour)
    with pytest.raises(GroundError, match=f"drone 1: {says}.*; it stays ") as error:
        session.run(lambda vehicle: vehicle.set_parameter(name, value))
    assert not isinstance(error.value, VehicleError), "exit code 2"
    assert "PARAM_SET" not in session.link.kinds()


def test_negative_values_and_whole_lists(session: Session) -> None:
    name = "RTL_ALT" if session.link.vehicle.spec.flavour == "ardupilot" else "COM_FLTMODE1"
    _, everything = session.run(
        lambda vehicle: vehicle.set_parameter(name, -1.0), lambda vehicle: vehicle.parameters()
    )
    assert everything[name].value == session.parameter(name) == -1.0
    assert sorted(everything) == sorted(session.link.vehicle.autopilot.parameters.names)


def test_clearing_says_what_was_there(session: Session) -> None:
    _, mission, rally, kept, fence, nothing = session.run(
        upload(WHOLE),
        lambda vehicle: vehicle.clear(MISSION),
        lambda vehicle: vehicle.clear(RALLY),
        lambda vehicle: vehicle.kept(FENCE),
        lambda vehicle: vehicle.clear(FENCE),
        lambda vehicle: vehicle.clear(FENCE),
    )
    assert (mission.notes, rally.notes) == (("cleared a mission of 3 items",), ("cleared 1 rally point",))
    assert kept.notes == ("it keeps a fence of 1 area; --clear-fence removes it",)
    assert fence.notes[0] == "cleared a fence of 1 area"
    if session.link.vehicle.spec.flavour == "ardupilot":
        assert fence.notes[1] == "its circle and altitude fences act on: FENCE_ENABLE 1, FENCE_TYPE 7"
    assert nothing.notes == ()


def test_a_plan_of_another_place_is_told_of(session: Session) -> None:
    away = Plan(items=(PlanItem(command=16, frame=3, params=(0.0, 0.0, 0.0, None, 47.4, 8.5, 20.0)),))
    far, near = session.run(lambda v: v.place_warnings(away), lambda v: v.place_warnings(WHOLE))
    assert re.fullmatch(r"the plan is 14,\d\d\d\.\d km from the vehicle: .*", far[0])
    assert near == ()


def test_an_armed_vehicle_loses_nothing_without_force(ardupilot: Session) -> None:
    async def ask(vehicle: Vehicle) -> None:
        vehicle.expect_disarmed(force=False)
        vehicle._link.state.armed = True
        vehicle.expect_disarmed(force=True)
        with pytest.raises(VehicleError, match="it is armed; nothing was removed"):
            vehicle.expect_disarmed(force=False)

    ardupilot.run(ask)


def test_who_is_not_heard_is_named_with_who_is(ardupilot: Session) -> None:
    with pytest.raises(
        VehicleError, match=r"drone 7: its autopilot is not heard on simulated; heard there: 1"
    ):
        asyncio.run(find_vehicle([ardupilot.link], 7, 255))


def test_parameters_need_no_mavsdk(ardupilot: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ListTransfers, "__init__", None)
    (held,) = ardupilot.run(lambda vehicle: vehicle.parameter("RTL_ALT"))
    assert held.value == 1500.0
    assert ardupilot.link.vehicle.spec.flavour == Flavour.ARDUPILOT


def test_names_are_written_in_capitals() -> None:
    assert check_parameter("rtl_alt", -1.0) == "RTL_ALT"
    for name in ("", "A" * 17, "RTL-ALT", "RTL ALT", "Ä"):
        with pytest.raises(GroundError, match="1 to 16 letters"):
            check_parameter(name)
