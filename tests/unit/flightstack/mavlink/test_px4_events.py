"""PX4's events: what a real one said in a recorded flight, by events alone and beside its status texts."""

from __future__ import annotations

import pathlib
import struct
from collections.abc import Iterator

import pytest

from flightstack.mavlink.codec import MavlinkCodec
from flightstack.mavlink.dialect import (
    AvailableModesMessage,
    CurrentEventSequenceMessage,
    CurrentModeMessage,
    EventMessage,
    RequestEventMessage,
    ResponseEventErrorMessage,
)
from flightstack.mavlink.framing import FrameFinder, MavlinkFrame
from flightstack.mavlink.modes import Duty, Flavour, mode_of, px4_mode_bit
from flightstack.mavlink.px4_event_table import CHECKS, TOLD, event_id
from flightstack.mavlink.px4_events import Px4Events
from flightstack.mavlink.statustext import StatusText
from flightstack.mavlink.vehicle_state import EVENTS, STATES, VehicleState

RECORDING = pathlib.Path(__file__).parents[3] / "data" / "px4-1.16-dev-conversation.tlog"
OFFBOARD = mode_of(Flavour.PX4, Duty.CONTROL)
EVENT, STATUSTEXT = EventMessage.id, 253


def recorded() -> Iterator[tuple[float, MavlinkFrame]]:
    """What the PX4 of the recording sent, and when (seconds)."""
    data, at, first_us = RECORDING.read_bytes(), 0, None
    finder = FrameFinder()
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        first_us = time_us if first_us is None else first_us
        stop = at + 8 + data[at + 9] + 12
        for frame in finder.find(data[at + 8 : stop]):
            if (frame.system, frame.component) == (1, 1):
                yield (time_us - first_us) * 1e-6, frame
        at = stop
    assert finder.bad_frames == 0, "the check-sum bytes of our own definitions are right"


def told(*, without: int | None = None) -> list[StatusText]:
    """The texts of the whole flight, for somebody who hears nothing of one kind."""
    vehicle, codec = VehicleState(1, 1, None), MavlinkCodec(1, 191, STATES, EVENTS)
    now_s = 0.0
    for now_s, frame in recorded():
        if frame.kind != without:
            for message in codec.receive(now_s, frame.data):
                vehicle.accept(now_s, message)
        vehicle.flush(now_s)
    vehicle.flush(now_s + 2.0)
    return vehicle.new_texts


def event(name: str, arguments: bytes = b"", *, severity: int = 2, sequence: int = 0) -> EventMessage:
    return EventMessage(
        id=event_id(name),
        event_time_boot_ms=0,
        sequence=sequence,
        destination_component=0,
        destination_system=0,
        log_levels=severity | severity << 4,
        arguments=tuple(arguments.ljust(40, b"\0")),
    )


def report(*checks: tuple[str, int, int], can_arm: int) -> list[EventMessage]:
    """A health report: of each check its name, the modes that it is about, and its severity."""
    summary = struct.pack("<BIIII", 0, 0, 0, can_arm, can_arm)
    lines = [event(name, struct.pack("<IB", modes, 20), severity=level) for name, modes, level in checks]
    return [
        event("commander_arming_check_summary", summary, severity=8),
        *lines,
        event("commander_health_summary", severity=8),
    ]


def test_the_numbers_of_events_are_those_that_a_real_one_sent() -> None:
    assert event_id("commander_arm_denied_resolve_failures") == 16910493
    assert event_id("check_modes_offboard_signal") == 19865031
    assert not set(TOLD) & set(CHECKS)


def test_an_onboard_computer_reads_in_events_what_ground_stations_get_as_texts() -> None:
    texts = [text.text for text in told(without=STATUSTEXT)]
    assert texts[:4] == [
        "Arming denied: Resolve system health failures first",
        "Arming denied: Resolve system health failures first",
        "Arming denied: Resolve system health failures first",
        "Armed by external command",
    ]
    assert "Disarmed by auto preflight disarming" in texts
    assert "Failsafe activated: switching to Return (No offboard signal)" in texts
    assert "Failsafe activated: switching to Hold (No offboard signal)" in texts
    assert "Failsafe activated: switching to Position (No offboard signal)" in texts
    cause = "Geofence violation: approaching or outside geofence"
    assert f"Failsafe activated: Hold, switching to Return in 5 seconds ({cause})" in texts
    assert "Geofence violation for waypoint 2" in texts
    assert "RTL: start return at 505 m (15 m above destination)" in texts
    assert not any("event" in text for text in texts), "all of this flight is known"


def test_where_both_come_each_thing_is_told_once() -> None:
    both, events = told(), told(without=STATUSTEXT)
    # The recorder's first text has the number 0 in two parts, and the logger says its file in two ways.
    extra = [text.text for text in both if text not in events]
    assert extra[:2] == ["Arming denied: Resolve system health failures firs", "t"]
    assert all(text.startswith("[logger]") for text in extra[2:])
    assert len(both) == len(events) + len(extra)


