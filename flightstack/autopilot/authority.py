"""Who has the vehicle: us, a pilot, or a failsafe of the autopilot.

A mode that we did not ask for ends our authority. It is given back only by a new arming or by our own
`take_control`, never because the mode happens to be ours again: the pilot may only be passing through it.

There is one exception: PX4 leaves Offboard by a failsafe when setpoints do not come for a second, and comes back to
it by itself when they do. While that may be all that happened nobody has taken the vehicle: it is waiting for us, and
gets setpoints. PX4 itself decides: for any other cause it stays in its failsafe, and RESUMES_S later has the vehicle.

What happened while this program stood still it has not seen, and the words about it may be lost. A vehicle that is
found on its own way home then is not taken for a pilot's: whoever sent it there, it comes down by itself.
"""

from __future__ import annotations

import math
import re

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.report import TakenBy
from flightstack.mavlink.modes import Duty, Flavour, mode_name, mode_of, way_down

EXPECTED_FOR_S = 5.0
"""How long after the last request for a mode its coming is still our doing."""
EVIDENCE_S = 3.0
"""How far a failsafe's text and its change of mode may be apart, either way."""

RESUMES_S = 3.0
"""PX4 is back in Offboard within a second of the first setpoints; its heartbeat tells within another one."""
FROZEN_S = 5.0
"""After a stand-still this long others have acted for us: failsafes, and the ground station that brings silent drones
home."""
_NO_SETPOINTS = "No offboard signal"
"""PX4's reason for the failsafe."""
_NO_CAUSE = re.compile(
    r"failsafe activated(: (switching to|entering) [a-z ]+( for \d+ seconds)?)?\s*", re.IGNORECASE
)
"""PX4's failsafe in words that do not say why: the report that they rest on did not come."""

_CRITICAL = frozenset(
    (mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY, mavlink.MAV_STATE_FLIGHT_TERMINATION)
)
_FAILSAFE_TEXT = re.compile(
    r"fail-?safe|breach|crash|thrust loss|motor failure|parachute|terminat|critical battery|link lost|signal lost",
    re.IGNORECASE,
)
_NOT_A_FAILSAFE = re.compile(
    r"clear(ed)?\b|^(pre)?arm:|^preflight|^arming denied|^failsafe warning|\boff\b", re.IGNORECASE
)


def is_failsafe_text(text: str) -> bool:
    """Does this text say that a failsafe acts now? Severity is no help: ArduPilot's fence breach is a mere notice."""
    return bool(_FAILSAFE_TEXT.search(text)) and not _NOT_A_FAILSAFE.search(text)


def _names_another_cause(text: str) -> bool:
    """Does PX4 say that its failsafe is for something else than missing setpoints?"""
    return f"({_NO_SETPOINTS})" not in text and _NO_CAUSE.fullmatch(text) is None


