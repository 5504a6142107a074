"""Every request against a small scripted autopilot of each flavour, over links that lose, repeat and delay."""

from __future__ import annotations

import itertools
import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot import AutopilotSession, RequestKind, RequestOutcome, TakenBy
from flightstack.config import AutopilotConfig
from flightstack.swarm.topics import Delivery
from flightstack.transport.memory import Conditions, LossyLink
from mission.geometry.frames import Geodetic, LocalFrame

TICK_S = 0.1
FRAME = LocalFrame(Geodetic(-5.06, 151.3, 500.0))
HOME = Geodetic(-5.06, 151.3, 512.0)
"""12 m over the origin of the swarm's frame."""
FLAVOURS = ("ardupilot", "px4")
GUIDED, LOITER, RTL, LAND, BRAKE = 4, 5, 6, 9, 17
OFFBOARD, PX4_HOLD, PX4_RTL, PX4_LAND = 6 << 16, 3 << 24 | 4 << 16, 5 << 24 | 4 << 16, 6 << 24 | 4 << 16
POSITION_MODE = 3 << 16
SOUND = Conditions()
BAD = Conditions(loss=0.1, duplication=0.3, delay_s=0.1, jitter_s=0.1, reordering=0.3, held_back_s=0.2)


INTEGER = mavlink.MAV_PARAM_TYPE_INT32


def as_bytes(value: int) -> float:
    """An integer as PX4 sends it in a float's place."""
    return struct.unpack("<f", struct.pack("<i", value))[0]


