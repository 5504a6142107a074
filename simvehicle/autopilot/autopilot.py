"""A simulated autopilot: the services that answer on its links, put together over a vehicle.

Sans-IO and deterministic: time comes in by `step`, bytes by `receive`, bytes leave by `drain`. Physics and protocol
run on a fixed grid of 50 Hz whatever the steps are.
"""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.signing import Signing
from mission.geometry.frames import Vector3
from simvehicle.autopilot.announcer import Announcer
from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler
from simvehicle.autopilot.commands import CommandServer
from simvehicle.autopilot.flight import TICK_S, Flight
from simvehicle.autopilot.flight_commands import FlightCommands
from simvehicle.autopilot.link_services import LinkServices
from simvehicle.autopilot.link_signing import LinkSigning
from simvehicle.autopilot.message_router import MessageRouter
from simvehicle.autopilot.message_streams import MessageStreams
from simvehicle.autopilot.mission_run import Told
from simvehicle.autopilot.missions import MissionServer, StoredItem, empty_lists
from simvehicle.autopilot.obstacle_report import ObstacleReport
from simvehicle.autopilot.parameters import Parameters, ParameterServer
from simvehicle.autopilot.personality import FlavourRecipe, SharedParts
from simvehicle.autopilot.pilot import RemoteControl
from simvehicle.autopilot.telemetry_motion import MotionTelemetry
from simvehicle.autopilot.telemetry_status import StatusTelemetry
from simvehicle.autopilot.uploaded_lists import FenceAreas, UploadedLists
from simvehicle.vehicle.range_finder import RangeFinder, RangeFinderConfig
from simvehicle.vehicle.vehicle import make_vehicle
from simvehicle.world.air import World

_SLOW_TICKS = 5
"""Failsafes, texts and the wind are looked at ten times a second."""
_CRASH_MPS = 3.5


