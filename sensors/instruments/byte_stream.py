"""What every instrument on a byte stream has in common: framing, polling, silence and noise on the line."""

from __future__ import annotations

import abc

from sensors.instruments.framing import Framer, legible, printable
from sensors.instruments.samples import InstrumentState, Quantity, Sample


class StreamInstrument(abc.ABC):
    """An instrument's protocol (see `sensors.instruments.samples.Instrument`), less what its make alone knows.

    A make says how its stream is framed, what one message means, what to send on connection and when to ask
    for a reading. Here are the rest of the rules: a message that cannot be understood is a sample in state
    ERROR that quotes it, a line that stays quiet for `silence_s` is a sample in state SILENT, once a period,
    and one on which messages come, but for three periods none that says anything of the air, is in state ERROR.
    """

    def __init__(self, kind: str, name: str, quantity: Quantity, framer: Framer, silence_s: float) -> None:
        self.kind = kind
        self.name = name
        self.quantity = quantity
        self._framer = framer
        self._silence_s = silence_s
        self._heard_s: float | None = None
        self._told_silent_s: float | None = None
        self._spoke_s = 0.0
        self._beside = b""
        self._open = False

    def connected(self, now_s: float) -> bytes:
        self._framer.clear()
        self._open = True
        self._heard_s = self._spoke_s = now_s
        self._told_silent_s = None
        return self._greeting(now_s)

    def disconnected(self, now_s: float, reason: str) -> list[Sample]:
        self._framer.clear()
        self._open = False
        return [self._sample(now_s, InstrumentState.SILENT, reason=reason)]

    def receive(self, now_s: float, data: bytes) -> list[Sample]:
        if data:
            self._heard_s = now_s
            self._told_silent_s = None
        return self._meanings(now_s, self._framer.feed(data))

    def ended(self, now_s: float) -> list[Sample]:
        return self._meanings(now_s, self._framer.end())

    def _meanings(self, now_s: float, frames: list[bytes | None]) -> list[Sample]:
        samples: list[Sample] = []
        for frame in frames:
            sample = self._noise(now_s) if frame is None else self._read(now_s, frame)
            if sample is not None:
                self._spoke_s = now_s
                samples.append(sample)
            elif frame is not None:
                self._beside = frame
        return samples

    def poll(self, now_s: float) -> tuple[bytes, list[Sample]]:
        if not self._open:
            return b"", []
        return self._request(now_s), self._silence(now_s)

    def _silence(self, now_s: float) -> list[Sample]:
        if self._heard_s is None or now_s < self._heard_s:
            self._heard_s = now_s  # the clock was set back: silence is counted from here
        quiet_s = now_s - self._heard_s
        told_s = self._told_silent_s
        if told_s is not None and 0.0 <= now_s - told_s < self._silence_s:
            return []
        if quiet_s < self._silence_s:
            return self._nothing_said(now_s)
        self._told_silent_s = now_s
        return [self._sample(now_s, InstrumentState.SILENT, reason=f"no answer for {quiet_s:.1f} s")]

    def _nothing_said(self, now_s: float) -> list[Sample]:
        """It sends, but acknowledgements, settings or other devices' messages only."""
        if now_s < self._spoke_s:
            self._spoke_s = now_s
        if now_s - self._spoke_s < 3.0 * self._silence_s:
            return []
        self._spoke_s = now_s
        return [self._unknown(now_s, self._beside, "it sends, but no reading; the last is")]

    @abc.abstractmethod
    def _read(self, now_s: float, frame: bytes) -> Sample | None:
        """The meaning of one framed message; None for acknowledgements and echoes."""

    def _greeting(self, now_s: float) -> bytes:  # noqa: ARG002
        """What to send when the port has opened."""
        return b""

    def _request(self, now_s: float) -> bytes:  # noqa: ARG002
        """What to send now, called every tick; empty for an instrument that talks by itself."""
        return b""

    def _sample(
        self,
        now_s: float,
        state: InstrumentState,
        *,
        status: str = "",
        reason: str = "",
        co2_at_least_ppm: float | None = None,
    ) -> Sample:
        return Sample(
            time_s=now_s,
            instrument=self.name,
            state=state,
            status=legible(status),
            reason=legible(reason),
            quantity=self.quantity,
            co2_at_least_ppm=co2_at_least_ppm,
        )

    def _noise(self, now_s: float) -> Sample:
        return self._sample(
            now_s, InstrumentState.ERROR, reason="no message in what it sends: wrong baud rate?"
        )

    def _unknown(self, now_s: float, frame: bytes, what: str = "not understood") -> Sample:
        return self._sample(now_s, InstrumentState.ERROR, reason=f"{what}: {printable(frame)}")


class Pacer:
    """Says when the next request is due, for instruments that answer only when asked."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self._last_s: float | None = None

    def due(self, now_s: float, period_s: float | None = None) -> bool:
        """True once a period (`period_s`, or the usual one); also after the clock was set back."""
        period = self.period_s if period_s is None else period_s
        # Ticks are not exact: waiting for the last hundredths of a period would halve the rate at 10 Hz.
        if self._last_s is not None and 0.0 <= now_s - self._last_s < period - min(0.1 * period, 0.05):
            return False
        self._last_s = now_s
        return True
