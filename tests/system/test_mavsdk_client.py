"""An independent client, the MAVSDK library, flies both flavours over UDP: everything that issue 2 asks of them."""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.process import Fleet, run
from simvehicle.survey.ports import free_port
from simvehicle.world.world_config import WindConfig

pytestmark = pytest.mark.system
mavsdk = pytest.importorskip("mavsdk.asyncio", reason="needs the extra 'ground' (mavsdk)")

ORIGIN = Geodetic(-5.06, 151.3, 500.0)
SPEEDUP = 5.0
HOME_X, HOME_Y = -50600000, 1513000000
PARAMETERS = {
    "ardupilot": {"RTL_LOIT_TIME": 500.0, "LAND_SPEED": 150.0, "WPNAV_SPEED": 800.0},
    "px4": {
        "RTL_RETURN_ALT": 12.0,
        "RTL_DESCEND_ALT": 8.0,
        "MPC_LAND_SPEED": 1.2,
        "MIS_TAKEOFF_ALT": 5.0,
        # The client's 20 setpoints a second of the wall's are 4 of the vehicle's: a stall of the machine is no loss.
        "COM_OF_LOSS_T": 10.0,
    },
}


@contextlib.contextmanager
def flying(flavour: str, port: int) -> Iterator[SimulatedVehicle]:
    """One vehicle that sends to a port of this machine, run by a thread."""
    config = FleetConfig(
        origin=ORIGIN,
        vehicles=(
            VehicleSpec(
                id=3,
                flavour=flavour,  # type: ignore[arg-type]
                links=(f"udpout:127.0.0.1:{port}",),
                parameters=PARAMETERS[flavour],
            ),
        ),
        wind=WindConfig(speed_mps=4.0, from_deg=200.0),
        speedup=SPEEDUP,
        ready_after_s=15.0,
        seed=7,
    )
    fleet, stop = Fleet(config), threading.Event()
    thread = threading.Thread(target=run, args=(fleet, stop))
    thread.start()
    try:
        yield fleet.drones.by_id[3].vehicle
    finally:
        stop.set()
        thread.join()


async def until(what: str, done: Callable[[], bool], limit_s: float = 40.0) -> None:
    """Wait (wall seconds) until something is true of the simulated vehicle."""
    for _ in range(int(limit_s / 0.05)):
        if done():
            return
        await asyncio.sleep(0.05)
    pytest.fail(f"never came true: {what}")


async def first(stream: Any, wanted: Callable[[Any], bool], limit_s: float = 40.0) -> Any:
    """The first of a subscription that is as wanted."""

    async def search() -> Any:
        async for item in stream:
            if wanted(item):
                return item
        return None

    return await asyncio.wait_for(search(), limit_s)


def at(vehicle: SimulatedVehicle, north_m: float, east_m: float, above_m: float) -> bool:
    return math.dist(vehicle.position_ned_m, (north_m, east_m, -above_m)) < 1.5


class Client:
    """The plugins that the flight needs."""

    def __init__(self, system: Any) -> None:
        from mavsdk.asyncio.plugins.action import ActionAsync
        from mavsdk.asyncio.plugins.geofence import GeofenceAsync
        from mavsdk.asyncio.plugins.info import InfoAsync
        from mavsdk.asyncio.plugins.mission import MissionAsync
        from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
        from mavsdk.asyncio.plugins.offboard import OffboardAsync
        from mavsdk.asyncio.plugins.param import ParamAsync
        from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

        self.action = ActionAsync(system)
        self.geofence = GeofenceAsync(system)
        self.info = InfoAsync(system)
        self.mission = MissionAsync(system)
        self.raw = MissionRawAsync(system)
        self.offboard = OffboardAsync(system)
        self.param = ParamAsync(system)
        self.telemetry = TelemetryAsync(system)


async def connected(port: int, flight: Callable[[Client], Awaitable[None]]) -> None:
    from mavsdk.asyncio import ComponentType, Configuration, Mavsdk

    # A call blocks a thread of the executor; the default one has too few.
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(max_workers=24))
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        await sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = await sdk.first_autopilot(timeout_s=15.0)
        assert system is not None, "not discovered"
        assert await system.get_system_id() == 3
        await flight(Client(system))
    finally:
        sdk.destroy()


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_whole_flight(flavour: str) -> None:
    port = free_port(socket.SOCK_DGRAM)
    with flying(flavour, port) as vehicle:
        asyncio.run(connected(port, lambda client: whole_flight(client, vehicle, flavour)))


async def whole_flight(client: Client, vehicle: SimulatedVehicle, flavour: str) -> None:
    await health(client, vehicle)
    await parameters(client, flavour)
    await lists(client)
    await take_off(client, vehicle)
    await go_to(client, vehicle)
    await offboard(client, vehicle, flavour)
    await mission(client, vehicle, flavour)
    await client.action.return_to_launch()
    await until("home and disarmed", lambda: not vehicle.armed)
    assert math.dist(vehicle.position_ned_m, (0.0, 0.0, 0.0)) < 2.0
    await land(client, vehicle)


