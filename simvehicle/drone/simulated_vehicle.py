"""One simulated vehicle: its body, its autopilot and its links, without any I/O and deterministic by its seed."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.modes import Flavour, mode_name
from flightstack.mavlink.signing import Signing
from mission.geometry.frames import Vector3
from simvehicle.autopilot.ardupilot import ARDUPILOT
from simvehicle.autopilot.autopilot import Autopilot
from simvehicle.autopilot.parameters import Parameters
from simvehicle.autopilot.personality import FlavourRecipe
from simvehicle.autopilot.px4 import PX4
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import Unheard
from simvehicle.vehicle.dynamics import quaternion_of
from simvehicle.world.air import World

_FLAVOURS: dict[str, tuple[FlavourRecipe, Callable[[int], str]]] = {
    "ardupilot": (ARDUPILOT, partial(mode_name, Flavour.ARDUPILOT)),
    "px4": (PX4, partial(mode_name, Flavour.PX4)),
}
"""How each is built, and its words for its custom modes."""


class SimulatedVehicle:
    """Bytes and time in, bytes out, and the truth to look at.

    `step(now_s)` powers it up when called first and then advances physics and protocol to `now_s` (seconds of
    simulated time, also the time of the world's wind and plume). The truth is in the world's NED frame.
    Raises `ValueError` for parameters that the flavour does not have.
    """

    def __init__(
        self,
        spec: VehicleSpec,
        world: World,
        *,
        seed: int,
        ready_after_s: float,
        signing: Signing | None = None,
    ) -> None:
        """`ready_after_s`: from power-up until the autopilot lets itself be armed. `signing`: the key of
        `spec.signing_key`, and how late it is."""
        self.spec = spec
        recipe, self._mode_name = _FLAVOURS[spec.flavour]
        self.autopilot = Autopilot(
            recipe,
            Parameters(spec.flavour, spec.parameters),
            world,
            system=spec.id,
            home_ned_m=spec.home_ned_m,
            links=len(spec.links),
            ready_after_s=ready_after_s,
            seed=seed,
            quiet=spec.quiet,
            signing=signing,
            usb_links=spec.usb_links,
            range_finder=spec.range_finder,
        )
        self._body = self.autopilot.vehicle.body

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

    @property
    def position_error_m(self) -> float:
        """How far from where it is its autopilot believes it to be."""
        estimator = self.autopilot.vehicle.estimator
        believed = (a + b for a, b in zip(estimator.position_m, estimator.origin_ned_m, strict=True))
        return math.dist(tuple(believed), self.position_ned_m)

    @property
    def airborne(self) -> bool:
        return not self._body.on_ground

    @property
    def at_rest(self) -> bool:
        """On the ground, and its motors do not turn or do not work."""
        return not self.airborne and (self._body.failed or not self.armed)

    @property
    def controllable(self) -> bool:
        """In the air with motors that work: nobody can keep apart what falls."""
        return self.airborne and not self._body.failed

    @property
    def armed(self) -> bool:
        return self.autopilot.flight.armed

    @property
    def ready(self) -> bool:
        """Its autopilot's estimate is good enough to fly with."""
        return self.autopilot.personality.estimate.ready

    @property
    def mode(self) -> str:
        """In the autopilot's own words: GUIDED, RTL, OFFBOARD."""
        return self._mode_name(self.custom_mode)

    @property
    def custom_mode(self) -> int:
        """As HEARTBEAT has it."""
        return self.autopilot.personality.modes.custom_mode

    @property
    def silent(self) -> bool:
        """Its autopilot neither sends nor hears."""
        return self.autopilot.silent

    @property
    def battery_fraction(self) -> float:
        return self.autopilot.vehicle.battery.fraction

    # -- what goes wrong ------------------------------------------------------------------------------------

    def set_gps(self, working: bool) -> None:
        self.autopilot.vehicle.estimator.gps = working

    def set_gps_error(self, north_m: float) -> None:
        """The receiver is off by this, and the estimator follows it at once."""
        self.autopilot.vehicle.estimator.gps_error_north_m = north_m

    def set_heard(self, what: Unheard, heard: bool) -> None:
        """Whether the autopilot hears what it has a failsafe for."""
        if heard:
            self.autopilot.personality.unheard.discard(what)
        else:
            self.autopilot.personality.unheard.add(what)

    def set_range_finder(self, *, silent: bool, lies_m: float) -> None:
        """Whether its range finder says nothing, and how much farther than they are it sees things."""
        report = self.autopilot.obstacle_report
        if report is not None:
            report.finder.silent, report.finder.lies_m = silent, lies_m

    def set_silent(self, silent: bool) -> None:
        """Its radio is dead: it neither sends nor hears."""
        self.autopilot.silent = silent

    def set_motors(self, working: bool) -> None:
        self._body.failed = not working

    def set_turned_over(self, turned_over: bool) -> None:
        """It falls on its back, motors stopped."""
        self._body.failed = self._body.turned_over = turned_over

    def weaken_battery(self) -> None:
        """A cell fails: what is left is below the limit at which the stock battery failsafe acts."""
        self.autopilot.weaken_battery()

    def drop_battery_to(self, fraction: float) -> None:
        """What is left of its charge is at most this fraction."""
        self.autopilot.vehicle.battery.drop_to(fraction)

    def switch_mode(self, custom_mode: int) -> None:
        """As a pilot does with the remote control's switch."""
        self.autopilot.personality.switch_mode(custom_mode)

    def stop_motors(self, text: str) -> None:
        """It disarms wherever it is, and says why."""
        self.autopilot.flight.disarm(text, mavlink.MAV_SEVERITY_INFO)
