"""OBSTACLE_DISTANCE as a range finder sends it that is a component of its own on the vehicle's MAVLink."""

from __future__ import annotations

import math
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.mavlink.codec import MavlinkCodec
from simvehicle.autopilot.channel import Channel
from simvehicle.autopilot.flight import Flight
from simvehicle.vehicle.range_finder import RangeFinder

COMPONENT: Final = mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE
_ELEMENTS: Final = 72
_UNUSED: Final = 0xFFFF


class ObstacleReport:
    """Says on the companion's link what the range finder sees."""

    def __init__(self, finder: RangeFinder, flight: Flight, channel: Channel, system: int) -> None:
        self.finder = finder
        self._flight = flight
        self._channel = channel
        self._sender = MavlinkCodec(system, COMPONENT)
        self._due_s = -math.inf

    def step(self, now_s: float) -> None:
        if now_s < self._due_s or self.finder.silent:
            return
        self._due_s = max(self._due_s, now_s - 0.5) + 1.0 / self.finder.config.rate_hz
        body = self._flight.vehicle.body
        north, east, down = body.position
        ranges_m = self.finder.measure((north, east, down), body.yaw_rad)
        message = obstacle_distance(ranges_m, self.finder, int(self._flight.time_s * 1e6))
        self._channel.pass_on(self._sender.encode(message))


def obstacle_distance(ranges_m: list[float], finder: RangeFinder, time_us: int) -> Any:
    """The message for ranges clockwise from the nose."""
    config = finder.config
    max_cm = round(config.max_range_m * 100.0)
    distances = [
        max_cm + 1 if range_m == math.inf else min(round(range_m * 100.0), max_cm) for range_m in ranges_m
    ]
    width_deg = 360.0 / config.beams
    return mavlink.MAVLink_obstacle_distance_message(
        time_us,
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        distances + [_UNUSED] * (_ELEMENTS - len(distances)),
        min(round(width_deg), 255),
        round(config.min_range_m * 100.0),
        max_cm,
        width_deg,
        0.0,
        mavlink.MAV_FRAME_BODY_FRD,
    )