class ScriptedAutopilot:
    """Says and refuses what the real ones do, as far as the session listens. Time is an argument."""

    def __init__(
        self, flavour: str, *, ready_s: float = 2.0, parameters: dict[str, tuple[float, int]] | None = None
    ):
        self.px4 = flavour == "px4"
        self.ready_s = ready_s
        self.link = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
        self.decoder = mavlink.MAVLink(None)
        self.decoder.robust_parsing = True
        self.parameters = dict(parameters or {})
        if self.px4:
            self.parameters.setdefault("COM_OBL_RC_ACT", (as_bytes(3), INTEGER))
            self.parameters.setdefault("RTL_CONE_ANG", (as_bytes(0), INTEGER))
        self.armed = False
        self.mode = POSITION_MODE if self.px4 else LOITER
        self.status = 3
        self.position = [0.0, 0.0, 0.0]
        """North, east metres from home, height over home."""
        self.climb_to: float | None = None
        self.velocity = (0.0, 0.0, 0.0)
        self.streams: dict[int, float] = {}
        self.sent_s: dict[int, float] = {}
        self.setpoint_s: list[float] = []
        self.setpoints: list[object] = []
        self.commands: list[tuple[int, int]] = []
        self.refuse_arming = ""
        self.prearm = True
        self.deaf_to: set[int] = set()
        self.streams_it_lacks: set[int] = set()
        self.out: list[object] = []

    @property
    def landed(self) -> bool:
        return self.position[2] < 0.2

    def step(self, now_s: float, data: bytes) -> bytes:
        for message in self.decoder.parse_buffer(data) or []:
            handler = getattr(self, f"on_{message.get_type().lower()}", None)
            if handler is not None and getattr(message, "target_system", 3) == 3:
                handler(now_s, message)
        self.fly(now_s)
        self.every(now_s, 0, 1.0, self.heartbeat)
        for kind, period_s in self.streams.items():
            self.every(now_s, kind, period_s, lambda kind=kind: self.telemetry(now_s, kind))
        encoded = b""
        for message in self.out:
            encoded += message.pack(self.link)
            self.link.seq = (self.link.seq + 1) % 256
        self.out = []
        return encoded

    def every(self, now_s: float, kind: int, period_s: float, make) -> None:
        if now_s - self.sent_s.get(kind, -1e9) >= period_s - 1e-6:
            self.sent_s[kind] = now_s
            message = make()
            if message is not None:
                self.out.append(message)

    def heartbeat(self):
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
            mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        )
        autopilot = mavlink.MAV_AUTOPILOT_PX4 if self.px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return mavlink.MAVLink_heartbeat_message(2, autopilot, base, self.mode, self.status, 3)

    def set_mode(self, mode: int, text: str = "") -> None:
        if mode != self.mode:
            self.mode = mode
            self.out.append(self.heartbeat())
        if text:
            self.say(text)

    def say(self, text: str, severity: int = 2) -> None:
        self.out.append(mavlink.MAVLink_statustext_message(severity, text.encode(), 0, 0))

    def ready(self, now_s: float) -> bool:
        return now_s >= self.ready_s

    def telemetry(self, now_s: float, kind: int):
        ms, ready = int(now_s * 1000), self.ready(now_s)
        point = LocalFrame(HOME).to_geodetic((self.position[0], self.position[1], -self.position[2]))
        latitude, longitude = round(point.latitude_deg * 1e7), round(point.longitude_deg * 1e7)
        match kind:
            case mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
                velocity = [round(100 * v) for v in self.velocity]
                height_mm = round(self.position[2] * 1000)
                return mavlink.MAVLink_global_position_int_message(
                    ms, latitude, longitude, round(point.amsl_m * 1000), height_mm, *velocity, 0
                )
            case mavlink.MAVLINK_MSG_ID_ATTITUDE:
                return mavlink.MAVLink_attitude_message(ms, 0, 0, 0.5, 0, 0, 0)
            case mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
                return mavlink.MAVLink_extended_sys_state_message(0, 1 if self.landed else 2)
            case mavlink.MAVLINK_MSG_ID_SYS_STATUS:
                bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
                return mavlink.MAVLink_sys_status_message(
                    bit, bit, bit if ready and self.prearm else 0, 0, 12000, 100, 80, 0, 0, 0, 0, 0, 0
                )
            case mavlink.MAVLINK_MSG_ID_HOME_POSITION if ready:
                return mavlink.MAVLink_home_position_message(
                    round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7), round(HOME.amsl_m * 1000),
                    0, 0, 0, [1, 0, 0, 0], 0, 0, 0,
                )  # fmt: skip
            case mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT:
                return mavlink.MAVLink_ekf_status_report_message(831 if ready else 167, 0, 0, 0, 0, 0)
            case mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
                return mavlink.MAVLink_estimator_status_message(
                    ms * 1000, 831 if ready else 165, 0, 0, 0, 0, 0, 0, 0, 0
                )
            case mavlink.MAVLINK_MSG_ID_WIND:
                return mavlink.MAVLink_wind_message(90.0, 3.0, 0.0)
            case mavlink.MAVLINK_MSG_ID_WIND_COV:
                return mavlink.MAVLink_wind_cov_message(0, 0.0, -3.0, 0.0, 0.4, 0.1, 500.0, 0.0, 0.0)
        return None

    def on_command_long(self, now_s: float, message) -> None:
        command = message.command
        self.commands.append((command, message.confirmation))
        if command in self.deaf_to:
            return
        result = mavlink.MAV_RESULT_ACCEPTED
        text = ""
        match command:
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL if int(message.param1) in self.streams_it_lacks:
                result = mavlink.MAV_RESULT_UNSUPPORTED if self.px4 else mavlink.MAV_RESULT_DENIED
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self.streams[int(message.param1)] = message.param2 * 1e-6
            case mavlink.MAV_CMD_DO_SET_MODE:
                result = self.change_mode(now_s, message)
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM if message.param1 == 1.0:
                if not self.ready(now_s):
                    result, text = mavlink.MAV_RESULT_FAILED, "Arm: Need Alt Estimate"
                elif self.refuse_arming:
                    result, text = mavlink.MAV_RESULT_FAILED, self.refuse_arming
                else:
                    self.armed = True
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                assert message.param2 != 21196, "nobody may force a disarm"
                if self.landed:
                    self.armed = False
                else:
                    result = mavlink.MAV_RESULT_FAILED
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                if self.armed and self.mode == GUIDED and self.landed and self.climb_to is None:
                    self.climb_to = message.param7
                else:
                    result = mavlink.MAV_RESULT_FAILED
            case mavlink.MAV_CMD_NAV_LAND:
                self.set_mode(PX4_LAND if self.px4 else LAND)
            case _:
                result = mavlink.MAV_RESULT_UNSUPPORTED
        self.out.append(
            mavlink.MAVLink_command_ack_message(
                command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )
        if text:
            self.say(text)

    def change_mode(self, now_s: float, message) -> int:
        mode = int(message.param2)
        if self.px4:
            mode = int(message.param3 if math.isfinite(message.param3) else 0) << 24 | mode << 16
            if mode == OFFBOARD and not self.setpoints_flow(now_s):
                return mavlink.MAV_RESULT_DENIED
        self.set_mode(mode)
        return mavlink.MAV_RESULT_ACCEPTED

    def setpoints_flow(self, now_s: float) -> bool:
        return len([t for t in self.setpoint_s if now_s - t < 1.0]) >= 2

    def on_set_position_target_global_int(self, now_s: float, message) -> None:
        assert message.type_mask & ~0x400 == 0x9F8
        point = Geodetic(message.lat_int * 1e-7, message.lon_int * 1e-7, HOME.amsl_m)
        north_m, east_m, _ = LocalFrame(HOME).to_ned(point)
        # An altitude over home is wrong in PX4 itself, so it must not get one.
        expected = mavlink.MAV_FRAME_GLOBAL_INT if self.px4 else mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        assert message.coordinate_frame == expected
        height_m = message.alt - HOME.amsl_m if self.px4 else message.alt
        self.take_setpoint(now_s, ("position", north_m, east_m, height_m))

    def on_set_position_target_local_ned(self, now_s: float, message) -> None:
        assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
        assert message.type_mask & ~0x400 == 0x9C7
        self.take_setpoint(now_s, ("velocity", message.vx, message.vy, -message.vz))

    def take_setpoint(self, now_s: float, setpoint) -> None:
        self.setpoint_s.append(now_s)
        self.setpoints.append(setpoint)

    def on_param_request_read(self, now_s: float, message) -> None:
        self.tell_parameter(message.param_id)

    def on_param_set(self, now_s: float, message) -> None:
        if message.param_id in self.parameters:
            self.parameters[message.param_id] = (message.param_value, message.param_type)
            self.tell_parameter(message.param_id)

    def tell_parameter(self, name: str) -> None:
        if name in self.parameters:
            value, kind = self.parameters[name]
            self.out.append(mavlink.MAVLink_param_value_message(name.encode(), value, kind, 900, 5))

    def fly(self, now_s: float) -> None:
        """Straight to what was asked last; nothing of flight dynamics matters here."""
        ours = self.mode == (OFFBOARD if self.px4 else GUIDED)
        self.velocity = (0.0, 0.0, 0.0)
        if self.px4 and ours and self.armed and now_s - (self.setpoint_s or [-9.0])[-1] > 1.0:
            self.set_mode(PX4_RTL, "Failsafe activated: offboard link lost")
        if not self.armed:
            return
        if self.mode in (LAND, RTL, PX4_LAND, PX4_RTL):
            self.climb_to = None
            self.position[2] = max(0.0, self.position[2] - 2.0 * TICK_S)
            if self.landed:
                self.armed = False
                self.out.append(self.heartbeat())
        elif self.climb_to is not None:
            self.position[2] = min(self.climb_to, self.position[2] + 2.0 * TICK_S)
            if self.position[2] >= self.climb_to:
                self.climb_to = None
        elif ours and self.setpoints:
            kind, north, east, up = self.setpoints[-1]
            if kind == "velocity" and (up > 0.0 or not self.landed):
                self.velocity = (north, east, -up)
                step = (north * TICK_S, east * TICK_S, up * TICK_S)
            elif kind == "position":
                gap = (north - self.position[0], east - self.position[1], up - self.position[2])
                share = min(1.0, 3.0 * TICK_S / max(math.hypot(*gap), 1e-6))
                step = tuple(share * g for g in gap)
            else:
                step = (0.0, 0.0, 0.0)
            self.position = [
                max(p + s, 0.0) if i == 2 else p + s
                for i, (p, s) in enumerate(zip(self.position, step, strict=True))
            ]


class Wire:
    """One direction between session and autopilot, as bad as a link of the swarm's radio can be."""

    def __init__(self, seed: int, sender: str, receiver: str, conditions: Conditions):
        self.link = LossyLink(seed, sender, receiver)
        self.conditions = conditions
        self.cut = False
        self.flying: list[tuple[float, int, bytes]] = []
        self.count = 0

    def send(self, now_s: float, data: bytes) -> None:
        for frame in () if self.cut else frames_of(data):
            for due_s in self.link.arrivals_s(now_s, self.conditions, Delivery.BEST_EFFORT):
                self.count += 1
                self.flying.append((due_s, self.count, frame))

    def receive(self, now_s: float) -> bytes:
        due = sorted(item for item in self.flying if item[0] <= now_s)
        self.flying = [item for item in self.flying if item[0] > now_s]
        return b"".join(frame for _, _, frame in due)


def frames_of(data: bytes) -> list[bytes]:
    frames, at = [], 0
    while at < len(data):
        length = data[at + 1] + 12
        frames.append(data[at : at + length])
        at += length
    return frames


class ScriptedFlight:
    """A session and its scripted autopilot, ticked together."""

    def __init__(self, flavour: str, *, parameters=None, config=None, link: Conditions = SOUND, seed=1, **kw):
        self.autopilot = ScriptedAutopilot(flavour, parameters=parameters, **kw)
        self.session = AutopilotSession(3, FRAME, AutopilotConfig(link="unused", **(config or {})))
        self.up = Wire(seed, "companion", "autopilot", link)
        self.down = Wire(seed, "autopilot", "companion", link)
        self.ticks = 0
        self.results = []
        self.texts: list[str] = []
        self.sent = b""

    @property
    def now_s(self) -> float:
        return self.ticks * TICK_S

    @property
    def report(self):
        return self.session.report

    def tick(self, ask=None) -> None:
        self.ticks += 1
        now_s = self.now_s
        self.session.receive(now_s, self.down.receive(now_s))
        self.texts += [text.text for text in self.session.report.new_texts]
        if ask is not None:
            ask()
        sent = self.session.step(now_s)
        self.sent += sent
        self.results += self.session.take_results()
        self.up.send(now_s, sent)
        self.down.send(now_s, self.autopilot.step(now_s, self.up.receive(now_s)))

    def run(self, seconds: float, ask=None) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.tick(ask)

    def until(self, kind: RequestKind, ask, limit_s: float = 60.0):
        """Keep asking until a request of `kind` has ended with something else than lapsing; its result."""
        end = self.ticks + limit_s / TICK_S
        while self.ticks < end:
            known = len(self.results)
            self.tick(ask)
            for result in self.results[known:]:
                if result.kind is kind and result.outcome is not RequestOutcome.LAPSED:
                    return result
        raise AssertionError(f"{kind} did not end in {limit_s} s: {self.session.transaction}, {self.report}")

    def fly(self, above_home_m: float = 20.0) -> ScriptedFlight:
        """Arm and take off as the agent does it."""
        session = self.session
        assert self.until(RequestKind.TAKE_CONTROL, session.take_control).outcome is RequestOutcome.SUCCEEDED
        assert self.until(RequestKind.ARM, session.arm).outcome is RequestOutcome.SUCCEEDED
        result = self.until(RequestKind.TAKEOFF, lambda: session.takeoff(above_home_m))
        assert result.outcome is RequestOutcome.SUCCEEDED, result
        return self


LINKS = [
    pytest.param(SOUND, id="sound"),
    pytest.param(Conditions(loss=0.2), id="losing"),
    pytest.param(Conditions(duplication=0.5), id="repeating"),
    pytest.param(Conditions(delay_s=0.1, jitter_s=0.1, reordering=0.5, held_back_s=0.2), id="late"),
    pytest.param(BAD, id="bad"),
]


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_whole_flight(flavour, link):
    world = ScriptedFlight(flavour, ready_s=8.0, link=link)
    world.run(3.0)
    assert not world.report.ready
    assert world.report.ready_reason
    world.fly(20.0)
    assert world.now_s > 8.0
    assert world.report.airborne
    assert world.report.mode_ours
    # 20 m over the swarm's origin are 8 m over this home, which lies 12 m higher.
    assert world.autopilot.position[2] == pytest.approx(8.0, abs=1.1)

    world.run(15.0, lambda: world.session.target_position((30.0, -10.0, -22.0), 1.0))
    assert world.autopilot.position == pytest.approx([30.0, -10.0, 10.0], abs=0.3)
    assert world.report.position_ned_m == pytest.approx((30.0, -10.0, -22.0), abs=0.4)
    assert world.report.home_ned_m == pytest.approx((0.0, 0.0, -12.0), abs=0.1)

    world.run(5.0, lambda: world.session.target_velocity((2.0, 0.0, 0.0)))
    assert world.autopilot.position[0] == pytest.approx(40.0, abs=2.5)
    assert world.report.taken_by is TakenBy.NOBODY

    assert world.until(RequestKind.LAND, world.session.land).outcome is RequestOutcome.SUCCEEDED
    world.run(12.0)
    assert not world.report.armed
    assert not world.report.airborne


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_same_flight_twice_sends_the_same_bytes(flavour):
    worlds = [ScriptedFlight(flavour, link=BAD, seed=5).fly() for _ in range(2)]
    assert worlds[0].sent == worlds[1].sent


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_only_what_is_needed_is_asked_for_and_only_until_it_comes(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0)
    world.run(10.0)
    assert set(world.autopilot.streams) == {0x21, 30, 245, 1, 242} | (
        {230, 231} if flavour == "px4" else {193, 168}
    )
    asked = len(world.autopilot.commands)
    world.run(20.0)
    assert len(world.autopilot.commands) == asked
    assert world.report.notes == ()


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_autopilot_that_forgets_its_streams_is_asked_again(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0)
    world.run(8.0)
    world.autopilot.streams.clear()
    world.run(15.0)
    assert len(world.autopilot.streams) == 7
    assert world.report.position_age_s < 0.3


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_stream_that_is_refused_is_told_and_not_asked_for_all_the_time(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0)
    world.autopilot.streams_it_lacks = {
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    }
    world.run(30.0)
    assert world.report.notes == ("autopilot does not send ATTITUDE",)
    assert len(world.autopilot.commands) == 7
    world.fly()  # height tells that it flies


def test_arming_waits_until_it_is_ready_then_tells_the_refusals_of_the_autopilot():
    world = ScriptedFlight("ardupilot", ready_s=5.0, config={"ready_timeout_s": 20.0})
    world.autopilot.refuse_arming = "Arm: Compass not calibrated"
    result = world.until(RequestKind.ARM, world.session.arm)
    assert result.outcome is RequestOutcome.TIMED_OUT
    assert "Arm: Compass not calibrated" in result.reason
    assert 20.0 <= result.took_s < 21.0
    attempts = [c for c in world.autopilot.commands if c[0] == mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
    assert 3 <= len(attempts) <= 6
    assert world.session.problem == result.reason


def test_a_refusal_shows_in_the_report_while_it_is_tried_again():
    world = ScriptedFlight("ardupilot", ready_s=0.0)
    world.autopilot.refuse_arming = "Arm: Throttle too high"
    world.run(8.0, world.session.arm)
    assert world.report.ready_reason == "arming refused: Arm: Throttle too high"
    world.autopilot.refuse_arming = ""
    assert world.until(RequestKind.ARM, world.session.arm).outcome is RequestOutcome.SUCCEEDED


def test_what_keeps_it_from_arming_is_its_newest_round_of_reasons():
    """5.1 m off, then 5.2 m, then 5.3 m: for hours on the ground, and each state is sent to all."""
    world = ScriptedFlight("ardupilot", ready_s=0.0)
    world.autopilot.prearm = False
    for error_m in (5.1, 5.2, 5.3):
        world.autopilot.say("PreArm: Compass not calibrated")
        world.autopilot.say(f"PreArm: GPS and AHRS differ by {error_m}m")
        world.run(30.0)
    assert world.report.ready_reason == "PreArm: Compass not calibrated; PreArm: GPS and AHRS differ by 5.3m"


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_arming_that_nobody_asks_for_any_more_lapses(flavour):
    world = ScriptedFlight(flavour, ready_s=10.0)
    world.run(2.0, world.session.arm)
    world.run(20.0)
    assert not world.autopilot.armed
    assert [r.outcome for r in world.results] == [RequestOutcome.LAPSED]
    assert world.session.problem == ""


def test_an_unanswered_command_is_repeated_with_a_confirmation_and_then_named():
    world = ScriptedFlight("ardupilot", ready_s=0.0).fly()
    world.autopilot.deaf_to = {mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_DO_SET_MODE}
    result = world.until(RequestKind.LAND, world.session.land)
    assert result.outcome is RequestOutcome.NO_ANSWER
    lands = [c for c in world.autopilot.commands if c[0] == mavlink.MAV_CMD_NAV_LAND]
    assert lands[:5] == [(mavlink.MAV_CMD_NAV_LAND, n) for n in range(5)]
    assert "no answer" in world.session.problem
    # Deaf to one way of asking only: the other one is tried.
    world.autopilot.deaf_to = {mavlink.MAV_CMD_NAV_LAND}
    assert world.until(RequestKind.LAND, world.session.land).outcome is RequestOutcome.SUCCEEDED


def test_a_return_is_asked_for_also_when_nothing_is_heard_any_more():
    world = ScriptedFlight("ardupilot", ready_s=0.0).fly()
    world.down.cut = True
    world.run(8.0)
    assert not world.report.connected
    assert world.until(RequestKind.RETURN, world.session.rtl).outcome is RequestOutcome.NO_ANSWER
    assert world.autopilot.mode == RTL


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_requests_that_repeat_do_not_pile_up(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0).fly()
    before = len(world.autopilot.commands)
    world.run(1.0, world.session.rtl)
    assert len(world.autopilot.commands) == before + 1
    assert world.report.mode == "RTL"
    assert not world.report.mode_ours
    assert world.report.taken_by is TakenBy.NOBODY


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_newest_request_takes_the_place_of_the_one_before(flavour):
    world = ScriptedFlight(flavour, ready_s=30.0)
    world.run(3.0, world.session.arm)
    world.tick(world.session.hold)
    assert world.results[-1].outcome is RequestOutcome.SUPERSEDED
    assert world.until(RequestKind.HOLD, world.session.hold).outcome is RequestOutcome.SUCCEEDED


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_pilot_takes_the_vehicle_and_targets_stop_at_once(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0).fly()
    world.run(2.0, lambda: world.session.target_position((5.0, 0.0, -20.0)))
    world.autopilot.set_mode(POSITION_MODE if flavour == "px4" else LOITER)
    world.run(0.2, lambda: world.session.target_position((5.0, 0.0, -20.0)))
    assert not world.report.mode_ours
    assert world.report.taken_by is TakenBy.PILOT
    count = len(world.autopilot.setpoints)
    world.run(3.0, lambda: world.session.target_position((5.0, 0.0, -20.0)))
    assert len(world.autopilot.setpoints) == count
    # Back in our mode by the pilot's switch: still not ours, until we are told to take it.
    world.autopilot.setpoint_s.append(world.now_s)
    world.autopilot.set_mode(OFFBOARD if flavour == "px4" else GUIDED)
    world.run(0.5)
    assert not world.report.mode_ours
    assert (
        world.until(RequestKind.TAKE_CONTROL, world.session.take_control).outcome is RequestOutcome.SUCCEEDED
    )
    assert world.report.mode_ours


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_failsafe_is_told_from_a_pilot_by_its_text(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0).fly()
    world.autopilot.say("Battery Failsafe", 4)
    world.autopilot.set_mode(PX4_RTL if flavour == "px4" else RTL)
    world.run(0.3, lambda: world.session.target_velocity((0.0, 0.0, 0.0)))
    assert world.report.taken_by is TakenBy.AUTOPILOT
    assert world.report.failsafe
    assert world.report.failsafe_reason == "Battery Failsafe"


def test_a_pilot_during_the_take_off_ends_it():
    world = ScriptedFlight("ardupilot", ready_s=0.0)
    world.until(RequestKind.ARM, world.session.arm)
    world.run(2.0, lambda: world.session.takeoff(40.0))
    world.autopilot.set_mode(LOITER)
    result = world.until(RequestKind.TAKEOFF, lambda: world.session.takeoff(40.0))
    assert result.outcome is RequestOutcome.TAKEN
    assert "LOITER" in result.reason
    world.run(3.0, lambda: world.session.takeoff(40.0))
    assert world.autopilot.mode == LOITER


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_vehicle_that_somebody_else_armed_is_not_taken(flavour):
    world = ScriptedFlight(flavour, ready_s=10.0)
    world.run(2.0, world.session.arm)
    world.autopilot.armed = True
    result = world.until(RequestKind.ARM, world.session.arm)
    assert result.outcome is RequestOutcome.REFUSED
    assert "somebody else" in result.reason
    assert (
        world.until(RequestKind.TAKEOFF, lambda: world.session.takeoff(20.0)).outcome
        is RequestOutcome.REFUSED
    )


def test_no_target_goes_to_ardupilot_before_it_is_up():
    world = ScriptedFlight("ardupilot", ready_s=0.0)
    world.until(RequestKind.ARM, world.session.arm)
    world.run(1.0, lambda: world.session.target_position((0.0, 0.0, -20.0)))
    assert world.autopilot.setpoints == []
    assert world.report.notes == ("setpoint withheld: take-off first",)


def test_px4_gets_setpoints_before_and_without_a_gap_after_offboard():
    world = ScriptedFlight("px4", ready_s=0.0).fly()
    first = world.autopilot.setpoints[0]
    assert first == ("velocity", 0.0, 0.0, -0.5)  # pressed to the ground until it shall fly
    times = world.autopilot.setpoint_s
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.45


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_target_below_the_own_home_is_refused_before_the_take_off(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0)
    world.until(RequestKind.TAKE_CONTROL, world.session.take_control)
    world.until(RequestKind.ARM, world.session.arm)
    result = world.until(RequestKind.TAKEOFF, lambda: world.session.takeoff(11.0), 40.0)
    assert result.outcome is RequestOutcome.REFUSED
    assert "above_home_m" in result.reason


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_disarm_on_the_ground_only(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0).fly()
    result = world.until(RequestKind.DISARM, world.session.disarm)
    assert result.outcome is RequestOutcome.REFUSED
    assert "flying" in result.reason
    assert world.autopilot.armed
    world.until(RequestKind.LAND, world.session.land)
    world.run(20.0)
    assert world.until(RequestKind.DISARM, world.session.disarm).outcome is RequestOutcome.SUCCEEDED


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_parameters_are_set_as_the_flavour_writes_them(loss):
    integer = mavlink.MAV_PARAM_TYPE_INT32
    packed = 2.802596928649634e-45  # the bytes of the integer 2
    config = {"parameters": {"FENCE_ENABLE": 1.0, "WPNAV_SPEED": 500.0}}
    ardupilot = ScriptedFlight(
        "ardupilot", ready_s=0.0, link=Conditions(loss=loss), seed=2, config=config,
        parameters={"FENCE_ENABLE": (0.0, mavlink.MAV_PARAM_TYPE_INT8), "WPNAV_SPEED": (500.0, 9)},
    )  # fmt: skip
    assert not ardupilot.session.prepared
    assert ardupilot.until(RequestKind.PREPARE, ardupilot.session.prepare).outcome is RequestOutcome.SUCCEEDED
    assert ardupilot.autopilot.parameters["FENCE_ENABLE"][0] == 1.0
    assert ardupilot.session.prepared

    config = {"parameters": {"NAV_DLL_ACT": 2.0, "MPC_XY_CRUISE": 6.5}}
    px4 = ScriptedFlight(
        "px4", ready_s=0.0, link=Conditions(loss=loss), seed=2, config=config,
        parameters={"NAV_DLL_ACT": (0.0, integer), "MPC_XY_CRUISE": (5.0, 9)},
    )  # fmt: skip
    assert px4.until(RequestKind.PREPARE, px4.session.prepare).outcome is RequestOutcome.SUCCEEDED
    assert px4.autopilot.parameters["NAV_DLL_ACT"] == (packed, integer)
    assert px4.autopilot.parameters["MPC_XY_CRUISE"][0] == 6.5


def test_a_parameter_that_does_not_exist_or_is_no_integer_is_named():
    config = {"parameters": {"NO_SUCH": 1.0, "FENCE_ENABLE": 0.5}}
    world = ScriptedFlight(
        "ardupilot",
        ready_s=0.0,
        config=config,
        parameters={"FENCE_ENABLE": (0.0, mavlink.MAV_PARAM_TYPE_INT8)},
    )
    result = world.until(RequestKind.PREPARE, world.session.prepare)
    assert result.outcome is RequestOutcome.REFUSED
    assert "NO_SUCH does not answer" in result.reason
    assert "FENCE_ENABLE is an integer" in result.reason
    assert not world.session.prepared


def test_arming_prepares_first():
    config = {"parameters": {"FENCE_ENABLE": 1.0}}
    world = ScriptedFlight(
        "ardupilot",
        ready_s=0.0,
        config=config,
        parameters={"FENCE_ENABLE": (0.0, mavlink.MAV_PARAM_TYPE_INT8)},
    )
    assert world.until(RequestKind.ARM, world.session.arm).outcome is RequestOutcome.SUCCEEDED
    assert world.session.prepared
    assert world.autopilot.parameters["FENCE_ENABLE"][0] == 1.0


def test_a_flavour_that_is_not_the_configured_one_is_never_ready():
    world = ScriptedFlight("px4", ready_s=0.0, config={"flavour": "ardupilot"})
    world.run(5.0, world.session.arm)
    assert not world.report.ready
    assert "autopilot.flavour" in world.report.ready_reason
    assert world.autopilot.commands == []


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_wind_goes_where_it_blows_to(flavour):
    world = ScriptedFlight(flavour, ready_s=0.0)
    winds = []
    for _ in range(80):
        world.ticks += 1
        world.session.receive(world.now_s, world.down.receive(world.now_s))
        if world.report.wind_ned_mps is not None:
            winds.append((world.report.wind_ned_mps, world.report.wind_sd_mps))
        world.up.send(world.now_s, world.session.step(world.now_s))
        world.down.send(world.now_s, world.autopilot.step(world.now_s, world.up.receive(world.now_s)))
    assert 3 <= len(winds) <= 9  # once a second, each told once
    assert winds[0][0] == pytest.approx((0.0, -3.0, 0.0), abs=1e-5)
    assert winds[0][1] == (None if flavour == "ardupilot" else pytest.approx(0.4))


def test_a_restarted_autopilot_is_a_new_one():
    world = ScriptedFlight("ardupilot", ready_s=0.0, config={"parameters": {"FENCE_ENABLE": 1.0}},
                  parameters={"FENCE_ENABLE": (1.0, mavlink.MAV_PARAM_TYPE_INT8)})  # fmt: skip
    world.run(40.0)
    world.until(RequestKind.PREPARE, world.session.prepare)
    assert world.session.prepared
    fresh = ScriptedAutopilot("ardupilot", ready_s=1e9)
    fresh.streams = dict(world.autopilot.streams)
    original = fresh.telemetry
    fresh.telemetry = lambda now_s, kind: original(now_s - 38.0, kind)
    world.autopilot = fresh
    world.run(3.0)
    assert not world.session.prepared
    assert not world.report.ready


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_target_that_is_no_number_is_refused(bad):
    world = ScriptedFlight("px4")
    with pytest.raises(ValueError, match="finite"):
        world.session.target_position((0.0, bad, 0.0))
    with pytest.raises(ValueError, match="finite"):
        world.session.target_velocity((0.0, 0.0, 0.0), bad)


def test_named_values_are_told_once():
    world = ScriptedFlight("ardupilot", ready_s=0.0)
    world.run(2.0)
    world.autopilot.out.append(mavlink.MAVLink_named_value_float_message(1, b"co2", 512.5))
    world.tick()
    world.ticks += 1
    world.session.receive(world.now_s, world.down.receive(world.now_s))
    assert world.report.named_values == (("co2", pytest.approx(512.5)),)
    world.session.step(world.now_s)
    assert world.report.named_values == ()


def test_the_own_heartbeat_goes_out_once_a_second_from_the_first_step():
    session = AutopilotSession(3, FRAME, AutopilotConfig(link="unused"))
    decoder = mavlink.MAVLink(None)
    beats = []
    for tick in range(51):
        for message in decoder.parse_buffer(session.step(tick * 0.1)) or []:
            assert (message.get_srcSystem(), message.get_srcComponent()) == (3, 191)
            assert (message.type, message.autopilot) == (18, 8)
            beats.append(tick)
    assert beats == [0, 10, 20, 30, 40, 50]