async def health(client: Client, vehicle: SimulatedVehicle) -> None:
    telemetry = client.telemetry
    for set_rate in (
        telemetry.set_rate_position,
        telemetry.set_rate_home,
        telemetry.set_rate_in_air,
        telemetry.set_rate_battery,
        telemetry.set_rate_attitude_euler,
        telemetry.set_rate_position_velocity_ned,
        telemetry.set_rate_gps_info,
        telemetry.set_rate_health,
    ):
        await set_rate(5.0)
    assert await first(telemetry.subscribe_health_all_ok(), bool)
    assert await first(telemetry.subscribe_health(), lambda state: state.is_armable)
    version = await client.info.get_version()
    assert version.flight_sw_major in (1, 4)
    position = await telemetry.position()
    assert position.latitude_deg == pytest.approx(ORIGIN.latitude_deg, abs=2e-5)
    assert position.longitude_deg == pytest.approx(ORIGIN.longitude_deg, abs=2e-5)
    assert position.relative_altitude_m == pytest.approx(0.0, abs=1.0)
    battery = await telemetry.battery()
    assert 12.0 < battery.voltage_v < 12.7
    assert not await telemetry.armed()
    assert not await telemetry.in_air()
    assert not vehicle.armed


async def parameters(client: Client, flavour: str) -> None:
    real, whole = (
        ("WPNAV_SPEED", "FENCE_ACTION") if flavour == "ardupilot" else ("MPC_XY_CRUISE", "GF_ACTION")
    )
    await client.param.set_param_float(real, 7.5)
    assert await client.param.get_param_float(real) == pytest.approx(7.5)
    await client.param.set_param_float(real, 700.0 if flavour == "ardupilot" else 7.0)
    # 1 is ArduPilot's default: one of a group that is set to that it tells as a float, which this client refuses.
    await client.param.set_param_int(whole, 2)
    assert await client.param.get_param_int(whole) == 2
    everything = await client.param.get_all_params()
    assert len(everything.int_params) + len(everything.float_params) > 90


def square(north_m: float, east_m: float, half_m: float) -> Any:
    from mavsdk.plugins.geofence import FenceType, Point, Polygon

    degree_m = 110_800.0
    corners = [(-half_m, -half_m), (-half_m, half_m), (half_m, half_m), (half_m, -half_m)]
    points = [
        Point(ORIGIN.latitude_deg + (north_m + n) / degree_m, ORIGIN.longitude_deg + (east_m + e) / degree_m)
        for n, e in corners
    ]
    return Polygon(points, FenceType.INCLUSION)


async def lists(client: Client) -> None:
    """A fence and rally points go up and come back."""
    from mavsdk.plugins.geofence import GeofenceData
    from mavsdk.plugins.mission_raw import MissionItem

    await client.geofence.upload_geofence(GeofenceData([square(0.0, 0.0, 150.0)], []))
    fence = await client.raw.download_geofence()
    assert [(item.command, item.param1) for item in fence] == [(5001, 4.0)] * 4
    rally = MissionItem(
        seq=0, frame=3, command=5100, current=1, autocontinue=1, x=HOME_X, y=HOME_Y, z=15.0, mission_type=2
    )
    await client.raw.upload_rally_points([rally])
    back = await client.raw.download_rallypoints()
    assert [(item.x, item.y, item.z) for item in back] == [(HOME_X, HOME_Y, 15.0)]


async def take_off(client: Client, vehicle: SimulatedVehicle) -> None:
    await client.action.set_takeoff_altitude(8.0)
    await client.action.arm()
    await client.action.takeoff()
    await until("at 8 m", lambda: at(vehicle, 0.0, 0.0, 8.0))
    assert await first(client.telemetry.subscribe_in_air(), bool)
    assert await client.telemetry.armed()


async def go_to(client: Client, vehicle: SimulatedVehicle) -> None:
    # PX4 changes from its take-off mode to Hold by itself, and would leave the goal for it.
    await until("the take-off is over", lambda: vehicle.mode != "TAKEOFF")
    await client.action.goto_location(-5.0598, 151.3, 512.0, 0.0)
    await until("22 m north, 12 m up", lambda: at(vehicle, 22.1, 0.0, 12.0))


