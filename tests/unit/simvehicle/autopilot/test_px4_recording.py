"""The simulated PX4 against a real one: our side of a recorded conversation is played to it.

Everything that the onboard computer and the ground station sent in the recording (a PX4 of December 2024, software in
the loop) is sent at its time; what the vehicle says must be what the real one said, in the same order.
"""

from __future__ import annotations

import difflib
import functools
import itertools
import pathlib
import re
import struct
from typing import NamedTuple

import pytest

from flightstack.mavlink.dialect import MESSAGES, EventMessage
from flightstack.mavlink.fields import layout
from flightstack.mavlink.framing import FrameFinder, MavlinkFrame
from flightstack.mavlink.px4_event_table import CHECKS, TOLD, event_id
from mission.geometry.frames import Geodetic
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.drone.simulated_vehicle import SimulatedVehicle
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.world.configured import make_world

RECORDING = pathlib.Path(__file__).parents[3] / "data" / "px4-1.16-dev-conversation.tlog"
HOME = Geodetic(47.3977422, 8.5455918, 489.0)
BREACHED_S, MISSION_S, LAST_S = 169.0, 185.5, 248.0
"""When the vehicle is told to fly on outside its fence, when the mission begins, and when all is on the ground."""
CHECK_NAMES = {number: event.name for number, event in CHECKS.items()}
EVENT_NAMES = {number: event.name for number, event in TOLD.items()} | {
    event_id(name): name for name in ("commander_arming_check_summary", "commander_health_summary")
}
UNSIMULATED = frozenset(("logger_open_file_time", "mavlink_mission_op_timeout", "failsafe_rc_override"))
"""Log files, a download's timeout, and who it takes for a pilot."""


def answer_of(kind: str, m) -> str | None:
    """What an answer to somebody says; None for what is said to all."""
    match kind:
        case "COMMAND_ACK":
            return f"{m.command}: {m.result}"
        case "MISSION_REQUEST" | "MISSION_REQUEST_INT":
            return f"asks for {m.mission_type}/{m.seq}"
        case "MISSION_ACK":
            return f"list {m.mission_type}: {m.type}"
        case "MISSION_COUNT":
            return f"list {m.mission_type} has {m.count}"
        case "AUTOPILOT_VERSION":
            return f"version {m.flight_sw_version:x}, capabilities {m.capabilities:x}"
        case "AVAILABLE_MODES":
            return f"mode {m.mode_index}/{m.number_modes} {tuple(m)}"
    return None


class Said(NamedTuple):
    time_s: float
    kind: str
    words: str


class Ear:
    """Frames to words, each state only when it changes."""

    def __init__(self) -> None:
        self.said: list[Said] = []
        self._newest: dict[str, str] = {}

    def hear(self, time_s: float, frame: MavlinkFrame) -> None:
        if frame.kind not in MESSAGES:
            return
        name, words = self._in_words(layout(frame.kind).name, layout(frame.kind).unpack(frame.payload))
        if words is not None:
            self.said.append(Said(time_s, name, words))

    def _in_words(self, kind: str, m) -> tuple[str, str | None]:
        answer = answer_of(kind, m)
        if answer is not None:
            return "answer", answer
        match kind:
            case "PARAM_VALUE":
                return "parameter", f"{m.param_id} {m.param_value} {m.param_type} of {m.param_count}"
            case "STATUSTEXT":
                return "text", f"{m.severity} {re.sub(r'[0-9]{2,}', '#', m.text)!r}"
            case "EVENT" if m.id in CHECK_NAMES:
                return "check", f"{CHECK_NAMES[m.id]} {m.log_levels & 15} {bytes(m.arguments[:5]).hex()}"
            case "EVENT":
                return "event", f"{EVENT_NAMES[m.id]} {m.log_levels & 15}"
            case "HEARTBEAT":
                mode = f"{m.custom_mode >> 16 & 255}/{m.custom_mode >> 24}"
                return self._changed("heartbeat", f"mode {mode} base {m.base_mode} status {m.system_status}")
            case "EXTENDED_SYS_STATE":
                return self._changed("landed", f"{m.landed_state}")
            case "ESTIMATOR_STATUS":
                return self._changed("estimator", f"{m.flags}")
            case "MISSION_CURRENT":
                return self._changed("mission", f"{m.seq} of {m.total}")
            case "MISSION_ITEM_REACHED":
                return "reached", f"{m.seq}"
        return kind, None

    def _changed(self, kind: str, words: str) -> tuple[str, str | None]:
        if self._newest.get(kind) == words:
            return kind, None
        self._newest[kind] = words
        return kind, words


