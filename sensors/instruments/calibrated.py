"""An instrument whose readings are corrected by its calibration, as `sensors.calibration.side_by_side` finds it."""

from __future__ import annotations

import math

import msgspec

from sensors.instruments.samples import Instrument, InstrumentState, Sample


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """corrected = scale * reading + offset_ppm."""

    offset_ppm: float = 0.0
    scale: float = 1.0
    scatter_ppm: float = 0.0
    """Standard deviation of the corrected readings (means over a second) about the ensemble's median."""
    seconds: int = 0
    """How much common time it rests on."""
    made_at: str = ""
    """When, in ISO 8601 with its time zone, as the ground's clock said."""

    def __post_init__(self) -> None:
        if not (0.5 <= self.scale <= 2.0 and math.isfinite(self.offset_ppm)):
            raise ValueError(f"scale {self.scale} or offset {self.offset_ppm} ppm cannot be a calibration")

    def apply(self, sample: Sample) -> Sample:
        """The sample with its CO2 reading corrected; one without a reading is unchanged."""
        if sample.co2_ppm is None:
            return sample
        corrected_ppm = self.scale * sample.co2_ppm + self.offset_ppm
        if corrected_ppm < 0.0:
            reason = f"negative reading {corrected_ppm:g} ppm after calibration"
            return msgspec.structs.replace(sample, co2_ppm=None, state=InstrumentState.ERROR, reason=reason)
        return msgspec.structs.replace(sample, co2_ppm=corrected_ppm)


class CalibratedInstrument:
    """An instrument whose readings leave it corrected."""

    def __init__(self, instrument: Instrument, calibration: Calibration) -> None:
        self.name = instrument.name
        self.kind = instrument.kind
        self.calibration = calibration
        self._instrument = instrument

    def connected(self, now_s: float) -> bytes:
        return self._instrument.connected(now_s)

    def disconnected(self, now_s: float, reason: str) -> list[Sample]:
        return self._instrument.disconnected(now_s, reason)

    def receive(self, now_s: float, data: bytes) -> list[Sample]:
        return [self.calibration.apply(s) for s in self._instrument.receive(now_s, data)]

    def ended(self, now_s: float) -> list[Sample]:
        return [self.calibration.apply(s) for s in self._instrument.ended(now_s)]

    def poll(self, now_s: float) -> tuple[bytes, list[Sample]]:
        return self._instrument.poll(now_s)
