"""PX4's report on its health: which checks fail, and in which modes it could be armed. Events, sent on change."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

from flightstack.mavlink.px4_event_table import REPORT_BEGIN, REPORT_END
from simvehicle.autopilot.flight import Flight
from simvehicle.autopilot.mission_progress import MissionProgress
from simvehicle.autopilot.px4_estimate import Px4Estimate
from simvehicle.autopilot.px4_mode_control import OffboardSetpoints, Px4ModeControl
from simvehicle.autopilot.px4_modes import CANNOT_ARM, NAVIGATION_STATES, STICKS, Px4Mode
from simvehicle.autopilot.px4_voice import PROTOCOL, Px4Voice

_LEAST_S = 2.0
"""Between two reports that nobody asked for."""
_ALWAYS = 0x807F7BB8
"""Modes in which the recorded one could be armed with everything in order."""
_ALL = 0xFFFFFFFF
_SYSTEM, _REMOTE_CONTROL, _LINKS, _GLOBAL_POSITION = 20, 7, 12, 24
"""Health components."""
_PRESENT = 0x28020400
_LOCAL_POSITION_MODES, _GLOBAL_POSITION_MODES = 0x0011007C, 0x00000038
_WITHOUT_POSITION = 0x0011407C | 0x00000038 | 0x007E0000
_ERROR, _WARNING, _INFO, _CRITICAL = 3, 4, 6, 2

Check = tuple[str, int, int, int]
"""Name, modes, severity, health component."""


class Px4Report:
    def __init__(
        self,
        flight: Flight,
        estimate: Px4Estimate,
        progress: MissionProgress,
        offboard: OffboardSetpoints,
        voice: Px4Voice,
        modes: Px4ModeControl,
        ground_is_heard: Callable[[], bool],
        breached: Callable[[], bool],
        faults: Callable[[], list[str]],
    ) -> None:
        """`breached`: the fence is. `faults`: names of checks that fail in every mode, by whatever else is broken."""
        self._flight = flight
        self._estimate = estimate
        self._progress = progress
        self._offboard = offboard
        self._voice = voice
        self._modes = modes
        self._ground_is_heard = ground_is_heard
        self._breached = breached
        self._faults = faults
        self._reported: tuple[Check, ...] | None = None
        self._reported_s = -math.inf

    def step(self, now_s: float) -> None:
        """Once the estimator has had a moment; then what has changed."""
        if now_s - self._reported_s < _LEAST_S or self._flight.time_s < 1.0:
            return
        checks = self._checks()
        if checks != self._reported:
            self._report(now_s, checks)

    def now(self, now_s: float) -> None:
        """Out of turn: it was asked for, or something happens because of it."""
        self._report(now_s, self._checks())

    def can_arm(self, mode: Px4Mode) -> bool:
        return bool(self._can_arm(self._checks()) & 1 << NAVIGATION_STATES[mode])

    def _checks(self) -> tuple[Check, ...]:
        flight, estimate = self._flight, self._estimate
        checks: list[Check] = [(name, _ALL, _CRITICAL, _SYSTEM) for name in self._faults()]
        if not flight.armed and self._modes.mode in CANNOT_ARM:
            modes = sum(1 << NAVIGATION_STATES[mode] for mode in CANNOT_ARM)
            checks.append(("check_modes_cannot_takeoff", modes, _INFO, _SYSTEM))
        if not estimate.gps_detected or not flight.vehicle.estimator.gps:
            checks.append(("check_estimator_gps_fix_too_low", _GLOBAL_POSITION_MODES, _WARNING, _SYSTEM))
        if not estimate.position_ok:
            checks.append(("check_modes_local_pos", _LOCAL_POSITION_MODES, _ERROR, _SYSTEM))
            checks.append(("check_modes_global_pos", _GLOBAL_POSITION_MODES, _ERROR, _GLOBAL_POSITION))
        if not flight.origin_is_set:
            checks.append(
                ("check_modes_home_position", 1 << NAVIGATION_STATES[Px4Mode.RETURN], _INFO, _SYSTEM)
            )
        if not self._progress.can_fly:
            checks.append(("check_modes_mission", 1 << NAVIGATION_STATES[Px4Mode.MISSION], _INFO, _SYSTEM))
        if self._breached():
            checks.append(("check_gf_violation_custom_gf", _ALL, _ERROR, _SYSTEM))
        if not self._offboard.are_alive(flight.now_s) or not estimate.position_ok:
            modes = 1 << NAVIGATION_STATES[Px4Mode.OFFBOARD]
            checks.append(("check_modes_offboard_signal", modes, _ERROR, _SYSTEM))
        if not self._modes.sticks_alive:
            checks.append(("check_modes_manual_control", _ALL, _WARNING, _REMOTE_CONTROL))
        if not self._ground_is_heard():
            checks.append(("check_rc_dl_no_dllink", _ALL, _INFO, _LINKS))
        return tuple(checks)

    def _can_arm(self, checks: tuple[Check, ...]) -> int:
        modes = _ALWAYS if self._estimate.position_ok else _ALWAYS & ~_WITHOUT_POSITION
        if self._modes.sticks_alive:
            modes |= sum(1 << NAVIGATION_STATES[mode] for mode in STICKS)
        for _, failing, severity, _ in checks:
            if severity != _WARNING and (failing != _ALL or severity < _WARNING):
                modes &= ~failing
        return modes

    def _report(self, now_s: float, checks: tuple[Check, ...]) -> None:
        self._reported, self._reported_s = checks, now_s
        errors = warnings = 0
        for _, _, severity, component in checks:
            if severity <= _ERROR:
                errors |= 1 << component
            elif severity == _WARNING:
                warnings |= 1 << component
        can_arm = self._can_arm(checks)
        summary = struct.pack("<BIIII", 0, errors, warnings, can_arm, can_arm)
        self._voice.tell(REPORT_BEGIN, PROTOCOL, summary)
        for name, modes, severity, component in checks:
            self._voice.tell(name, severity, struct.pack("<IB", modes, component))
        self._voice.tell(REPORT_END, PROTOCOL, struct.pack("<BIII", 0, _PRESENT, 0, 0))
