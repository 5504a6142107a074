"""What keeps an ArduCopter on the ground: arming checks, the pre-arm texts, and disarming by itself.

Texts, order and delays are those of the recorded flight of ArduCopter 4.6.3 where it shows them.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.ardupilot_estimate import ALIGNED_S, ORIGIN_S, ArduPilotEstimate
from simvehicle.autopilot.ardupilot_failsafes import ArduPilotFailsafes
from simvehicle.autopilot.ardupilot_fence import ArduPilotFence
from simvehicle.autopilot.ardupilot_mode_control import ArduPilotModeControl
from simvehicle.autopilot.ardupilot_modes import ARMABLE, ArduPilotMode
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.parameters import Parameters

_INFO, _CRITICAL = mavlink.MAV_SEVERITY_INFO, mavlink.MAV_SEVERITY_CRITICAL
_PREARM_EVERY_S = 30.0

_PRESENT = 0x5371FC0F
_GPS_BIT, _XY_BITS, _LOGGING, _FENCE = 0x20, 0x6000, 0x01000000, 0x00100000
_AHRS, _BATTERY, _PREARM = 0x00200000, 0x02000000, 0x10000000
_ENABLED, _HEALTHY = 0x52419C0F, 0x4751FC0F
"""SYS_STATUS sensor bits as recorded; bits of the list above are added and taken away."""


class ArduPilotArming:
    """A `HealthReport`; `step` is called ten times a second."""

    def __init__(
        self,
        flight: Flight,
        parameters: Parameters,
        announcer: Announcer,
        estimate: ArduPilotEstimate,
        modes: ArduPilotModeControl,
        failsafes: ArduPilotFailsafes,
        fence: ArduPilotFence,
    ) -> None:
        self._flight = flight
        self._parameters = parameters
        self._announcer = announcer
        self._estimate = estimate
        self._modes = modes
        self._failsafes = failsafes
        self._fence = fence
        self._prearm_due_s = 30.3
        self._prearm_soon_s: float | None = None
        self._landed_since_s = 0.0
        flight.after_disarming.append(self._disarmed)

    def prearm_texts(self) -> None:
        time_s = self._flight.time_s
        soon = self._prearm_soon_s is not None and time_s >= self._prearm_soon_s
        if not (soon or time_s >= self._prearm_due_s):
            return
        self._prearm_soon_s = None
        if time_s >= self._prearm_due_s:
            self._prearm_due_s += _PREARM_EVERY_S
        if not self._flight.armed:
            self.tell_failures()

    def tell_failures(self) -> None:
        for text in self._failures():
            self._announcer.say(_CRITICAL, f"PreArm: {text}")

    def _failures(self) -> list[str]:
        """Why it cannot be armed now."""
        estimate, failsafes = self._estimate, self._failsafes
        texts: list[str] = []
        if not estimate.has_reached(ALIGNED_S):
            texts += [
                "Need Alt Estimate",
                "Accels inconsistent",
                "EKF attitude is bad",
                "AHRS: waiting for home",
            ]
        elif not estimate.has_reached(ORIGIN_S):
            texts.append("AHRS: waiting for home")
        elif not estimate.position_ok:
            texts.append("Need Position Estimate")
        if failsafes.battery_low or failsafes.battery_critical:
            kind = "critical" if failsafes.battery_critical else "low"
            texts += [f"Battery 1 {kind} voltage failsafe", "Battery failsafe"]
        if self._fence.breached:
            texts.append("Vehicle breaching Polygon fence")
        if self._flight.vehicle.body.failed or self._flight.crashed:
            texts.append("Motors: SIM motor failed")
        return texts

    def try_to_arm(self, *, forced: bool) -> bool:
        flight = self._flight
        if flight.armed:
            return True
        failures = [] if forced or not self._parameters["ARMING_CHECK"] else self._failures()
        if self._modes.mode not in ARMABLE:
            failures.append("Mode not armable")
        if failures:
            for text in failures:
                self._announcer.say(_CRITICAL, f"Arm: {text}")
            return False
        self._announcer.say(_INFO, "Arming motors")
        flight.arm()
        self._estimate.tell_home()
        self._landed_since_s = flight.armed_s
        self._failsafes.armed()
        self._modes.enter()
        return True

    def _disarmed(self) -> None:
        self._prearm_soon_s = self._flight.time_s + 1.0

    def disarm_on_the_ground(self, now_s: float) -> None:
        flight = self._flight
        if not flight.landed or flight.wants_to_fly:
            self._landed_since_s = now_s
        delay_s = self._parameters["DISARM_DELAY"]
        if flight.armed and delay_s > 0.0 and now_s - self._landed_since_s > delay_s:
            flight.disarm("Disarming motors", _INFO)

    def health(self) -> tuple[int, int, int]:
        flight, estimate = self._flight, self._estimate
        present, enabled, healthy = _PRESENT, _ENABLED, _HEALTHY
        if estimate.gps_detected:
            present, enabled = present | _GPS_BIT, enabled | _GPS_BIT
            healthy |= _GPS_BIT if flight.vehicle.estimator.gps else 0
        if self._modes.mode not in (ArduPilotMode.STABILIZE, ArduPilotMode.ALT_HOLD):
            enabled |= 0x2000 if estimate.lost else _XY_BITS
        if estimate.lost:
            healthy &= ~0x4000
        if flight.origin_is_set:
            enabled, healthy = enabled | _AHRS, healthy | _AHRS
        if flight.armed:
            enabled |= _LOGGING
        if self._parameters["FENCE_ENABLE"]:
            enabled |= _FENCE
        if self._fence.breached:
            healthy &= ~_FENCE
        if self._failsafes.battery_low:
            healthy &= ~_BATTERY
        if flight.armed or (estimate.ready and not self._failures()):
            healthy |= _PREARM
        return present, enabled, healthy
