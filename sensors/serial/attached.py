"""An instrument on its port: what an agent steps once a tick to get samples."""

from __future__ import annotations

from sensors.instruments.samples import Instrument, Sample
from sensors.serial.port import InstrumentPort


class AttachedInstrument:
    """Moves bytes between a port and an instrument's protocol, and tells the one of the other's comings and
    goings."""

    def __init__(self, instrument: Instrument, port: InstrumentPort) -> None:
        self.instrument = instrument
        self.port = port

    def step(self, now_s: float) -> list[Sample]:
        """Samples since the last call. Never waits; a lost port is a sample in state SILENT with its
        reason."""
        data = self.port.read()
        samples: list[Sample] = []
        for event in self.port.events():
            if event.connected:
                self.port.write(self.instrument.connected(now_s))
            else:
                samples += self.instrument.disconnected(now_s, event.reason)
        samples += self.instrument.receive(now_s, data)
        request, more = self.instrument.poll(now_s)
        self.port.write(request)
        return samples + more

    def close(self) -> None:
        self.port.close()