async def offboard(client: Client, vehicle: SimulatedVehicle, flavour: str) -> None:
    from mavsdk.plugins.offboard import PositionNedYaw, VelocityNedYaw

    for _ in range(2):  # PX4 enters the mode when they come often enough: one alone has no rate
        await client.offboard.set_position_ned(PositionNedYaw(10.0, 10.0, -10.0, 90.0))
    await client.offboard.start()
    assert await client.offboard.is_active()
    await until("at the offboard position", lambda: at(vehicle, 10.0, 10.0, 10.0))
    assert vehicle.mode == ("GUIDED" if flavour == "ardupilot" else "OFFBOARD")
    await client.offboard.set_velocity_ned(VelocityNedYaw(0.0, 3.0, 0.0, 90.0))
    await until("flying east", lambda: vehicle.velocity_ned_mps[1] > 2.5)
    await until("15 m further east", lambda: vehicle.position_ned_m[1] > 25.0)
    await client.offboard.stop()
    await client.action.hold()
    await until("stopped", lambda: math.hypot(*vehicle.velocity_ned_mps) < 0.4)
    assert vehicle.mode == ("BRAKE" if flavour == "ardupilot" else "HOLD")


async def mission(client: Client, vehicle: SimulatedVehicle, flavour: str) -> None:
    await (mission_with_home(client) if flavour == "ardupilot" else mission_plan(client))
    finished = asyncio.ensure_future(
        until("the last waypoint", lambda: at(vehicle, 11.1, 33.1, 14.0), limit_s=60.0)
    )
    await (client.raw if flavour == "ardupilot" else client.mission).start_mission()
    await until("the first waypoint", lambda: at(vehicle, 33.2, 33.1, 14.0))
    await finished
    if flavour == "px4":
        await until("holding", lambda: vehicle.mode == "HOLD")
        for _ in range(100):  # MAVSDK learns it from the next MISSION_CURRENT
            if await client.mission.is_mission_finished():
                break
            await asyncio.sleep(0.05)
        else:
            pytest.fail("MAVSDK never saw the mission's end")


async def mission_with_home(client: Client) -> None:
    """ArduPilot takes item 0 as home, so the raw plugin has to send one."""
    from mavsdk.plugins.mission_raw import MissionItem

    def item(seq: int, command: int, x: int, y: int, z: float, frame: int = 3) -> Any:
        return MissionItem(
            seq=seq, frame=frame, command=command, current=int(seq == 0), autocontinue=1, x=x, y=y, z=z
        )

    items = [
        item(0, 16, HOME_X, HOME_Y, 500.0, frame=0),
        item(1, 22, HOME_X, HOME_Y, 10.0),
        item(2, 16, -50597000, 1513003000, 14.0),
        item(3, 16, -50599000, 1513003000, 14.0),
    ]
    await client.raw.upload_mission(items)
    back = await client.raw.download_mission()
    assert [(each.command, each.z) for each in back[1:]] == [(22, 10.0), (16, 14.0), (16, 14.0)]


async def mission_plan(client: Client) -> None:
    from mavsdk.plugins.mission import MissionItem, MissionPlan

    camera, action = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
    nan = math.nan

    def item(latitude_deg: float, longitude_deg: float) -> Any:
        return MissionItem(
            latitude_deg, longitude_deg, 14.0, 6.0, True, nan, nan, camera, nan, nan, 1.0, nan, nan, action
        )

    await client.mission.upload_mission(MissionPlan([item(-5.0597, 151.3003), item(-5.0599, 151.3003)]))
    back = await client.mission.download_mission()
    assert [round(each.relative_altitude_m) for each in back.mission_items] == [14, 14]


async def land(client: Client, vehicle: SimulatedVehicle) -> None:
    """Once more up, then down where it is."""
    from mavsdk.plugins.offboard import PositionNedYaw
    from mavsdk.plugins.telemetry import FlightMode

    if vehicle.spec.flavour == "ardupilot":  # cannot be armed in RTL; this is MAVSDK's way into GUIDED
        await client.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, 0.0, 0.0))
        await client.offboard.start()
        # Until it has seen the mode, MAVSDK would go to Hold (BRAKE) before it arms.
        await first(client.telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.OFFBOARD)
    await client.action.arm()
    if vehicle.spec.flavour == "ardupilot":
        await client.offboard.stop()
        await first(client.telemetry.subscribe_flight_mode(), lambda mode: mode != FlightMode.OFFBOARD)
    await client.action.takeoff()
    await until("up again", lambda: vehicle.position_ned_m[2] < -7.0)
    await client.action.land()
    await until("landed and disarmed", lambda: not vehicle.armed and not vehicle.airborne)
    assert not await first(client.telemetry.subscribe_armed(), lambda armed: not armed)


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_refusals_reach_the_client(flavour: str) -> None:
    """What cannot be done now is refused at once instead of running into a time-out."""
    port = free_port(socket.SOCK_DGRAM)

    async def refused(client: Client) -> None:
        from mavsdk.plugins.action import ActionError, ActionResult

        with pytest.raises(ActionError) as caught:
            await client.action.arm()
        assert caught.value.result is not ActionResult.TIMEOUT
        with pytest.raises(ActionError) as caught:
            await client.action.goto_location(-5.06, 151.3, 512.0, 0.0)
        assert caught.value.result is not ActionResult.TIMEOUT

    with flying(flavour, port) as vehicle:
        asyncio.run(connected(port, refused))
        assert not vehicle.armed