class Authority:
    """Follows heartbeats and status texts; `taken_by` and `failsafe` are its findings."""

    def __init__(self) -> None:
        self.taken_by = TakenBy.NOBODY
        self.taken_reason = ""
        self.failsafe_reason = ""
        self.takeovers = 0
        """How often a mode came that we had not asked for."""
        self._flavour = Flavour.UNKNOWN
        self._armed: bool | None = None
        self._mode: int | None = None
        self._critical = False
        self._critical_since_s: float | None = None
        self._text: tuple[float, str] | None = None
        self._change = ""
        self._changed_s: float | None = None
        """When the newest change came, while no text has explained it."""
        self._expected: dict[int, float] = {}
        self._stood_still_s = -math.inf
        self._stood_still_for_s = 0.0
        self._lapsed_s: float | None = None
        """When the vehicle was first seen to do without us, for want of setpoints; None while it does not."""

    @property
    def failsafe(self) -> bool:
        return self.taken_by is TakenBy.AUTOPILOT or (self._critical and bool(self._armed))

    @property
    def resuming(self) -> bool:
        """The vehicle flies by its own failsafe for want of setpoints, and is ours as soon as it gets them."""
        return self._lapsed_s is not None

    def stood_still(self, now_s: float, for_s: float = 0.0) -> None:
        """We sent nothing for so long that PX4 may have missed it."""
        self._stood_still_s, self._stood_still_for_s = now_s, for_s
        if self._lapsed_s is not None:
            self._lapsed_s = now_s  # it could not come back: nothing was sent to it

    def expect(self, now_s: float, mode: int) -> None:
        """We are asking for `mode`."""
        self._expected[mode] = now_s

    def regain(self) -> None:
        """A request of ours (arm, take control, …) has succeeded: the vehicle is ours."""
        self.taken_by = TakenBy.NOBODY
        self.taken_reason = ""
        self._lapsed_s = None

    def heartbeat(self, now_s: float, flavour: Flavour, armed: bool, mode: int, system_status: int) -> None:
        self._flavour = flavour
        critical = system_status in _CRITICAL
        if critical and not self._critical:
            self._critical_since_s = now_s
        if not critical and self._critical:
            self.failsafe_reason = ""
        self._critical = critical
        if armed and self._armed is False:
            self.regain()
            self.failsafe_reason = ""
        elif armed and self._armed and self._mode is not None:
            self._in_flight(now_s, self._mode, mode)
        if not armed:
            self._lapsed_s = None
        self._armed, self._mode = armed, mode

    def text(self, now_s: float, text: str) -> None:
        if not is_failsafe_text(text):
            return
        self._text = (now_s, text)
        self.failsafe_reason = text
        if self._lapsed_s is not None and self._mode is not None and _names_another_cause(text):
            self._lapse_ends(now_s, self._mode)
        if self._changed_s is not None and now_s - self._changed_s <= EVIDENCE_S:
            self.taken_by, self.taken_reason = TakenBy.AUTOPILOT, f"{self._change} ({text})"
            self._text = self._changed_s = None

    def _in_flight(self, now_s: float, old: int, new: int) -> None:
        if new != old and self._lapses(now_s, old, new):
            self._lapsed_s = now_s
        elif self._lapsed_s is None:
            if new != old:
                self._mode_changed(now_s, old, new)
        elif new == mode_of(self._flavour, Duty.CONTROL):
            self._lapsed_s = self._text = self._critical_since_s = None
        elif not self._critical or now_s - self._lapsed_s > RESUMES_S:
            self._lapse_ends(now_s, new)

    def _lapse_ends(self, now_s: float, mode: int) -> None:
        """Somebody chose a mode meanwhile, or it does not come back: then the failsafe has it for good."""
        self._lapsed_s = self._text = self._critical_since_s = None
        if self._critical:
            self._text = (now_s, self.failsafe_reason or "no setpoints reach it")
        self._mode_changed(now_s, mode_of(self._flavour, Duty.CONTROL), mode)

    def _lapses(self, now_s: float, old: int, new: int) -> bool:
        """May this change be PX4's failsafe for want of setpoints, and nothing else?"""
        if self._flavour is not Flavour.PX4 or self.taken_by is not TakenBy.NOBODY or not self._critical:
            return False
        if old != mode_of(self._flavour, Duty.CONTROL) or new in self._expected_now(now_s):
            return False
        if self._text is not None and now_s - self._text[0] <= EVIDENCE_S:
            if _names_another_cause(self._text[1]):
                return False
            if f"({_NO_SETPOINTS})" in self._text[1]:
                return True
        by_itself = new == mode_of(self._flavour, Duty.HOLD) or way_down(self._flavour, new) is not None
        return by_itself or now_s - self._stood_still_s <= EVIDENCE_S

    def _expected_now(self, now_s: float) -> set[int]:
        return {mode for mode, asked_s in self._expected.items() if now_s - asked_s <= EXPECTED_FOR_S}

    def _mode_changed(self, now_s: float, old: int, new: int) -> None:
        if new in self._expected_now(now_s):
            return
        self._changed_s = now_s
        self.takeovers += 1
        self._change = f"mode changed from {mode_name(self._flavour, old)} to {mode_name(self._flavour, new)}"
        turned = self._critical_since_s is not None and now_s - self._critical_since_s <= EVIDENCE_S
        down = way_down(self._flavour, new) is not None
        frozen = self._stood_still_for_s >= FROZEN_S and now_s - self._stood_still_s <= EVIDENCE_S
        goes_on = (
            self._flavour is Flavour.PX4 and self._critical and self.taken_by is TakenBy.AUTOPILOT and down
        )
        if self._text is not None and now_s - self._text[0] <= EVIDENCE_S:
            self.taken_by, self.taken_reason = TakenBy.AUTOPILOT, f"{self._change} ({self._text[1]})"
            self._changed_s = None
        elif turned:
            self.taken_by, self.taken_reason = (
                TakenBy.AUTOPILOT,
                f"{self._change} (its state became critical)",
            )
        elif goes_on:
            # PX4 holds first, and then does what its failsafe is for.
            self.taken_by, self.taken_reason = TakenBy.AUTOPILOT, f"{self._change} (its failsafe goes on)"
        elif frozen and down:
            self.taken_by, self.taken_reason = (
                TakenBy.AUTOPILOT,
                f"{self._change} (while this program stood still for {self._stood_still_for_s:.0f} s)",
            )
        else:
            self.taken_by, self.taken_reason = TakenBy.PILOT, self._change
        # Evidence explains one change only: what the pilot does after the failsafe is the pilot's doing.
        self._text = self._critical_since_s = None
