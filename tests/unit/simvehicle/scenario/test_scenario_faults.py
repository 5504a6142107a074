"""Scenarios have the faults of their configuration, as launched surveys have."""

from __future__ import annotations

import msgspec
import pytest

from flightstack.agent import Inputs, Outputs
from flightstack.config import DroneConfig
from flightstack.swarm.wire import CommandName
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.scenario.swarm import Scenario


def scenario(*faults: FaultSpec) -> Scenario:
    co2 = EmulatedInstrument(name="co2", type="sba5", port="127.0.0.1:1")
    fleet = FleetConfig(
        origin=Geodetic(-5.06, 151.3, 500.0),
        vehicles=tuple(
            VehicleSpec(id=n, home_east_m=8.0 * n, links=("udpout:127.0.0.1:1",), instruments=(co2,))
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
