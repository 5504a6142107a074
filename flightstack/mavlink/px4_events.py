"""What PX4 tells by events: texts, and the checks that keep it from arming.

To an onboard computer PX4 sends no STATUSTEXT: it does so only on links on which it hears a ground station. Events
(https://mavlink.io/en/services/events.html) come on every link, each a number with arguments. A link with a ground
station has both of most things; what both say is told once.
"""

from __future__ import annotations

import enum
import re
from typing import Any, Final, NamedTuple

from flightstack.mavlink.event_sequence import EventArrival, EventSequence
from flightstack.mavlink.modes import px4_mode_bit
from flightstack.mavlink.px4_event_table import CHECKS, REPORT_BEGIN, REPORT_END, TOLD, event_id
from flightstack.mavlink.statustext import StatusText

TWIN_S: Final = 0.5
"""Within which an event and its STATUSTEXT come."""
ERROR: Final = 3
"""The least severity (log level) that keeps a vehicle on the ground, or brings it there."""
WARNING: Final = 4
_LEAST: Final = 6
"""What is told: the levels below (debug, protocol, disabled) are not meant for people."""
ALL_MODES: Final = 0xFFFFFFFF
_MOST = 64
"""Of anything that is kept: a real one has far less, whatever comes on a link."""
_BEGIN, _END = event_id(REPORT_BEGIN), event_id(REPORT_END)
_NO_SETPOINTS = frozenset(map(event_id, ("check_modes_offboard_signal", "check_modes_offboard_signal_lost")))
_APPENDS_CHECKS = frozenset(
    event_id(f"commander_failsafe_enter_{kind}")
    for kind in ("generic", "generic_hold", "generic_warn", "autopilot_disengaged")
)
"""Failsafes whose cause is what the newest health report says."""
_FAILSAFE = "failsafeactivated"
_LETTERS = re.compile(r"[^a-z0-9]+")


class FailedCheck(NamedTuple):
    """One line of PX4's health and arming report."""

    number: int
    modes: int
    """Bit for bit the modes (`px4_mode_bit`) in which it stands against arming; ALL_MODES also for a mere warning."""
    severity: int
    text: str

    @property
    def is_optional(self) -> bool:
        return self.modes == ALL_MODES and self.severity > ERROR


class _Source(enum.Enum):
    TEXT = "text"
    CHECK = "check"
    UNKNOWN = "unknown"
    """An event that nobody can put into words."""


class _Waiting(NamedTuple):
    """Something to tell, unless its twin tells it first."""

    until_s: float
    text: StatusText
    source: _Source


