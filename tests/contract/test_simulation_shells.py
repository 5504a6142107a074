"""One core under every shell: what a scenario's agents hear in one process, a fleet's processes hear over sockets.

A scenario is flown and recorded; then what its agents said is sent, tick by tick, to the sockets of a fleet with the
same configuration. Byte for byte the same must come back, through a take-off and a fault.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from typing import NamedTuple

import msgspec
import pytest

from flightstack.agent import Inputs, Outputs
from flightstack.config import DroneConfig
from flightstack.swarm.wire import CommandName
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import EmulatedInstrument, VehicleSpec
from simvehicle.faults.fault_table import FaultSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.process import Fleet
from simvehicle.scenario.swarm import Scenario
from simvehicle.world.world_config import GaussianPlume

HOST = "127.0.0.1"


class Tick(NamedTuple):
    now_s: float
    heard: Inputs
    said: Outputs


def fleet_config(flavour: str, link_port: int, instrument_port: int) -> FleetConfig:
    co2 = EmulatedInstrument(name="co2", type="sba5", port=f"{HOST}:{instrument_port}")
    return FleetConfig(
        origin=Geodetic(-5.06, 151.3, 500.0),
        vehicles=(
            VehicleSpec(
                id=1,
                flavour=flavour,  # type: ignore[arg-type]
                links=(f"udpin:{HOST}:{link_port}",),
                instruments=(co2,),
            ),
        ),
        plume=GaussianPlume(source_north_m=20.0, source_east_m=0.0),
        ready_after_s=3.0,
        seed=11,
        faults=(
            FaultSpec(drone=1, at_s=6.0, kind="unplug", instrument="co2", until_s=9.0),
            FaultSpec(drone=1, at_s=7.0, kind="gps_loss", until_s=8.0),
        ),
    )


def flown_in_a_scenario(config: FleetConfig) -> list[Tick]:
    flavour = config.vehicles[0].flavour
    parameters = {"COM_OBL_RC_ACT": 3, "RTL_CONE_ANG": 0} if flavour == "px4" else {}
    drone = msgspec.convert(
        {
            "drone": 1,
            "swarm": {"name": "shells", "members": [1]},
            "origin": msgspec.to_builtins(config.origin),
            "autopilot": {"link": "udpin:127.0.0.1:1", "flavour": flavour, "parameters": parameters},
            "instruments": [{"name": "co2", "type": "sba5", "port": "socket://127.0.0.1:1"}],
            "seed": 11,
        },
        DroneConfig,
    )
    scenario = Scenario([drone], config)
    ticks: list[Tick] = []
    scenario.tap = lambda _drone, now_s, heard, said: ticks.append(Tick(now_s, heard, said))
    scenario.run(2.0)
    scenario.command(CommandName.START)
    assert scenario.run_until(lambda: scenario.first_takeoff_s is not None, 40.0)
    scenario.run(12.0)
    return ticks


class OverSockets:
    """The agent's ends of a fleet's wires."""

    def __init__(self, config: FleetConfig, link_port: int, instrument_port: int) -> None:
        self._instrument_port = instrument_port
        self.fleet = Fleet(config)
        self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._link.connect((HOST, link_port))
        self._link.setblocking(False)
        # A vehicle that waits for datagrams does not know where to send before it heard one: a zero is no message.
        self._link.send(b"\0")
        self._line: socket.socket | None = None
        self.plug()

    def plug(self) -> None:
        self._line = socket.create_connection((HOST, self._instrument_port))
        self._line.setblocking(False)

    def unplug(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None

    def say(self, said: Outputs) -> None:
        # A vehicle that waits for datagrams does not know where to send before it heard one: zeros are no message.
        self._link.send(said.autopilot or b"\\0")
        for _, data in said.ports:
            if self._line is not None:
                self._line.sendall(data)

    def hear(self) -> tuple[bytes, bytes]:
        return b"".join(_arrived(self._link)), b"".join(_arrived(self._line))

    def close(self) -> None:
        self.unplug()
        self._link.close()
        self.fleet.close()


def _arrived(end: socket.socket | None) -> Iterator[bytes]:
    """What lies in the socket: the fleet has sent it in its step, in this thread."""
    while end is not None:
        try:
            data = end.recv(65536)
        except BlockingIOError:
            return
        if not data:
            return
        yield data


@pytest.mark.parametrize("flavour", ["ardupilot", "px4"])
def test_a_scenario_and_a_fleet_say_the_same_bytes(flavour: str, free_port: Callable[..., int]) -> None:
    link_port, instrument_port = free_port(socket.SOCK_DGRAM), free_port()
    config = fleet_config(flavour, link_port, instrument_port)
    ticks = flown_in_a_scenario(config)
    lost = [tick for tick in ticks if any(port.lost for port in tick.heard.ports)]
    assert len(lost) == 1, "the fault of the configuration came"
    over = OverSockets(config, link_port, instrument_port)
    try:
        compared = 0
        for tick in ticks:
            over.fleet.step(tick.now_s)
            ports = tick.heard.ports
            if any(port.lost for port in ports):
                with pytest.raises(ConnectionRefusedError):
                    socket.create_connection((HOST, instrument_port))
                over.unplug()
            elif any(port.connected for port in ports) and compared:
                over.plug()
                over.fleet.step(tick.now_s)  # takes the connection; no time passes
            link, line = over.hear()
            assert link == tick.heard.autopilot, f"at {tick.now_s:.1f} s"
            if not any(port.connected for port in ports):
                assert line == b"".join(port.data for port in ports), f"at {tick.now_s:.1f} s"
            compared += len(link) + len(line)
            over.say(tick.said)
        assert compared > 20_000
    finally:
        over.close()
