"""What a vehicle is doing: armed or not, landed or not, its manoeuvre, its home. No messages in here."""

from __future__ import annotations

from collections.abc import Callable

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot.maneuvers import Idle, Land, Maneuver, Navigation, Return, TakeOff
from simvehicle.autopilot.mission_run import MissionRun
from simvehicle.vehicle.controller import Limits, Motion
from simvehicle.vehicle.dynamics import GRAVITY_MPS2
from simvehicle.vehicle.vehicle import PhysicalVehicle

TICK_S = 0.02


class Flight:
    """Flies the vehicle by its present manoeuvre; modes, failsafes and commands change the manoeuvre."""

    def __init__(
        self, vehicle: PhysicalVehicle, limits: Limits, ready_after_s: float, say: Callable[[int, str], None]
    ) -> None:
        self.vehicle = vehicle
        self.ready_after_s = ready_after_s
        self._say = say
        self.now_s = 0.0
        self.boot_s = 0.0
        self.armed = False
        self.armed_s = 0.0
        self.landed = True
        self.crashed = False
        self.failsafe = False
        """Some failsafe has the vehicle: HEARTBEAT says CRITICAL."""
        self.home_m: Vector3 | None = None
        self.home: Geodetic | None = None
        """The same on the earth."""
        self.origin_is_set = False
        self.maneuver: Maneuver = Idle()
        self.motion = Motion(idle=True)
        self.limits = limits
        self.nav = Navigation(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, False, (0.0, 0.0, 0.0), limits, 0.0)
        self.wind_estimate: Vector3 = (0.0, 0.0, 0.0)
        self.landed_after_s = 1.7
        """From touching the ground to being sure of it; as recorded of an ArduCopter."""
        self.after_disarming: list[Callable[[], None]] = []
        """Called in their order when it was disarmed."""
        self._on_ground_s = 0.0

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Time since power-up."""
        return self.now_s - self.boot_s

    @property
    def inner_maneuver(self) -> Maneuver | None:
        """The manoeuvre, or of a mission that of its item."""
        return self.maneuver.maneuver if isinstance(self.maneuver, MissionRun) else self.maneuver

    @property
    def is_landing(self) -> bool:
        maneuver = self.inner_maneuver
        return isinstance(maneuver, Land) or (isinstance(maneuver, Return) and maneuver.landing)

    @property
    def wants_to_fly(self) -> bool:
        """On the ground, but about to leave it."""
        return isinstance(self.inner_maneuver, TakeOff) or not self.motion.idle

    @property
    def above_home_m(self) -> float:
        return self.nav.above_home_m

    @property
    def here(self) -> Geodetic:
        """Where it believes to be."""
        return self.vehicle.estimator.geodetic(self.nav.position_m)

    # -- what others change ---------------------------------------------------------------------------------

    def set_limits(self, limits: Limits) -> None:
        self.limits = self.nav.limits = limits

    def set_home(self, home_m: Vector3) -> None:
        self.home_m = self.nav.home_m = home_m
        self.home = self.vehicle.estimator.geodetic(home_m)

    def set_origin(self) -> None:
        """The first fix: the local frame and home are known from now on."""
        self.origin_is_set = True
        self.set_home(self.nav.position_m)

    def arm(self) -> None:
        self.armed = True
        self.armed_s = self.now_s
        self.set_home(self.nav.position_m)
        self.vehicle.controller.reset()

    def disarm(self, text: str, severity: int) -> None:
        if not self.armed:
            return
        self.armed = False
        self.maneuver = Idle()
        self.motion = Motion(idle=True)
        self._say(severity, text)
        if self.vehicle.body.on_ground:
            self.landed = True
        for act in self.after_disarming:
            act()

    # -- time -----------------------------------------------------------------------------------------------

    def power_up(self, now_s: float) -> None:
        self.now_s = self.boot_s = now_s

    def sense(self, now_s: float) -> None:
        """Take in what the sensors say at the beginning of a tick."""
        vehicle, nav = self.vehicle, self.nav
        self.now_s = nav.now_s = now_s
        vehicle.sense(now_s, TICK_S)
        estimator = vehicle.estimator
        nav.position_m, nav.velocity_mps = estimator.position_m, estimator.velocity_mps
        nav.yaw_rad = vehicle.body.yaw_rad
        nav.airborne = not self.landed

    def estimate_wind(self) -> None:
        """A tenth of a second of an estimate that follows in about five seconds."""
        blend = 0.1 / 5.0
        north, east, _ = self.wind_estimate
        wind = self.vehicle.wind_ned_mps
        self.wind_estimate = (north + blend * (wind[0] - north), east + blend * (wind[1] - east), 0.0)

    def move(self) -> float | None:
        """Fly one tick: the specific thrust wanted downwards, m/s^2; None where nothing moves."""
        if self.armed:
            self.motion = self.maneuver.step(self.nav)
            return self.vehicle.move(TICK_S, self.motion, self.limits)[2]
        return 0.0 if self.vehicle.fall(TICK_S) else None

    def take_impact_mps(self) -> float | None:
        """The speed at which it touched the ground in this tick."""
        impact_mps, self.vehicle.body.impact_mps = self.vehicle.body.impact_mps, None
        return impact_mps

    def settle(self, wanted_down_mps2: float) -> bool:
        """Whether the vehicle became sure in this tick that it has landed."""
        if not self.vehicle.body.on_ground:
            self.landed = False
            self._on_ground_s = 0.0
        elif not self.landed and -wanted_down_mps2 < GRAVITY_MPS2:
            self._on_ground_s += TICK_S
            if self._on_ground_s >= self.landed_after_s:
                self.landed = True
                return True
        return False

    def use_power(self) -> None:
        self.vehicle.battery.step(TICK_S, self.armed, self.vehicle.body.thrust)