class Autopilot:
    def __init__(
        self,
        recipe: FlavourRecipe,
        parameters: Parameters,
        world: World,
        *,
        system: int,
        home_ned_m: Vector3,
        links: int,
        ready_after_s: float,
        seed: int,
        quiet: bool = False,
        signing: Signing | None = None,
        usb_links: tuple[int, ...] = (),
        range_finder: RangeFinderConfig | None = None,
    ) -> None:
        """`signing`: the key that the vehicle was given before. On `usb_links` it needs no signature.
        `range_finder`: of a sensor that speaks MAVLink on the first link."""
        parameters.set(recipe.system_parameter, float(system))
        self.parameters = parameters
        self.silent = False
        self._weak_battery_fraction = recipe.weak_battery_fraction
        self._powered = False
        self._ticks = 0
        self._heartbeat_due_s = 0.0
        self._signing = LinkSigning(signing, usb_links)
        self._channels = [Channel(index, system, self._signing) for index in range(links)]
        self._announcer = Announcer(self._channels, self._message, recipe.texts, lambda: self.flight.now_s)
        vehicle = make_vehicle(world, home_ned_m, recipe.battery(parameters), system=system, seed=seed)
        self.vehicle = vehicle
        self.flight = Flight(vehicle, recipe.limits(parameters), ready_after_s, self._announcer.say)
        self.obstacle_report: ObstacleReport | None = None
        if range_finder is not None:
            finder = RangeFinder(range_finder, world.obstacles, system=system, seed=seed)
            self.obstacle_report = ObstacleReport(finder, self.flight, self._channels[0], system)
        self.lists: dict[int, list[StoredItem]] = empty_lists()
        """Mission, fence and rally points as they were uploaded."""
        self.fence = FenceAreas()
        remote = RemoteControl()
        ground_heard_s: dict[int, float] = {}
        own = recipe.build(
            SharedParts(
                system,
                self.flight,
                parameters,
                self._announcer,
                self.lists,
                self.fence,
                remote,
                ground_heard_s,
                self._set_parameter,
                quiet,
            )
        )
        self.personality = own
        uploaded = UploadedLists(
            own.lists, own.progress, self.fence, vehicle.estimator.local, self._announcer.say
        )
        self._missions = MissionServer(uploaded.rules(), self._channels, self.lists)
        self._parameter_server = ParameterServer(
            parameters, own.parameters, self._channels, own.events.parameter_changed
        )
        motion = MotionTelemetry(self.flight, own.estimate, own.identity.gps_fix_type)
        status = StatusTelemetry(
            self.flight,
            own.progress,
            remote,
            own.modes,
            own.estimate,
            own.health,
            mav_autopilot=own.identity.mav_autopilot,
            vtol_state=own.identity.vtol_state,
            no_mission_total=own.identity.no_mission_total,
        )
        messages = {**motion.messages(), **status.messages(), **own.messages}
        self.streams = MessageStreams(messages, own.streams, self._channels, lambda: self.flight.now_s)
        table = {
            **self.streams.table(),
            **FlightCommands(self.flight, own.progress).table(),
            **own.commands,
        }
        commands = CommandServer(table, self._channels, self._announcer.flush, own.split_mode, own.answers)
        handlers: dict[str, Handler] = {
            "SETUP_SIGNING": lambda _channel, _peer, message: self._set_signing(message),
            "SET_POSITION_TARGET_LOCAL_NED": lambda _channel, _peer, message: own.events.setpoint(message),
            "SET_POSITION_TARGET_GLOBAL_INT": lambda _channel, _peer, message: own.events.setpoint(message),
        }
        link_services = LinkServices(self.flight, ground_heard_s, self._announcer.ground_heard)
        for service in (self._parameter_server, commands, self.streams, own.pilot, link_services):
            handlers |= service.handlers()
        handlers |= own.handlers
        self._router = MessageRouter(system, self._channels, handlers, self._list_message)

    # -- bytes ----------------------------------------------------------------------------------------------

    def receive(self, link: int, data: bytes) -> None:
        """Bytes that came in on a link. A vehicle without power or on a dead radio hears nothing."""
        if self._powered and not self.silent:
            self._router.receive(self._channels[link], data)

    def drain(self) -> list[tuple[int, bytes]]:
        out = [(channel.link, data) for channel in self._channels for data in channel.drain()]
        return [] if self.silent else out

    def _list_message(self, _channel: Channel, peer: ChannelPeer, message: Any) -> None:
        self._missions.receive(self.flight.now_s, peer, message)
        self._announcer.flush()

    @property
    def signing_key(self) -> bytes | None:
        """What it signs with; None: it does not."""
        return self._signing.key

    def _set_signing(self, message: Any) -> None:
        if self.flight.armed:
            self._announcer.say(mavlink.MAV_SEVERITY_ERROR, "ERROR: Won't setup signing when armed")
        else:
            self._signing.setup(message)

    def _message(self, message_id: int) -> Any | None:
        return self.streams.messages[message_id]()

    def _set_parameter(self, name: str, value: float) -> None:
        self._parameter_server.set(name, value)

    # -- time -----------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Everything up to `now_s`. The first call is the power-up."""
        if not self._powered:
            self._powered = True
            self.flight.power_up(now_s)
            self.streams.start(now_s)
            self._heartbeat_due_s = now_s
        boot_s = self.flight.boot_s
        ticks = int((now_s - boot_s) / TICK_S + 1e-6)
        while self._ticks < ticks:
            self._ticks += 1
            self._tick(boot_s + self._ticks * TICK_S)

    def _tick(self, now_s: float) -> None:
        flight = self.flight
        slow = self._ticks % _SLOW_TICKS == 0
        if slow:
            self.vehicle.look_at_wind(now_s)
        flight.sense(now_s)
        if slow:
            self._slow(now_s)
        wanted_down_mps2 = flight.move()
        if wanted_down_mps2 is not None:
            self._contact(wanted_down_mps2)
            self._mission_told()
        flight.use_power()
        if not self.silent:
            if self._announcer.pending:
                self._announcer.flush()
            self._parameter_server.step()
            self.streams.send_due(now_s)
            if self.obstacle_report is not None:
                self.obstacle_report.step(now_s)

    def _contact(self, wanted_down_mps2: float) -> None:
        impact_mps = self.flight.take_impact_mps()
        if impact_mps is not None:
            self.personality.events.touched(impact_mps)
            if impact_mps > _CRASH_MPS:
                self.flight.crashed = True
                self.personality.events.crashed(impact_mps)
        if self.flight.settle(wanted_down_mps2):
            self.personality.events.landed()

    def _slow(self, now_s: float) -> None:
        if now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s += 1.0
            self._announcer.tell(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        self.flight.estimate_wind()
        self._missions.step(now_s)
        self.personality.events.slow_step(now_s)

    def _mission_told(self) -> None:
        progress = self.personality.progress
        for what, sequence in progress.take_told():
            if what is Told.REACHED:
                self._announcer.flush()
                self._announcer.broadcast(mavlink.MAVLink_mission_item_reached_message(sequence))
            if what is Told.COMPLETE:
                progress.complete = True
            self.personality.events.mission(what, sequence)

    # -- what goes wrong ------------------------------------------------------------------------------------

    def weaken_battery(self) -> None:
        """A cell fails: the charge is below the limit at which the stock battery failsafe acts."""
        self.vehicle.battery.drop_to(self._weak_battery_fraction)
