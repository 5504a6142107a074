#!/usr/bin/env python3
"""Takes the options of ArduCopter and runs our simulated vehicle: it tests the harness, not the agent."""

from __future__ import annotations

import argparse
import pathlib
import signal
import threading
import time

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.process import Fleet
from simvehicle.world.world_config import WindConfig

PERIOD_WALL_S = 0.005
MOST_S = 0.1
"""As ArduCopter's, its time falls behind the wall's on a machine that is too slow, and never makes up for it."""


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--home", required=True)
    parser.add_argument("--speedup", type=float, required=True)
    parser.add_argument("--sysid", type=int, required=True)
    parser.add_argument("--defaults", required=True)
    for ignored in ("--model", "--instance", "--rc-in-port"):
        parser.add_argument(ignored, required=True)
    for number in range(3):
        parser.add_argument(f"--serial{number}", required=True)
    options = parser.parse_args()
    parameters = {}
    for file in options.defaults.split(","):
        for line in pathlib.Path(file).read_text(encoding="utf-8").splitlines():
            name, value = line.split()
            parameters[name] = float(value)
    wind = WindConfig(speed_mps=parameters.pop("SIM_WIND_SPD"), from_deg=parameters.pop("SIM_WIND_DIR"))
    assert parameters.pop("SIM_WIND_T") == 1.0, "our wind is the same at all heights"
    latitude_deg, longitude_deg, amsl_m, _ = map(float, options.home.split(","))
    links = [getattr(options, f"serial{n}").replace("udpclient:", "udpout:") for n in range(3)]
    pathlib.Path("eeprom.bin").write_bytes(b"")  # as ArduCopter does, where it is started
    fleet = Fleet(
        FleetConfig(
            origin=Geodetic(latitude_deg, longitude_deg, amsl_m),
            vehicles=(VehicleSpec(id=options.sysid, links=tuple(links), parameters=parameters),),
            wind=wind,
            speedup=options.speedup,
            seed=options.sysid,
        )
    )
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    now_s, wall_s = 0.0, time.monotonic()
    while not stop.is_set():
        before_s, wall_s = wall_s, time.monotonic()
        now_s += min((wall_s - before_s) * options.speedup, MOST_S)
        fleet.step(now_s)
        stop.wait(PERIOD_WALL_S)
    fleet.close()


if __name__ == "__main__":
    main()
