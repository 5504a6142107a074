"""From a number that an instrument sent to a sample, or to the reason why there is none."""

from __future__ import annotations

import math

from sensors.instruments.samples import InstrumentState, Quantity, Sample


def co2_sample(
    now_s: float,
    instrument: str,
    co2_ppm: float,
    *,
    range_ppm: float,
    status: str = "",
    pressure_pa: float | None = None,
    temperature_c: float | None = None,
) -> Sample:
    """A CO2 reading in ppm by volume, checked: negative and non-finite values and the end of the range are no
    values."""
    state, reason, at_least = InstrumentState.MEASURING, "", None
    if not math.isfinite(co2_ppm):
        state, reason = InstrumentState.ERROR, "the reading is not a number"
    elif co2_ppm < 0.0:
        state, reason = (
            InstrumentState.ERROR,
            f"negative reading {co2_ppm:g} ppm: the instrument needs a zero",
        )
    elif co2_ppm >= range_ppm:
        state, reason = InstrumentState.ERROR, f"saturated at the end of its range, {range_ppm:g} ppm"
        at_least = range_ppm
    measuring = state is InstrumentState.MEASURING
    return Sample(
        time_s=now_s,
        instrument=instrument,
        state=state,
        status=status,
        reason=reason,
        co2_ppm=co2_ppm if measuring else None,
        pressure_pa=pressure_pa if measuring else None,
        temperature_c=temperature_c if measuring else None,
        quantity=Quantity.CO2,
        co2_at_least_ppm=at_least,
    )
