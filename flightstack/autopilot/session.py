"""The agent's conversation with its autopilot: bytes in, a report and requests, bytes out. It opens nothing.

Once a tick: `receive` what came (also nothing), read `report`, ask and set a target, `step` and send what it
returns. The same calls give the same bytes: time is an argument and there is no randomness.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.autopilot.arming import Arm
from flightstack.autopilot.own_fence import OwnFence, OwnFenceCheck
from flightstack.autopilot.precautions import Precautions
from flightstack.autopilot.report import VehicleReport
from flightstack.autopilot.requests import (
    Disarm,
    ModeRequest,
    Position,
    Prepare,
    Request,
    RequestKind,
    RequestOutcome,
    RequestResult,
    TakeControl,
    Target,
    VelocityRequest,
)
from flightstack.autopilot.setpoints import position_setpoint, velocity_setpoint
from flightstack.autopilot.takeoff import Takeoff
from flightstack.autopilot.telemetry import EVENTS, STATES, Telemetry
from flightstack.config import AutopilotConfig
from flightstack.mavlink.codec import MavlinkCodec, MavlinkMessage
from flightstack.mavlink.commands import heartbeat
from flightstack.mavlink.fields import layout
from flightstack.mavlink.message_rates import StreamRequests
from flightstack.mavlink.modes import Duty, Flavour
from mission.geometry.frames import LocalFrame, Vector3

COMPONENT = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
HEARTBEAT_S = 1.0
LAPSE_S = 2.0
"""Arming, taking off and taking control go on only while they are asked for: a caller that changed its mind, or is
gone, must not leave a request behind that starts motors later."""
AGAIN_S = 1.0
"""A request that has just failed is not begun anew before."""
PROBLEM_S = 2.0
"""How long `problem` tells of a failure."""
STOOD_STILL_S = 0.9
"""Without a setpoint for a second PX4 takes Offboard for lost (COM_OF_LOSS_T), ArduPilot stops (GUID_TIMEOUT)."""
RESULTS_KEPT = 32
_NEEDS_KEY = "autopilot signs what it says, and may obey nobody without its key: set autopilot.signing_key"

_NEEDED_HZ = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
}
RATES_HZ: dict[Flavour, dict[int, float]] = {
    Flavour.ARDUPILOT: {
        **_NEEDED_HZ,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
        mavlink.MAVLINK_MSG_ID_WIND: 1.0,
    },
    Flavour.PX4: {
        **_NEEDED_HZ,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 2.0,
        mavlink.MAVLINK_MSG_ID_WIND_COV: 1.0,
    },
}
"""What the agent needs of each autopilot, in the order in which it is asked for."""
_MISSION_PROTOCOL = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
        mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_ACK,
    )
)
_MAY_BE_ABSENT = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_WIND,
        mavlink.MAVLINK_MSG_ID_WIND_COV,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    )
)
"""Silence in these is no fault: not estimated, not known yet, or there is another way to tell."""


class AutopilotSession:
    """One vehicle. `system` is the drone's id and the MAVLink system id of its autopilot and of us."""

    def __init__(
        self,
        system: int,
        frame: LocalFrame,
        config: AutopilotConfig,
        fence_conflict: Callable[[OwnFence, Vector3], str] | None = None,
    ) -> None:
        """`fence_conflict` says what of an autopilot's own fence around its home (NED, m) stands against flying, ""
        if nothing does; without it that fence is not asked for."""
        self._fence_conflict = fence_conflict
        self._config = config
        self._frame = frame
        configured = Flavour.UNKNOWN if config.flavour == "auto" else Flavour(config.flavour)
        self._vehicle = Telemetry(system, frame, configured)
        self._streams = StreamRequests(RATES_HZ)
        self._codec = MavlinkCodec(system, COMPONENT, STATES, EVENTS, only_system=system)
        self._now_s = -math.inf
        self._next_heartbeat_s = -math.inf
        self._request: Request | None = None
        self._asked_s = -math.inf
        self._newest: tuple[Request, float] | None = None
        """The request that ended last, and when."""
        self._results: deque[RequestResult] = deque(maxlen=RESULTS_KEPT)
        self._prepared_boot: int | None = None
        self._target: Target | None = None
        self._withheld = ""
        self._warnings: tuple[str, ...] = ()
        """What the newest arming found in the autopilot's parameters."""
        self._fence_warning = ""
        self._stood_still_s = 0.0
        self._report: VehicleReport | None = None

    # -- what came ------------------------------------------------------------------------------------------

    def receive(self, now_s: float, data: bytes) -> None:
        """Bytes from the link, in any pieces. Call it every tick, also with none: ages are counted from `now_s`."""
        still_s = now_s - self._now_s
        self._now_s = max(self._now_s, now_s)
        self._report = None
        vehicle, told = self._vehicle, len(self._vehicle.new_texts)
        if STOOD_STILL_S < still_s < math.inf and vehicle.is_ours and vehicle.armed:
            self._stood_still_s = still_s
            vehicle.authority.stood_still(now_s, still_s)
        for message in self._codec.receive(now_s, data):
            if vehicle.hear(now_s, message):
                self._dispatch(now_s, message)
        vehicle.flush(now_s)
        if self._request is not None:
            for text in vehicle.new_texts[told:]:
                self._request.text(text.severity, text.text)

    def _dispatch(self, now_s: float, message: MavlinkMessage) -> None:
        kind, fields, request = message.kind, message.fields, self._request
        if kind == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            if self._codec.is_answer_to_us(message):
                self._streams.acknowledge(now_s, fields.command, fields.result)
                if request is not None:
                    request.acknowledge(now_s, fields.command, fields.result)
        elif request is None:
            return
        elif kind in _MISSION_PROTOCOL:
            if self._codec.is_answer_to_us(message):
                request.mission(kind, fields)
        elif kind == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
            request.parameter(self._vehicle, fields)
        elif kind == mavlink.MAVLINK_MSG_ID_PARAM_ERROR:
            request.parameter_error(fields)

    @property
    def report(self) -> VehicleReport:
        """The vehicle as known now; what is new in it is what came since the last `step`."""
        if self._report is None:
            refusal = self._request.complaint if self._request is not None else ""
            missing = sorted(self._streams.missing - _MAY_BE_ABSENT)
            notes = tuple(f"autopilot does not send {layout(kind).name}" for kind in missing)
            if self._vehicle.is_contested(self._now_s):
                notes = (*notes, "another autopilot speaks under our system id: every vehicle needs its own")
            ids = self._vehicle.system, self._vehicle.component
            if self._config.signing_key is None and ids in self._codec.signers:
                notes = (*notes, _NEEDS_KEY)
            notes += self._warnings
            notes += tuple(note for note in (self._fence_warning, self._withheld) if note)
            self._report = self._vehicle.report(self._now_s, refusal, notes, self._stood_still_s)
        return self._report

    # -- what is asked --------------------------------------------------------------------------------------

    @property
    def transaction(self) -> tuple[RequestKind, str] | None:
        """The request that is being carried out and its present step, None if there is none."""
        return None if self._request is None else (self._request.kind, self._request.step_name)

    def take_results(self) -> list[RequestResult]:
        """How the requests ended that ended since the last call, oldest first; only the newest few are kept."""
        results = list(self._results)
        self._results.clear()
        return results

    @property
    def prepared(self) -> bool:
        """The configured parameters are set and read back since the autopilot started, or there are none."""
        return not self._config.parameters or self._prepared_boot == self._vehicle.boots

    @property
    def problem(self) -> str:
        """Why the newest request has just failed for good, empty otherwise."""
        if self._request is not None or self._newest is None:
            return ""
        request, ended_s = self._newest
        result = request.result
        if result is None or self._now_s - ended_s > PROBLEM_S:
            return ""
        if result.outcome in (RequestOutcome.SUCCEEDED, RequestOutcome.SUPERSEDED, RequestOutcome.LAPSED):
            return ""
        return result.reason or result.outcome.value

    def prepare(self) -> None:
        """Set the configured parameters and read them back."""
        self._ask(self._new_prepare())

    def arm(self) -> None:
        """Prepare, wait until ready, take the mode, start the motors. Keep asking: it lapses after 2 s."""
        preparation = None if self.prepared else self._new_prepare()
        precautions = Precautions(self._config.parameters.keys())
        own_fence = None if self._fence_conflict is None else OwnFenceCheck(self._fence_conflict)
        timeout_s = self._config.ready_timeout_s
        self._ask(Arm(self._now_s, self._vehicle, preparation, precautions, own_fence, timeout_s))

    def takeoff(self, above_home_m: float) -> None:
        """Climb to this height over the origin of the swarm's frame. Keep asking: it lapses after 2 s."""
        self._ask(Takeoff(self._now_s, self._vehicle, self._frame, above_home_m))

    def take_control(self) -> None:
        """GUIDED or OFFBOARD: the vehicle follows our targets afterwards. Keep asking: it lapses after 2 s."""
        self._ask(TakeControl(self._now_s, self._vehicle))

    def land(self) -> None:
        """The autopilot lands where it is. Succeeds when it is in that mode."""
        self._ask(ModeRequest(self._now_s, self._vehicle, RequestKind.LAND, Duty.LAND))

    def rtl(self) -> None:
        """The autopilot returns to its home and lands. Succeeds when it is in that mode."""
        self._ask(ModeRequest(self._now_s, self._vehicle, RequestKind.RETURN, Duty.RETURN))

    def hold(self) -> None:
        """The autopilot itself holds its position (BRAKE, HOLD): our authority ends."""
        self._ask(ModeRequest(self._now_s, self._vehicle, RequestKind.HOLD, Duty.HOLD))

    def disarm(self) -> None:
        """Stop the motors of a vehicle on the ground."""
        self._ask(Disarm(self._now_s, self._vehicle))

    def target_position(self, position_ned_m: Vector3, yaw_rad: float | None = None) -> None:
        """In this tick, fly to a point of the swarm's frame. Raises ValueError if a number is not finite."""
        _check_finite("position", position_ned_m, yaw_rad)
        self._target = Position(position_ned_m, yaw_rad)

    def target_velocity(self, velocity_ned_mps: Vector3, yaw_rad: float | None = None) -> None:
        """In this tick, fly with this velocity. Raises ValueError if a number is not finite."""
        _check_finite("velocity", velocity_ned_mps, yaw_rad)
        self._target = VelocityRequest(velocity_ned_mps, yaw_rad)

    def believe_crashed(self, how: str) -> None:
        """The agent found out what the vehicle's own messages do not tell; it stands until the next arming."""
        self._vehicle.believe_crashed(how)
        self._report = None

    def _new_prepare(self) -> Prepare:
        return Prepare(self._now_s, self._vehicle, self._config.parameters, self._config.ready_timeout_s)

    def _ask(self, request: Request) -> None:
        """Begin a request, unless it is running already or has failed a moment ago."""
        now_s = self._now_s
        if self._request is not None:
            if self._request.same_as(request):
                self._asked_s = now_s
                return
            if self._request.is_reached(self._vehicle):
                self._request.end(now_s, RequestOutcome.SUCCEEDED)
            self._request.end(now_s, RequestOutcome.SUPERSEDED, f"superseded by {request.kind}")
            self._finish(now_s)
        if self._newest is not None:
            before, ended_s = self._newest
            failed = before.result is not None and before.result.outcome is not RequestOutcome.SUCCEEDED
            if failed and before.same_as(request) and now_s - ended_s < AGAIN_S:
                return
        self._asked_s = now_s
        self._request = request

    # -- what is sent ---------------------------------------------------------------------------------------

    def step(self, now_s: float) -> bytes:
        """End the tick: everything that is to be sent now."""
        self._now_s = max(self._now_s, now_s)
        messages: list[Any] = []
        if now_s >= self._next_heartbeat_s:
            overdue = now_s - self._next_heartbeat_s > HEARTBEAT_S
            self._next_heartbeat_s = (now_s if overdue else self._next_heartbeat_s) + HEARTBEAT_S
            messages.append(heartbeat(mavlink.MAV_TYPE_ONBOARD_CONTROLLER))
        messages += self._streams.step(now_s, self._vehicle)
        messages += self._vehicle.events.sequence.requests(
            now_s, self._vehicle.system, self._vehicle.component
        )
        fallback = None
        request = self._request
        if request is not None:
            if request.needs_vehicle and now_s - self._asked_s > LAPSE_S:
                request.end(now_s, RequestOutcome.LAPSED, "not asked for any more")
            messages += request.step(now_s, self._vehicle)
            fallback = request.target if self._vehicle.flavour is Flavour.PX4 else None
            if request.result is not None:
                self._finish(now_s)
        setpoint = self._setpoint(now_s, fallback)
        if setpoint is not None:
            messages.append(setpoint)
        self._target = None
        self._stood_still_s = 0.0
        self._vehicle.clear_news()
        self._report = None
        return b"".join(map(self._codec.encode, messages))

    def _finish(self, now_s: float) -> None:
        request, self._request = self._request, None
        if request is None or request.result is None:
            return
        self._newest = (request, now_s)
        self._results.append(request.result)
        if isinstance(request, Arm):
            self._warnings = tuple(request.precautions.warnings)
            self._fence_warning = request.fence_warning
        preparation = request.prepare if isinstance(request, Arm) else request
        if isinstance(preparation, Prepare) and preparation.result is not None:
            done = preparation.result.outcome is RequestOutcome.SUCCEEDED
            self._prepared_boot = self._vehicle.boots if done else None

    def _setpoint(self, now_s: float, fallback: Target | None) -> Any | None:
        """This tick's setpoint: the agent's if it may steer, else what a running request needs to be streamed."""
        target = self._target
        self._withheld = ""
        if target is not None:
            self._withheld = self._why_not_steer(now_s)
            if self._withheld:
                target = None
        target = target or fallback
        if target is None:
            return None
        if isinstance(target, Position):
            return position_setpoint(now_s, self._vehicle, self._frame, target.position_ned_m, target.yaw_rad)
        return velocity_setpoint(now_s, self._vehicle, target.velocity_ned_mps, target.yaw_rad)

    def _why_not_steer(self, now_s: float) -> str:
        vehicle = self._vehicle
        if not vehicle.is_connected(now_s):
            return "setpoint withheld: the autopilot is silent"
        if not vehicle.armed:
            return "setpoint withheld: not armed"
        if not vehicle.is_ours:
            return "setpoint withheld: the vehicle is not in our mode"
        if vehicle.flavour is Flavour.ARDUPILOT and not vehicle.has_flown:
            return "setpoint withheld: take-off first"
        if isinstance(self._request, Takeoff):
            return "setpoint withheld: taking off"
        return ""


def _check_finite(what: str, vector: Vector3, yaw_rad: float | None) -> None:
    if not all(map(math.isfinite, vector)) or (yaw_rad is not None and not math.isfinite(yaw_rad)):
        raise ValueError(f"{what} target {vector} with yaw {yaw_rad} is not finite")
