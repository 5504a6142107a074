"""What ArduCopter notices of its own fall (`crash_check.cpp`): lost thrust on the way, a crash by its attitude."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.parameters import Parameters

_THRUST_LOSS_S = 1.0
_CRASH_S = 2.0
_CRASH_LEAN_DEG = 30.0
_CRASH_MPS = 10.0


class ArduPilotMishaps:
    """`step` is called ten times a second."""

    def __init__(self, flight: Flight, parameters: Parameters, announcer: Announcer) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._sinking_since_s: float | None = None
        self._leaning_since_s: float | None = None
        self._told = False

    def step(self, now_s: float) -> None:
        flight = self._flight
        if not flight.armed or flight.landed:
            self._sinking_since_s = self._leaning_since_s = None
            self._told = False
            return
        self._thrust_loss(now_s)
        self._crash(now_s)

    def _thrust_loss(self, now_s: float) -> None:
        """Full throttle, level, and down it goes."""
        body = self._flight.vehicle.body
        sinking = body.failed and not body.turned_over and not body.on_ground and body.velocity[2] > 0.0
        if not sinking:
            self._sinking_since_s = None
        elif self._sinking_since_s is None:
            self._sinking_since_s = now_s
        elif now_s - self._sinking_since_s >= _THRUST_LOSS_S and not self._told:
            self._told = True
            self._announcer.say(mavlink.MAV_SEVERITY_EMERGENCY, "Potential Thrust Loss (1)")

    def _crash(self, now_s: float) -> None:
        """Far from the attitude that it wants for two seconds, and slow. A fall itself is too fast for it."""
        body = self._flight.vehicle.body
        roll_rad, pitch_rad, _ = body.attitude_rad
        error_deg = math.degrees(math.acos(math.cos(roll_rad) * math.cos(pitch_rad)))
        slow = math.hypot(*body.velocity) < _CRASH_MPS
        if not self._parameters["FS_CRASH_CHECK"] or error_deg <= _CRASH_LEAN_DEG or not slow:
            self._leaning_since_s = None
        elif self._leaning_since_s is None:
            self._leaning_since_s = now_s
        elif now_s - self._leaning_since_s >= _CRASH_S:
            text = f"Crash: Disarming: AngErr={error_deg:.0f}>30, Accel=0.0<3.0"
            self._flight.disarm(text, mavlink.MAV_SEVERITY_EMERGENCY)
