"""What a simulation needs of a vehicle, whether its autopilot is simulated or a real one."""

from __future__ import annotations

from typing import Protocol

from mission.geometry.frames import Vector3
from simvehicle.faults.fault_table import Unheard


class FlownVehicle(Protocol):
    """Bytes and time in, bytes out, and where it really is: world's NED frame."""

    def receive(self, link_index: int, data: bytes) -> None:
        """Bytes that arrived on one of its links."""
        ...

    def step(self, now_s: float) -> None:
        """Everything up to `now_s`, simulated seconds."""
        ...

    def drain(self) -> list[tuple[int, bytes]]:
        """What it sent since the last call: (link index, one frame), oldest first on each link."""
        ...

    @property
    def position_ned_m(self) -> Vector3: ...

    @property
    def velocity_ned_mps(self) -> Vector3: ...

    @property
    def attitude_rad(self) -> Vector3:
        """Roll, pitch, yaw."""
        ...

    @property
    def airborne(self) -> bool: ...

    @property
    def armed(self) -> bool: ...

    @property
    def mode(self) -> str:
        """In the autopilot's own words: GUIDED, RTL, OFFBOARD."""
        ...

    @property
    def battery_fraction(self) -> float: ...

    def set_gps(self, working: bool) -> None: ...

    def set_gps_error(self, north_m: float) -> None: ...

    def set_heard(self, what: Unheard, heard: bool) -> None: ...

    def set_motors(self, working: bool) -> None: ...

    def set_turned_over(self, turned_over: bool) -> None: ...

    def set_range_finder(self, *, silent: bool, lies_m: float) -> None: ...

    def set_silent(self, silent: bool) -> None: ...

    def weaken_battery(self) -> None: ...
