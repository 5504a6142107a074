"""Scenarios have the faults of their configuration, as launched surveys have."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import msgspec
import pytest

from flightstack.agent import Inputs, Outputs
from flightstack.config import DroneConfig
from flightstack.swarm.wire import CommandName
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.fleet_problems import FleetError
from simvehicle.scenario.swarm import Scenario


def scenario(
    *faults: FaultSpec,
    parameters: Mapping[int, dict[str, float]] = MappingProxyType({}),
) -> Scenario:
    co2 = EmulatedInstrument(name="co2", type="sba5", port="127.0.0.1:1")
    fleet = FleetConfig(
        origin=Geodetic(-5.06, 151.3, 500.0),
        vehicles=tuple(
            VehicleSpec(
                id=n,
                home_east_m=8.0 * n,
                links=("udpout:127.0.0.1:1",),
                instruments=(co2,),
                parameters=parameters.get(n, {}),
            )
            for n in (1, 2)
        ),
        ready_after_s=3.0,
        faults=faults,
    )
    drones = [
        msgspec.convert(
            {
                "drone": n,
                "swarm": {"name": "pair", "members": [1, 2]},
                "origin": msgspec.to_builtins(fleet.origin),
                "autopilot": {"link": "udpin:127.0.0.1:1", "flavour": "ardupilot"},
                "instruments": [{"name": "co2", "type": "sba5", "port": "socket://127.0.0.1:1"}],
            },
            DroneConfig,
        )
        for n in (1, 2)
    ]
    flight = Scenario(drones, fleet)
    flight.run(2.0)
    flight.command(CommandName.START)
    assert flight.run_until(lambda: flight.first_takeoff_s is not None, 40.0)
    return flight


def test_a_cable_is_pulled_and_put_in_again_as_configured() -> None:
    flight = scenario(FaultSpec(drone=2, at_s=3.0, kind="unplug", instrument="co2", until_s=6.0))
    began_s = flight.first_takeoff_s
    assert began_s is not None
    seen: list[tuple[float, str]] = []

    def tap(drone: int, now_s: float, heard: Inputs, _said: Outputs) -> None:
        ports = [port for port in heard.ports if drone == 2 and (port.lost or port.connected)]
        seen.extend((now_s - began_s, port.lost or "connected") for port in ports)

    flight.tap = tap
    flight.run(8.0)
    assert [what for _, what in seen] == ["unplugged", "connected"]
    assert [since_s for since_s, _ in seen] == pytest.approx([3.0, 6.0], abs=0.11)


def test_a_fault_that_cannot_be_is_refused_as_by_a_fleet() -> None:
    with pytest.raises(FleetError, match=r"faults\[0\]\.instrument"):
        scenario(FaultSpec(drone=2, at_s=3.0, kind="unplug", instrument="wind"))


def test_without_its_ground_link_a_vehicle_does_what_its_parameters_say() -> None:
    faults = tuple(FaultSpec(drone=n, at_s=12.0, kind="failsafe", unheard="ground_link") for n in (1, 2))
    flight = scenario(*faults, parameters={2: {"FS_GCS_ENABLE": 5.0}})
    flight.run(18.0)
    assert [member.vehicle.mode for member in flight.members.values()] == ["GUIDED", "LAND"]


def test_gps_that_is_off_makes_the_vehicle_be_elsewhere() -> None:
    flight = scenario(FaultSpec(drone=2, at_s=20.0, kind="gps_jump", by_m=4.0, until_s=40.0))
    flight.run(14.0)
    flight.command(CommandName.PAUSE)
    flight.run(5.5)
    vehicle = flight.members[2].vehicle
    north_m = vehicle.position_ned_m[0]
    flight.run(18.5)
    assert vehicle.position_ned_m[0] == pytest.approx(north_m - 4.0, abs=0.7)
    assert vehicle.position_error_m == pytest.approx(4.0, abs=0.7)
    flight.run(12.0)
    assert vehicle.position_ned_m[0] == pytest.approx(north_m, abs=0.7)
    assert vehicle.position_error_m < 0.7


@pytest.mark.parametrize(
    ("fault", "field"),
    [
        (FaultSpec(drone=2, at_s=3.0, kind="failsafe"), "unheard"),
        (FaultSpec(drone=2, at_s=3.0, kind="motor", unheard="ground_link"), "unheard"),
        (FaultSpec(drone=2, at_s=3.0, kind="motor", instrument="co2"), "instrument"),
        (FaultSpec(drone=2, at_s=3.0, kind="lying"), "instrument"),
    ],
)
def test_a_fault_has_what_its_kind_needs_and_nothing_else(fault: FaultSpec, field: str) -> None:
    with pytest.raises(FleetError, match=rf"faults\[0\]\.{field}"):
        scenario(fault)


def test_a_silent_vehicle_is_not_heard_by_its_agent() -> None:
    flight = scenario(FaultSpec(drone=1, at_s=4.0, kind="silence", until_s=7.0))
    began_s = flight.first_takeoff_s
    assert began_s is not None
    heard: dict[int, list[float]] = {1: [], 2: []}

    def tap(drone: int, now_s: float, inputs: Inputs, _said: Outputs) -> None:
        if inputs.autopilot:
            heard[drone].append(now_s - began_s)

    flight.tap = tap
    flight.run(9.0)
    during = {drone: sum(4.1 < since_s < 6.95 for since_s in times) for drone, times in heard.items()}
    assert during[1] == 0
    assert during[2] > 20
    assert any(since_s > 7.0 for since_s in heard[1])