def test_severities_are_those_for_the_outside() -> None:
    severities = {text.text: text.severity for text in told(without=STATUSTEXT)}
    assert severities["Arming denied: Resolve system health failures first"] == 2
    assert severities["Geofence violation for waypoint 2"] == 3
    assert severities["Takeoff detected"] == 6


def test_an_event_that_nobody_knows_is_told_by_its_number_or_by_its_text() -> None:
    events = Px4Events()
    assert events.event(0.0, event("somebody_elses_own", severity=3), armed=True) == []
    (text,) = events.expire(1.0)
    assert text == StatusText(3, f"event {event_id('somebody_elses_own')}")
    events.event(2.0, event("somebody_elses_own", severity=3), armed=True)
    assert events.statustext(2.1, StatusText(3, "Tether torn")) == [StatusText(3, "Tether torn")]
    assert events.expire(4.0) == []


def test_what_is_not_for_people_is_not_told() -> None:
    events = Px4Events()
    assert events.event(0.0, event("somebody_elses_own", severity=7), armed=True) == []
    assert events.expire(1.0) == []


def test_texts_of_an_autopilot_without_events_do_not_wait() -> None:
    text = StatusText(2, "PreArm: Hardware safety switch")
    assert Px4Events().statustext(0.0, text) == [text]


def test_the_report_says_what_stands_against_offboard() -> None:
    events = Px4Events()
    assert events.why_not_arm(OFFBOARD, streaming=True) == [], "nothing is known yet"
    offboard, hold = px4_mode_bit(OFFBOARD), px4_mode_bit(mode_of(Flavour.PX4, Duty.HOLD))
    everywhere = 0xFFFFFFFF
    for message in report(
        ("check_modes_global_pos", offboard | hold, 3),
        ("check_modes_offboard_signal", offboard, 3),
        ("check_modes_manual_control", everywhere, 4),
        ("check_modes_mission", 8, 6),
        can_arm=1 << 10,
    ):
        assert events.event(0.0, message, armed=False) == []
    assert events.why_not_arm(OFFBOARD, streaming=False) == ["No valid global position estimate"]
    assert "No offboard signal" in events.why_not_arm(OFFBOARD, streaming=True)
    for message in report(("check_modes_offboard_signal", offboard, 3), can_arm=hold):
        events.event(3.0, message, armed=False)
    assert events.why_not_arm(OFFBOARD, streaming=False) == []


def test_a_check_that_begins_to_fail_in_flight_is_told() -> None:
    events = Px4Events()
    for message in report(("check_modes_manual_control", 0xFFFFFFFF, 4), can_arm=0):
        events.event(0.0, message, armed=True)
    events.expire(1.0)
    low = [("check_modes_manual_control", 0xFFFFFFFF, 4), ("check_battery_low", 0xFFFFFFFF, 2)]
    for message in report(*low, can_arm=0):
        events.event(5.0, message, armed=True)
    assert events.expire(6.0) == [StatusText(2, "Low battery")]


def test_what_a_failsafe_names_as_its_cause_is_not_told_again() -> None:
    events = Px4Events()
    for message in report(("check_modes_global_pos", px4_mode_bit(OFFBOARD), 3), can_arm=0):
        events.event(0.0, message, armed=True)
    failsafe = event("commander_failsafe_enter_autopilot_disengaged", struct.pack("<IB", OFFBOARD, 8))
    (text,) = events.event(0.1, failsafe, armed=True)
    assert text.text == (
        "Failsafe activated: autopilot disengaged, switching to a blind descent "
        "(No valid global position estimate)"
    )
    assert events.expire(2.0) == []


@pytest.mark.parametrize(
    "message",
    [
        event("commander_rtl", b"\x01\x02\x03", sequence=7),
        CurrentEventSequenceMessage(sequence=9, flags=1),
        RequestEventMessage(target_system=1, target_component=1, first_sequence=3, last_sequence=5),
        ResponseEventErrorMessage(
            target_system=1, target_component=191, sequence=3, sequence_oldest_available=5, reason=0
        ),
        CurrentModeMessage(standard_mode=0, custom_mode=OFFBOARD, intended_custom_mode=OFFBOARD),
        AvailableModesMessage(
            number_modes=25,
            mode_index=5,
            standard_mode=0,
            custom_mode=OFFBOARD,
            properties=1,
            mode_name=b"Offboard",
        ),
    ],
)
def test_messages_that_pymavlink_lacks_are_read_as_they_were_sent(message: object) -> None:
    sender, reader = MavlinkCodec(3, 1), MavlinkCodec(255, 190, events={message.id, message.get_msgId()})  # type: ignore[attr-defined]
    (found,) = reader.receive(0.0, sender.encode(message))
    for name in type(message).ordered_fieldnames:  # type: ignore[attr-defined]
        value = getattr(message, name)
        assert getattr(found.fields, name) == (value.decode() if isinstance(value, bytes) else value)
