"""One simulated vehicle: its body, its autopilot and its links, without any I/O and deterministic by its seed."""

from __future__ import annotations

from flightstack.mavlink.modes import Flavour, mode_name
from mission.geometry.frames import Vector3
from simvehicle.autopilot.ardupilot import ArduPilot
from simvehicle.autopilot.core import Autopilot
from simvehicle.autopilot.px4 import Px4
from simvehicle.fleet.fleet_config import FleetConfig, VehicleSpec
from simvehicle.vehicle.dynamics import in_body, quaternion_of
from simvehicle.world.air import World

_FLAVOURS: dict[str, type[Autopilot]] = {"ardupilot": ArduPilot, "px4": Px4}
_WEAK_BATTERY_FRACTION = {"ardupilot": 0.10, "px4": 0.06}
"""Below the voltage, or the critical fraction, at which the flavour's battery failsafe acts with stock limits."""


class SimulatedVehicle:
    """Bytes and time in, bytes out, and the truth to look at.

    `step(now_s)` powers it up when called first and then advances physics and protocol to `now_s` (seconds of
    simulated time, also the time of the world's wind and plume). The truth is in the world's NED frame.
    Raises `ValueError` for parameters that the flavour does not have.
    """

    def __init__(self, spec: VehicleSpec, fleet: FleetConfig, world: World, seed: int) -> None:
        self.spec = spec
        self.autopilot = _FLAVOURS[spec.flavour](spec, fleet, world, seed)
        self._body = self.autopilot.body

    def receive(self, link_index: int, data: bytes) -> None:
        """Bytes that arrive on the link `spec.links[link_index]`."""
        self.autopilot.receive(link_index, data)

    def step(self, now_s: float) -> None:
        self.autopilot.step(now_s)

    def drain(self) -> list[tuple[int, bytes]]:
        """What the autopilot sent since the last call: (link index, one frame), oldest first on each link."""
        return self.autopilot.drain()

    # -- the truth ------------------------------------------------------------------------------------------

    @property
    def position_ned_m(self) -> Vector3:
        north, east, down = self._body.position
        return north, east, down

    @property
    def velocity_ned_mps(self) -> Vector3:
        north, east, down = self._body.velocity
        return north, east, down

    @property
    def attitude_rad(self) -> Vector3:
        """Roll, pitch, yaw."""
        return self._body.attitude_rad

    @property
    def attitude_quaternion(self) -> tuple[float, float, float, float]:
        """Body to NED, w first."""
        return quaternion_of(self._body.attitude_rad)

    def wind_body_mps(self) -> Vector3:
        """The air's velocity relative to the vehicle, body frame (forward, right, down): what an anemometer feels."""
        wind, velocity = self.autopilot.wind_ned_mps, self._body.velocity
        relative = (wind[0] - velocity[0], wind[1] - velocity[1], wind[2] - velocity[2])
        return in_body(relative, self._body.attitude_rad)

    @property
    def airborne(self) -> bool:
        return not self._body.on_ground

    @property
    def armed(self) -> bool:
        return self.autopilot.armed

    @property
    def mode(self) -> str:
        """In the autopilot's own words: GUIDED, RTL, OFFBOARD."""
        return mode_name(Flavour(self.spec.flavour), self.autopilot.custom_mode)

    @property
    def battery_fraction(self) -> float:
        return self.autopilot.battery.fraction

    # -- what goes wrong ------------------------------------------------------------------------------------

    def set_gps(self, working: bool) -> None:
        self.autopilot.estimator.gps = working

    def set_silent(self, silent: bool) -> None:
        """Its radio is dead: it neither sends nor hears."""
        self.autopilot.silent = silent

    def set_motors(self, working: bool) -> None:
        self._body.failed = not working

    def weaken_battery(self) -> None:
        """A cell fails."""
        self.autopilot.battery.drop_to(_WEAK_BATTERY_FRACTION[self.spec.flavour])
