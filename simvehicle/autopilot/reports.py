"""What telemetry asks of a flavour: three small views, as each autopilot sees itself."""

from __future__ import annotations

from typing import Protocol


class ModeReport(Protocol):
    @property
    def custom_mode(self) -> int: ...

    def base_mode(self) -> int: ...

    @property
    def is_idle(self) -> bool:
        """HEARTBEAT may say STANDBY while landed."""
        ...

    def landed_state(self) -> int:
        """MAV_LANDED_STATE"""
        ...

    def mission_idle_state(self) -> int:
        """MISSION_STATE of a mission that is there and is not flown."""
        ...


class EstimatorReport(Protocol):
    @property
    def ready(self) -> bool:
        """The estimate is good enough to fly with."""
        ...

    @property
    def lost(self) -> bool:
        """There is no horizontal position any more."""
        ...

    @property
    def gps_detected(self) -> bool: ...

    def flags(self) -> int:
        """EKF_STATUS_REPORT's and ESTIMATOR_STATUS's, which share their first bits."""
        ...


class HealthReport(Protocol):
    def health(self) -> tuple[int, int, int]:
        """SYS_STATUS sensors present, enabled, healthy."""
        ...
