"""PX4's estimator: when it is ready, and whether there is a position."""

from __future__ import annotations

from simvehicle.autopilot.flight import Flight


class Px4Estimate:
    """An `EstimatorReport`."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self.lost = False
        """The position failsafe says so."""

    @property
    def ready(self) -> bool:
        return self._flight.time_s >= self._flight.ready_after_s

    @property
    def gps_detected(self) -> bool:
        return self._flight.time_s >= 0.25 * self._flight.ready_after_s

    @property
    def position_ok(self) -> bool:
        return self.ready and not self.lost

    def flags(self) -> int:
        """As recorded of PX4 1.16: the constant-position bit (128) is set at rest, and says nothing else."""
        at_rest = 128 if self._flight.landed else 0
        return 895 | at_rest if self.ready and not self.lost else 1 | 4 | 32 | at_rest

    def step(self) -> None:
        """The first fix; until it is armed home is where it stands."""
        flight = self._flight
        if not flight.origin_is_set and self.gps_detected and flight.time_s >= 0.5 * flight.ready_after_s:
            flight.set_origin()
        elif flight.origin_is_set and not flight.armed:
            flight.set_home(flight.nav.position_m)
