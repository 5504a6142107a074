"""Where the two autopilots differ: what a flavour has to say and do. `core` does the rest."""

from __future__ import annotations

import abc
from typing import Any, ClassVar, Literal

from simvehicle.autopilot.channel import Channel, ChannelPeer
from simvehicle.autopilot.commands import ReceivedCommand
from simvehicle.autopilot.maneuvers import Return
from simvehicle.autopilot.mission_run import Told
from simvehicle.autopilot.missions import StoredItem
from simvehicle.vehicle.controller import Limits
from simvehicle.vehicle.dynamics import Battery


class Personality(abc.ABC):
    """Implemented by `ardupilot` and `px4` on top of `core.Autopilot`."""

    flavour: ClassVar[Literal["ardupilot", "px4"]]
    mav_autopilot: ClassVar[int]
    gps_fix_type: ClassVar[int]
    vtol_state: ClassVar[int]

    @property
    @abc.abstractmethod
    def system_parameter(self) -> str:
        """The parameter that holds the system id."""

    @property
    @abc.abstractmethod
    def custom_mode(self) -> int: ...

    @abc.abstractmethod
    def base_mode(self) -> int: ...

    @abc.abstractmethod
    def new_limits(self) -> Limits: ...

    @abc.abstractmethod
    def new_battery(self) -> Battery: ...

    @abc.abstractmethod
    def slow_step(self) -> None:
        """Boot, failsafes, arming and mode logic; ten times a second."""

    @abc.abstractmethod
    def on_landed(self) -> None: ...

    @abc.abstractmethod
    def on_told(self, told: Told, sequence: int) -> None:
        """The mission started, reached or finished an item."""

    @abc.abstractmethod
    def stored_item(self, kind: int, item: StoredItem) -> StoredItem: ...

    @abc.abstractmethod
    def read_item(self, kind: int, sequence: int, item: StoredItem) -> StoredItem: ...

    @abc.abstractmethod
    def on_list(self, kind: int, items: list[StoredItem]) -> None:
        """A list was replaced."""

    @abc.abstractmethod
    def on_list_progress(self, kind: int, count: int) -> None: ...

    @abc.abstractmethod
    def parameter_changed(self, name: str) -> None: ...

    @abc.abstractmethod
    def unknown_parameter(self, channel: Channel, peer: ChannelPeer, name: str) -> None: ...

    @abc.abstractmethod
    def setpoint(self, message: Any) -> None: ...

    @abc.abstractmethod
    def pilot(self, channels: list[int]) -> None:
        """RC channels in microseconds (0: not given), from an override."""

    @abc.abstractmethod
    def command(self, command: ReceivedCommand) -> int | None:
        """MAV_RESULT of a command that the flavours carry out differently; None for one that it does not know."""

    @abc.abstractmethod
    def back(self) -> Return:
        """A new return-to-launch."""

    @abc.abstractmethod
    def health(self) -> tuple[int, int, int]:
        """SYS_STATUS sensors present, enabled, healthy."""

    @abc.abstractmethod
    def estimator_flags(self) -> int:
        """EKF_STATUS_REPORT's and ESTIMATOR_STATUS's flags, which share their first bits."""

    @property
    @abc.abstractmethod
    def estimator_lost(self) -> bool:
        """There is no horizontal position any more."""

    @property
    @abc.abstractmethod
    def estimates_wind(self) -> bool: ...

    @property
    @abc.abstractmethod
    def gps_detected(self) -> bool: ...

    @property
    @abc.abstractmethod
    def idle_status(self) -> bool:
        """HEARTBEAT says STANDBY while landed."""

    @abc.abstractmethod
    def landed_state(self) -> int: ...

    @abc.abstractmethod
    def mission_idle_state(self) -> int: ...

    @abc.abstractmethod
    def version(self) -> Any: ...

    @abc.abstractmethod
    def fence_status(self) -> Any | None: ...

    @abc.abstractmethod
    def on_parameter_list(self) -> None:
        """Somebody asked for all parameters."""

    @abc.abstractmethod
    def takes_pilot(self, system: int) -> bool:
        """Whether this system may move the sticks."""

    @abc.abstractmethod
    def first_streams(self) -> dict[int, float]:
        """Message id -> interval (s) of what is sent without being asked for."""

    @property
    @abc.abstractmethod
    def ready(self) -> bool:
        """The estimate is good enough to fly with."""

    @abc.abstractmethod
    def on_touch(self, impact_mps: float) -> None:
        """The vehicle touched the ground at this speed."""

    @abc.abstractmethod
    def mission_rules(self) -> tuple[int, float]:
        """Sequence number of the first item to fly, and the radius (m) within which a waypoint is reached."""