@functools.cache
def both() -> tuple[list[Said], list[Said]]:
    """What the real one and the simulated one said."""
    spec = VehicleSpec(id=1, flavour="px4", links=("udpout:127.0.0.1:1",))
    fleet = FleetConfig(origin=HOME, vehicles=(spec,), ready_after_s=3.0)
    vehicle = SimulatedVehicle(spec, make_world(fleet), seed=1, ready_after_s=3.0)
    vehicle.step(0.0)
    real, simulated, finder, from_vehicle = Ear(), Ear(), FrameFinder(), FrameFinder()

    def listen(time_s: float) -> None:
        for _, data in vehicle.drain():
            for frame in from_vehicle.find(data):
                simulated.hear(time_s, frame)

    data, at, first_us = RECORDING.read_bytes(), 0, None
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        first_us = time_us if first_us is None else first_us
        time_s = (time_us - first_us) * 1e-6
        stop = at + 8 + data[at + 9] + 12
        for frame in finder.find(data[at + 8 : stop]):
            vehicle.step(time_s)
            listen(time_s)
            if (frame.system, frame.component) == (1, 1):
                real.hear(time_s, frame)
            else:
                vehicle.receive(0, frame.data)
                listen(time_s)
        at = stop
    return real.said, simulated.said


def words(said: list[Said], kind: str, until_s: float = 1e9, *, after_s: float = 12.5) -> list[str]:
    """Of one kind; from when both have stopped to set up their streams."""
    return [each.words for each in said if each.kind == kind and after_s <= each.time_s < until_s]


def beats(said: list[Said]) -> list[tuple[str, float]]:
    """What heartbeats told, and for how long."""
    found = [each for each in said if each.kind == "heartbeat" and each.time_s > 12.5]
    ends = [*(each.time_s for each in found[1:]), 1e9]
    return [(each.words, end_s - each.time_s) for each, end_s in zip(found, ends, strict=True)]


def test_every_question_is_answered_as_the_real_one_answers_it() -> None:
    real, simulated = both()
    answers = words(real, "answer")
    assert len(answers) > 70
    # A request that is not known is passed over by the real one where ours says so.
    assert [each for each in words(simulated, "answer") if not each.startswith("521: ")] == answers


def test_parameters_are_answered_once_and_a_wrong_type_not_at_all() -> None:
    real, simulated = both()
    asked = [word for word, _ in itertools.groupby(words(simulated, "parameter"))]
    assert set(asked) <= set(words(real, "parameter")), (
        "names, values byte by byte, types and the count of all"
    )
    assert not any(word.startswith("NO_SUCH_PARAM") for word in asked)
    gf_actions = [word for word in asked if word.startswith("GF_ACTION")]
    assert len(gf_actions) == 2, "the one set as a float is passed over in silence"


def test_modes_states_and_flags_follow_each_other_as_in_the_recording() -> None:
    real, simulated = both()
    ours, theirs = beats(simulated), beats(real)
    alike = difflib.SequenceMatcher(None, [w for w, _ in ours], [w for w, _ in theirs], autojunk=False)
    differing = [
        beat
        for operation, a, b, c, d in alike.get_opcodes()
        if operation != "equal"
        for beat in (*ours[a:b], *theirs[c:d])
    ]
    # Both beat once a second, but not at the same time: what lasts no longer one of them may not tell.
    assert not [beat for beat in differing if beat[1] > 1.3]
    assert len(differing) < len(theirs) / 4
    assert words(simulated, "landed") == words(real, "landed")
    assert words(simulated, "mission") == words(real, "mission")
    assert words(simulated, "estimator", after_s=0.0)[-3:] == ["1023", "895", "1023"]
    assert {"1023", "895"} <= set(words(real, "estimator", after_s=0.0))


def test_texts_come_only_where_a_ground_station_is_heard_and_say_what_the_real_one_says() -> None:
    real, simulated = both()
    unsimulated = ("[logger]", "Operation timeout")
    texts = [text for text in words(real, "text", 130.0) if not any(word in text for word in unsimulated)]
    assert len(texts) > 12
    assert words(simulated, "text", 130.0) == texts
    first_s = next(each.time_s for each in simulated if each.kind == "text")
    assert first_s > 45.0, "what was refused at 42 s is said when a ground station comes"


