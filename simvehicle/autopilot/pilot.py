"""The remote control that a ground station stands in for: RC_CHANNELS_OVERRIDE and MANUAL_CONTROL."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simvehicle.autopilot.channel import Channel, ChannelPeer, Handler
from simvehicle.autopilot.maneuvers import Sticks

RC_AT_REST_US = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)
"""The remote control as the recorded vehicle saw it; channel 5 is the mode switch."""


class RemoteControl:
    """The pulses of eight channels, microseconds."""

    def __init__(self) -> None:
        self.pulses_us = list(RC_AT_REST_US)

    def let_go(self) -> None:
        self.pulses_us = list(RC_AT_REST_US)

    def take(self, given_us: list[int]) -> None:
        """Channels as an override gives them (0 and 65535: not given)."""
        for index, pulse_us in enumerate(given_us):
            if is_given(pulse_us):
                self.pulses_us[index] = pulse_us

    def move(self, sticks: Sticks, up: float) -> None:
        right_us, back_us, _, clockwise_us, *_ = self.pulses_us
        sticks.right = (right_us - 1500) / 500
        sticks.forward = (1500 - back_us) / 500
        sticks.clockwise = (clockwise_us - 1500) / 500
        sticks.up = up

    @property
    def throttle(self) -> float:
        """-1 (down) to 1 (up)."""
        return (self.pulses_us[2] - 1500) / 500


def is_given(pulse_us: int) -> bool:
    return pulse_us not in (0, 65535)


class PilotInputs:
    """Takes the sticks from those who may move them."""

    def __init__(self, may_fly: Callable[[int], bool], moved: Callable[[list[int]], None]) -> None:
        """`may_fly`: by MAVLink system. `moved`: what the channels are now, as of an override."""
        self._may_fly = may_fly
        self._moved = moved

    def handlers(self) -> dict[str, Handler]:
        return {"RC_CHANNELS_OVERRIDE": self._override, "MANUAL_CONTROL": self._manual}

    def _override(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        if self._may_fly(peer.system):
            given = (m.chan1_raw, m.chan2_raw, m.chan3_raw, m.chan4_raw)
            more = (m.chan5_raw, m.chan6_raw, m.chan7_raw, m.chan8_raw)
            self._moved([*given, *more])

    def _manual(self, _channel: Channel, peer: ChannelPeer, m: Any) -> None:
        if not self._may_fly(peer.system):
            return
        # x forward, y right, r clockwise: -1000 to 1000; z up: 0 to 1000 with 500 as the middle
        sticks = [m.y, -m.x, (m.z - 500) * 2, m.r]
        self._moved([1500 + round(max(-1000, min(1000, stick)) / 2) for stick in sticks] + [0] * 4)
