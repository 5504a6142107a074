"""A simulated autopilot: its vehicle, its estimate, what it is doing, and what it answers.

Sans-IO and deterministic: time comes in by `step`, bytes by `receive`, bytes leave by `drain`. Physics and protocol
run on a fixed grid of 50 Hz whatever the steps are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mission.geometry.frames import Geodetic, Vector3
from simvehicle.autopilot import telemetry_messages as streams
from simvehicle.autopilot.channel import Channel
from simvehicle.autopilot.commands import CommandServer
from simvehicle.autopilot.fences import Area, FenceError, areas_of
from simvehicle.autopilot.flavour import Personality
from simvehicle.autopilot.inbox import Inbox
from simvehicle.autopilot.maneuvers import Idle, Land, Maneuver, Navigation, Return, TakeOff
from simvehicle.autopilot.mission_run import ACTIONS, NAVIGATION, MissionRun, Surroundings, Told
from simvehicle.autopilot.missions import FENCE, MISSION, RALLY, ListRules, MissionServer, StoredItem
from simvehicle.autopilot.parameters import Parameters, ParameterServer
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.vehicle.controller import Motion, PositionController
from simvehicle.vehicle.dynamics import GRAVITY_MPS2, Multirotor
from simvehicle.vehicle.estimator import Estimator
from simvehicle.world.air import World

TICK_S = 0.02
_SLOW_TICKS = 5
"""Failsafes, texts and the wind are looked at ten times a second."""
_CRASH_MPS = 3.5
_TEXT_BYTES = 50
"""Of one STATUSTEXT; a longer text goes out in numbered pieces."""
_ITEM_FRAMES = frozenset(
    (
        mavlink.MAV_FRAME_MISSION,
        mavlink.MAV_FRAME_GLOBAL,
        mavlink.MAV_FRAME_GLOBAL_INT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    )
)
RC_AT_REST_US = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)
"""The remote control as the recorded vehicle saw it; channel 5 is the mode switch."""
_LANDED_AFTER_S = 1.7
"""From touching the ground to being sure of it; as recorded."""


class Autopilot(Personality):
    """What both flavours have in common."""

    def __init__(self, spec: VehicleSpec, ready_after_s: float, world: World, seed: int) -> None:
        self.system = spec.id
        self.world = world
        self.ready_after_s = ready_after_s
        rng = np.random.default_rng([seed & 0xFFFFFFFF, spec.id, 0xA0])
        self.parameters = Parameters(self.flavour, spec.parameters)
        self.parameters.set(self.system_parameter, float(spec.id))
        self.body = Multirotor((spec.home_north_m, spec.home_east_m, 0.0))
        self.estimator = Estimator(world.frame, (spec.home_north_m, spec.home_east_m, 0.0), rng)
        self.battery = self.new_battery()
        self.controller = PositionController()
        self.channels = [Channel(index, spec.id) for index in range(len(spec.links))]
        self.missions = MissionServer(self._list_rules(), self.channels)
        self.parameter_server = ParameterServer(self.parameters)
        self.commands = CommandServer(self)
        self.inbox = Inbox(self)
        self.now_s: float | None = None
        self.boot_s = 0.0
        self.armed = False
        self.armed_s = 0.0
        self.landed = True
        self.crashed = False
        self.mode_is_news = False
        self.failsafe = False
        """Some failsafe has the vehicle: HEARTBEAT says CRITICAL."""
        self.home_m: Vector3 | None = None
        self.origin_is_set = False
        self.fence: tuple[Area, ...] = ()
        self.maneuver: Maneuver = Idle()
        self.motion = Motion(idle=True)
        self.mission_next = 0
        self.mission_complete = False
        self.silent = False
        self.gcs_heard_s: dict[int, float] = {}
        self.wind_estimate: Vector3 = (0.0, 0.0, 0.0)
        self.limits = self.new_limits()
        self.nav = Navigation(
            0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, False, (0.0, 0.0, 0.0), self.limits, 0.0
        )
        self._ticks = 0
        self._on_ground_s = 0.0
        self.wind_ned_mps: Vector3 = (0.0, 0.0, 0.0)
        self.rc_us = list(RC_AT_REST_US)
        self._texts: list[tuple[int, str]] = []
        self._text_id = 0
        self._heartbeat_due_s = 0.0

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Time since power-up."""
        return 0.0 if self.now_s is None else self.now_s - self.boot_s

    @property
    def is_landing(self) -> bool:
        maneuver = self.maneuver.maneuver if isinstance(self.maneuver, MissionRun) else self.maneuver
        return isinstance(maneuver, Land) or (isinstance(maneuver, Return) and maneuver.landing)

    @property
    def motion_wants_to_fly(self) -> bool:
        """On the ground, but about to leave it."""
        maneuver = self.maneuver.maneuver if isinstance(self.maneuver, MissionRun) else self.maneuver
        return isinstance(maneuver, TakeOff) or not self.motion.idle

    @property
    def home(self) -> Geodetic | None:
        return None if self.home_m is None else self.estimator.geodetic(self.home_m)

    @property
    def above_home_m(self) -> float:
        return self.nav.above_home_m

    def say(self, severity: int, text: str) -> None:
        """A STATUSTEXT to everybody, after the answer to a command that is being carried out."""
        self._texts.append((severity, text))

    def announce_mode(self) -> None:
        """A HEARTBEAT out of turn where the mode has just changed."""
        if self.mode_is_news:
            self.mode_is_news = False
            self.broadcast(streams.heartbeat(self))

    def broadcast(self, message: Any) -> None:
        for channel in self.channels:
            channel.send(message)

    def flush_texts(self) -> None:
        self.announce_mode()
        texts, self._texts = self._texts, []
        for severity, text in texts:
            data = text.encode()
            if len(data) <= _TEXT_BYTES:
                self.broadcast(mavlink.MAVLink_statustext_message(severity, data))
                continue
            self._text_id = self._text_id % 65535 + 1
            for part in range(0, len(data), _TEXT_BYTES):
                piece = data[part : part + _TEXT_BYTES]
                message = mavlink.MAVLink_statustext_message(
                    severity, piece, self._text_id, part // _TEXT_BYTES
                )
                self.broadcast(message)

    # -- bytes ----------------------------------------------------------------------------------------------

    def receive(self, link: int, data: bytes) -> None:
        """Bytes that came in on a link. A vehicle without power or on a dead radio hears nothing."""
        if self.now_s is not None and not self.silent:
            self.inbox.receive(self.channels[link], data)

    def drain(self) -> list[tuple[int, bytes]]:
        out = [(channel.link, data) for channel in self.channels for data in channel.drain()]
        return [] if self.silent else out

    # -- time -----------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Everything up to `now_s`. The first call is the power-up."""
        if self.now_s is None:
            self.now_s = self.boot_s = now_s
            for channel in self.channels:
                for message_id, interval_s in self.first_streams().items():
                    channel.set_stream(message_id, interval_s, now_s)
            self._heartbeat_due_s = now_s
        ticks = int((now_s - self.boot_s) / TICK_S + 1e-6)
        while self._ticks < ticks:
            self._ticks += 1
            self.now_s = self.boot_s + self._ticks * TICK_S
            self._tick(self.now_s)

    def _tick(self, now_s: float) -> None:
        body, estimator, nav = self.body, self.estimator, self.nav
        slow = self._ticks % _SLOW_TICKS == 0
        if slow:
            north, east, down = body.position
            self.wind_ned_mps = self.world.wind.wind_ned_mps((north, east, down), now_s)
        estimator.step(now_s, TICK_S, body.position, body.velocity)
        nav.now_s = now_s
        nav.position_m, nav.velocity_mps, nav.yaw_rad = (
            estimator.position_m,
            estimator.velocity_mps,
            body.yaw_rad,
        )
        nav.airborne = not self.landed
        if slow:
            self._slow(now_s)
        if self.armed:
            motion = self.maneuver.step(nav)
            self.motion = motion
            thrust = self.controller.step(TICK_S, motion, nav.position_m, nav.velocity_mps, self.limits)
            yaw_rad = motion.yaw_rad
            if motion.yaw_rate_radps is not None:
                yaw_rad = (
                    body.yaw_rad + 0.5 * motion.yaw_rate_radps
                )  # the heading loop's gain is 2 per second
            body.step(TICK_S, thrust, yaw_rad, self.wind_ned_mps)
            self._contact(thrust[2])
            if isinstance(self.maneuver, MissionRun):
                self._mission_told(self.maneuver)
        elif not body.on_ground or body.thrust[2] != 0.0:
            body.step(TICK_S, (0.0, 0.0, 0.0), None, self.wind_ned_mps)
            self._contact(0.0)
        self.battery.step(TICK_S, self.armed, body.thrust)
        if not self.silent:
            self._send_due(now_s)

    def _contact(self, wanted_down_mps2: float) -> None:
        body = self.body
        if body.impact_mps is not None:
            impact_mps, body.impact_mps = body.impact_mps, None
            self.on_touch(impact_mps)
            if impact_mps > _CRASH_MPS:
                self.crashed = True
                self.disarm(f"Crash: Disarming: hit the ground at {impact_mps:.1f} m/s", 2)
        if not body.on_ground:
            self.landed = False
            self._on_ground_s = 0.0
        elif not self.landed and -wanted_down_mps2 < GRAVITY_MPS2:
            self._on_ground_s += TICK_S
            if self._on_ground_s >= _LANDED_AFTER_S:
                self.landed = True
                self.on_landed()

    def _slow(self, now_s: float) -> None:
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s += 1.0
            self.broadcast(streams.heartbeat(self))
        blend = 0.1 / 5.0
        self.wind_estimate = (
            self.wind_estimate[0] + blend * (self.wind_ned_mps[0] - self.wind_estimate[0]),
            self.wind_estimate[1] + blend * (self.wind_ned_mps[1] - self.wind_estimate[1]),
            0.0,
        )
        self.missions.step(now_s)
        self.slow_step()

    def _send_due(self, now_s: float) -> None:
        if self._texts or self.mode_is_news:
            self.flush_texts()
        self.parameter_server.step(self.channels)
        for channel in self.channels:
            for message_id in channel.take_due(now_s):
                message = streams.build(self, message_id)
                if message is not None:
                    channel.send(message)

    # -- what both flavours do alike ------------------------------------------------------------------------

    def arm(self) -> None:
        self.armed = True
        self.armed_s = self.now_s or 0.0
        self.home_m = self.nav.position_m
        self.nav.home_m = self.home_m
        self.controller.reset()

    def disarm(self, text: str, severity: int = mavlink.MAV_SEVERITY_INFO) -> None:
        if self.armed:
            self.armed = False
            self.maneuver = Idle()
            self.motion = Motion(idle=True)
            self.say(severity, text)
            if self.body.on_ground:
                self.landed = True

    def set_origin(self) -> None:
        """The first fix: the local frame and home are known from now on."""
        self.origin_is_set = True
        self.home_m = self.nav.home_m = self.nav.position_m

    def new_mission(self, first: int, arrival_m: float) -> MissionRun:
        home_amsl_m = self.estimator.geodetic(self.nav.home_m).amsl_m
        around = Surroundings(self.estimator.local, home_amsl_m, arrival_m, self.back, first)
        return MissionRun(self.missions.lists[MISSION], around, self.mission_next)

    def _mission_told(self, run: MissionRun) -> None:
        self.mission_next = run.current
        told, run.told = run.told, []
        for what, sequence in told:
            if what is Told.REACHED:
                self.flush_texts()
                self.broadcast(mavlink.MAVLink_mission_item_reached_message(sequence))
            if what is Told.COMPLETE:
                self.mission_complete = True
            self.on_told(what, sequence)

    def _list_rules(self) -> ListRules:
        ardupilot = self.flavour == "ardupilot"
        return ListRules(
            legacy_requests=ardupilot,
            atomic=not ardupilot,
            stored=self._stored,
            finished=self._list_finished,
            progress=self.on_list_progress,
            read=self.read_item,
            set_current=self.set_mission_current,
        )

    def _stored(self, kind: int, item: StoredItem) -> StoredItem | int:
        """Refuse what no autopilot can fly, keep the rest as the flavour stores it."""
        if kind == MISSION and item.command not in NAVIGATION | ACTIONS:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if kind == RALLY and item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if item.frame not in _ITEM_FRAMES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        is_place = kind != MISSION or item.command in NAVIGATION
        if is_place and not (abs(item.x) <= 900_000_000 and abs(item.y) <= 1_800_000_000):
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        if is_place and not math.isfinite(item.z):
            return int(mavlink.MAV_MISSION_INVALID_PARAM7)
        return self.stored_item(kind, item)

    def _list_finished(self, kind: int, items: list[StoredItem]) -> int:
        if kind == FENCE:
            try:
                self.fence = areas_of(items, self.estimator.local)
            except FenceError as error:
                self.say(mavlink.MAV_SEVERITY_WARNING, str(error))
                return int(mavlink.MAV_MISSION_INVALID_PARAM1)
        if kind == MISSION:
            self.mission_next = 0
            self.mission_complete = False
            if isinstance(self.maneuver, MissionRun):
                self.maneuver = self.new_mission(*self.mission_rules())
        self.on_list(kind, items)
        return int(mavlink.MAV_MISSION_ACCEPTED)

    def set_mission_current(self, sequence: int) -> bool:
        if not 0 <= sequence < len(self.missions.lists[MISSION]):
            return False
        self.mission_next = sequence
        self.mission_complete = False
        if isinstance(self.maneuver, MissionRun):
            return self.maneuver.go_to(sequence)
        return True

    def set_parameter(self, name: str, value: float) -> None:
        self.parameters.set(name, value)
        self.limits = self.nav.limits = self.new_limits()
        self.parameter_changed(name)
