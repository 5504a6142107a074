"""What the autopilot says that an instrument could have said: its wind estimate, readings that it relays, motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

from flightstack.autopilot import VehicleReport
from flightstack.config import InstrumentConfig
from sensors.filters.wind_filter import VehicleMotion
from sensors.instruments.samples import InstrumentState, Sample


class AutopilotRelay:
    """The instruments whose port is "mavlink": each value's name, by its option `value`, stands for one of them."""

    def __init__(self, instruments: Sequence[InstrumentConfig]) -> None:
        self._relayed = {
            str(i.options.get("value", i.name)): i.name for i in instruments if i.port == "mavlink"
        }

    def samples(self, now_s: float, vehicle: VehicleReport) -> list[Sample]:
        """What is new in this tick."""
        samples = []
        if vehicle.wind_ned_mps is not None:
            samples.append(
                Sample(
                    now_s,
                    "autopilot wind",
                    InstrumentState.MEASURING,
                    wind_ned_mps=vehicle.wind_ned_mps,
                    wind_sd_mps=vehicle.wind_sd_mps,
                )
            )
        samples += [
            Sample(now_s, self._relayed[name], InstrumentState.MEASURING, co2_ppm=value)
            for name, value in vehicle.named_values
            if name in self._relayed and math.isfinite(value) and value >= 0.0
        ]
        return samples


def motion(vehicle: VehicleReport) -> VehicleMotion | None:
    """How the vehicle moves; None while that is not known."""
    if vehicle.attitude_rad is None or vehicle.velocity_ned_mps is None:
        return None
    return VehicleMotion(vehicle.attitude_rad, vehicle.velocity_ned_mps, airborne=vehicle.airborne)