class Px4Events:
    """Events and status texts of one autopilot in, whole texts and the newest health report out. Time is given."""

    def __init__(self) -> None:
        self.checks: tuple[FailedCheck, ...] = ()
        """What the newest report complains of."""
        self.can_arm_modes: int | None = None
        """Bit for bit the modes (`px4_mode_bit`) in which it could be armed; None before the first report."""
        self.sequence = EventSequence()
        self._speaks = False
        """This autopilot sends events."""
        self._report: list[FailedCheck] | None = None
        """The one that is coming in."""
        self._waiting: list[_Waiting] = []
        self._told: list[tuple[float, str]] = []
        """What events have just said, so that their texts are not said again."""

    def why_not_arm(self, mode: int, *, streaming: bool) -> list[str]:
        """What stands against arming in a mode (HEARTBEAT.custom_mode). Before setpoints are streamed their absence,
        which keeps Offboard from arming and nothing else, is no reason."""
        bit = px4_mode_bit(mode)
        can_arm = bit if streaming else bit | px4_mode_bit(_HOLD)
        if self.can_arm_modes is None or self.can_arm_modes & can_arm:
            return []
        return [
            check.text
            for check in self.checks
            if check.modes & bit
            and not check.is_optional
            and (streaming or check.number not in _NO_SETPOINTS)
        ]

    def event(self, now_s: float, fields: Any, *, armed: bool) -> list[StatusText]:
        """The texts that an EVENT with these fields completes."""
        self._speaks = True
        number, arguments = fields.id, bytes(fields.arguments)
        severity = fields.log_levels & 0x0F
        arrival = self.sequence.take(fields.sequence)
        # What comes late belongs to a report that is over.
        if arrival is EventArrival.KNOWN or (
            arrival is EventArrival.LATE and (number == _BEGIN or number in CHECKS)
        ):
            return []
        if number == _BEGIN:
            self._report = []
            self.can_arm_modes = int.from_bytes(arguments[9:13], "little")
            return []
        if number == _END:
            return self._end_report(now_s, armed=armed)
        check = _check(number, severity, arguments, self._report is not None)
        if check is not None:
            if self._report is not None and len(self._report) < _MOST:
                self._report.append(check)
            return []
        if severity > _LEAST:
            return []
        known = TOLD.get(number)
        if known is None:
            return self._tell_unknown(now_s, StatusText(severity, f"event {number}"))
        text = known.told(arguments)
        if number in _APPENDS_CHECKS:
            text += self._causes(now_s, int.from_bytes(arguments[:4], "little"))
        return self._tell(now_s, StatusText(severity, text), known.told(arguments))

    def statustext(self, now_s: float, text: StatusText) -> list[StatusText]:
        """The texts to tell now: a text waits a moment for the event that says the same and more."""
        if not self._speaks:
            return [text]
        self._told = [(until_s, told) for until_s, told in self._told if until_s > now_s]
        for place, (_, told) in enumerate(self._told):
            if _alike(told, text.text):
                del self._told[place]
                return []
        for waiting in self._waiting:
            # The text of an event that is a mere number puts it into words.
            is_twin = waiting.source is _Source.UNKNOWN or (
                waiting.source is _Source.CHECK and _alike(waiting.text.text, text.text)
            )
            if is_twin:
                self._waiting.remove(waiting)
                return [text]
        self._wait(_Waiting(now_s + TWIN_S, text, _Source.TEXT))
        return []

    def expire(self, now_s: float) -> list[StatusText]:
        """What has waited for its twin in vain; call it every tick."""
        if self._told:
            self._told = [(until_s, told) for until_s, told in self._told[-_MOST:] if until_s > now_s]
        if not self._waiting:
            return []
        over = [waiting.text for waiting in self._waiting if waiting.until_s <= now_s]
        self._waiting = [waiting for waiting in self._waiting if waiting.until_s > now_s]
        return over

    def _wait(self, waiting: _Waiting) -> None:
        self._waiting = [*self._waiting[1 - _MOST :], waiting]

    def _tell(self, now_s: float, text: StatusText, told: str) -> list[StatusText]:
        """Tell a known event, and not the text that says `told`, whenever it comes."""
        if not self._drop_text(told):
            self._told.append((now_s + TWIN_S, told))
        return [text]

    def _tell_unknown(self, now_s: float, number: StatusText) -> list[StatusText]:
        for waiting in self._waiting:
            if waiting.source is _Source.TEXT:
                self._waiting.remove(waiting)
                return [waiting.text]
        self._wait(_Waiting(now_s + TWIN_S, number, _Source.UNKNOWN))
        return []

    def _drop_text(self, told: str) -> bool:
        """Forget the waiting text that an event says too."""
        for waiting in self._waiting:
            if waiting.source is _Source.TEXT and _alike(told, waiting.text.text):
                self._waiting.remove(waiting)
                return True
        return False

    def _end_report(self, now_s: float, *, armed: bool) -> list[StatusText]:
        """A whole report is there: in flight, what has begun to fail is told."""
        if self._report is None:
            return []
        before = {check.number for check in self.checks}
        self.checks, self._report = tuple(self._report), None
        for check in self.checks:
            if armed and check.number not in before and check.severity <= WARNING:
                self._drop_text(check.text)
                text = StatusText(check.severity, check.text)
                self._wait(_Waiting(now_s + TWIN_S, text, _Source.CHECK))
        return []

    def _causes(self, now_s: float, mode: int) -> str:
        """Why a mode that somebody wanted ends in a failsafe, in brackets. What is told thereby is told."""
        bit = px4_mode_bit(mode)
        errors = [check for check in (*self.checks, *(self._report or ())) if check.severity <= ERROR]
        # PX4 says of a lost position also that Offboard gets no signal.
        failed = [check.text for check in errors if check.number not in _NO_SETPOINTS] or [
            check.text for check in errors if check.modes & bit
        ]
        texts = list(dict.fromkeys(failed))
        told = {*texts, *(check.text for check in errors if check.number in _NO_SETPOINTS)}
        self._waiting = [w for w in self._waiting if w.source is not _Source.CHECK or w.text.text not in told]
        self._told += [(now_s + TWIN_S, text) for text in texts if not self._drop_text(text)]
        return f" ({'; '.join(texts)})" if texts else ""


_HOLD = 3 << 24 | 4 << 16


def _check(number: int, severity: int, arguments: bytes, reporting: bool) -> FailedCheck | None:
    """The check of this number; while a report comes in everything that nobody knows is one of its checks."""
    known = CHECKS.get(number)
    if known is None and (not reporting or number in TOLD):
        return None
    text = f"check {number}" if known is None else known.told(arguments[5:])
    return FailedCheck(number, int.from_bytes(arguments[:4], "little"), severity, text)


def _alike(event: str, text: str) -> bool:
    """Do an event and a status text say the same? One may say more than the other."""
    first, second = (_LETTERS.sub("", words.lower()) for words in (event, text))
    if first.startswith(_FAILSAFE) and second.startswith(_FAILSAFE):
        return True
    shorter, longer = sorted((first, second), key=len)
    return bool(shorter) and longer.startswith(shorter)
