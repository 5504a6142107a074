"""How to start the ArduCopter of one vehicle: its parameters and its command line. No process is started here."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence

from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.world.world_config import AnyWindConfig

BATTERY_MAH = 20_000.0
"""Three quarters of an hour of hovering. The stock 3300 mAh are three quarters used after five minutes, and the
agents come home with the last quarter."""


def parameter_text(spec: VehicleSpec, wind: AnyWindConfig) -> str:
    """What its parameter file says of our world and of this vehicle, beside the airframe's defaults."""
    parameters = {
        "SIM_WIND_SPD": wind.speed_mps,
        "SIM_WIND_DIR": wind.from_deg,
        "SIM_WIND_T": 1.0,  # the same wind at all heights: stock is 40 % of it 10 m up
        "BATT_CAPACITY": BATTERY_MAH,
        **spec.parameters,
    }
    return "".join(f"{name} {value:g}\n" for name, value in parameters.items())


def command_line(
    program: str,
    parameter_files: Sequence[str],
    spec: VehicleSpec,
    *,
    speedup: float,
    home: Geodetic,
    monitor: str,
    remote_control_port: int,
    directory: pathlib.Path,
) -> list[str]:
    """All its MAVLink ports are UDP clients: those of `spec.links` and the `monitor`, each as its other end names it.

    It runs in `directory`, where it keeps its parameters. Of the parameter files later ones count.
    """
    ports = [link.replace("udpout:", "udpclient:") for link in spec.links]
    ports.append(monitor.replace("udpin:", "udpclient:"))
    serials = [part for number, port in enumerate(ports) for part in (f"--serial{number}", port)]
    return [
        "/bin/sh", "-c", 'cd "$1" && shift && exec "$@"', "sh", str(directory), program,
        "--model", "+",
        "--speedup", f"{speedup:g}",
        "--home", f"{home.latitude_deg:.7f},{home.longitude_deg:.7f},{home.amsl_m:.2f},0",
        "--defaults", ",".join(parameter_files),
        "--sysid", str(spec.id),
        "--instance", str(spec.id),
        "--rc-in-port", str(remote_control_port),
        *serials,
    ]  # fmt: skip