@pytest.mark.parametrize("until_s", [130.0, BREACHED_S])
def test_events_tell_the_same_in_the_same_order(until_s: float) -> None:
    real, simulated = both()

    def told(said: list[Said]) -> list[str]:
        # Reports differ in when they come: the real one sends each change two seconds after the one before.
        events = [each for each in words(said, "event", until_s) if "summary" not in each]
        return [each for each in events if each.split()[0] not in UNSIMULATED]

    expected = told(real)
    if until_s > 133.0:
        # In the middle of a failsafe somebody gave it another action, which the real one then begins.
        failsafes = [at for at, each in enumerate(expected) if each == "commander_failsafe_enter_generic 2"]
        del expected[failsafes[3]]
    assert told(simulated) == expected


def test_reports_list_the_same_checks_with_their_modes() -> None:
    real, simulated = both()
    assert set(words(simulated, "check", MISSION_S)) <= set(words(real, "check", MISSION_S)) | {
        # A fence that is broken is told at once in all modes by both, by ours with the modes that it ends.
        each for each in words(simulated, "check") if each.startswith("check_gf")
    }  # fmt: skip
    named = {each.split()[0] for each in words(simulated, "check")}
    assert named == {each.split()[0] for each in words(real, "check")}


def test_items_that_were_reached_are_told_ten_times_more_once_a_second() -> None:
    real, simulated = both()
    for said in (real, simulated):
        reached = words(said, "reached")
        assert [seq for seq, _ in itertools.groupby(reached)] == ["0", "1", "2"]
        assert reached.count("2") == 11
        times_s = [each.time_s for each in said if each.kind == "reached" and each.words == "2"]
        assert times_s[-1] - times_s[0] == pytest.approx(10.0, abs=0.9)


def duration_s(said: list[Said], kind: str, first: str, last: str, *, after_s: float) -> float:
    """From the first of one kind that begins so to the next that begins so."""
    times = [each for each in said if each.kind == kind and each.time_s >= after_s]
    start = next(each for each in times if each.words.startswith(first))
    return next(
        each.time_s for each in times if each.time_s > start.time_s and each.words.startswith(last)
    ) - (start.time_s)


@pytest.mark.parametrize(
    ("what", "first", "last", "after_s", "tolerance_s"),
    [
        ("to 8 m and the end of the take-off", "mode 4/2 base 157", "mode 4/3", 76.0, 2.0),
        ("a landing from 2 m", "mode 4/6 base 157", "mode 4/3 base 29", 261.0, 2.5),
        ("the Hold before a fence's Return", "mode 4/3 base 157 status 5", "mode 4/5", 161.0, 1.1),
        ("armed and left alone", "mode 4/3 base 157", "mode 4/3 base 29", 60.0, 1.1),
        ("an Offboard that lost its setpoints and got them again", "mode 4/5", "mode 6/0", 100.0, 1.1),
    ],
)
def test_its_flights_last_as_long(
    what: str, first: str, last: str, after_s: float, tolerance_s: float
) -> None:
    real, simulated = both()
    took_s = duration_s(real, "heartbeat", first, last, after_s=after_s)
    assert duration_s(simulated, "heartbeat", first, last, after_s=after_s) == pytest.approx(
        took_s, abs=tolerance_s
    ), what


def test_a_return_lands_in_the_time_that_a_real_one_takes() -> None:
    real, simulated = both()
    for said in (real, simulated):
        took_s = duration_s(
            said, "event", "rtl_land_at_destination", "commander_landing_detected", after_s=190.0
        )
        assert 17.0 < took_s < 25.0


def test_the_first_seconds_tell_what_is_not_ready() -> None:
    _, simulated = both()
    early = words(simulated, "check", 10.1, after_s=0.0)
    assert any(each.startswith("check_modes_local_pos 3 7c001100") for each in early)
    assert any(each.startswith("check_modes_global_pos 3 38000000") for each in early)


def test_all_our_names_of_the_recordings_events_are_right() -> None:
    real, _ = both()
    assert EventMessage.id == 410
    assert len(set(words(real, "event"))) > 20
