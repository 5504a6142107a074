"""What faults do to an instrument's line: it goes on measuring old air, or measures what is not there."""

from __future__ import annotations

import re

import pytest

from simvehicle.drone.drone_spec import EmulatedInstrument
from simvehicle.drone.instrument_lines import InstrumentLines
from simvehicle.world.air import Air


class Measured:
    """A line with an SBA-5, which says a reading a second."""

    def __init__(self) -> None:
        self.lines = InstrumentLines([EmulatedInstrument(name="co2", type="sba5", port="")], drone=1, seed=1)
        self.now_s = 0.0

    def ppm(self, co2_ppm: float) -> float:
        """The last reading after half a minute in such air."""
        for _ in range(300):
            self.now_s += 0.1
            self.lines.step(self.now_s, Air(co2_ppm=co2_ppm))
        readings = re.findall(rb"M \d+ \d+ ([\d.]+) ", self.lines.drain()["co2"])
        return float(readings[-1])


def test_a_stuck_instrument_goes_on_with_the_air_of_that_moment() -> None:
    line = Measured()
    assert line.ppm(900.0) == pytest.approx(900.0, abs=15.0)
    line.lines.set_stuck("co2", True)
    line.ppm(900.0)
    line.lines.set_stuck("co2", True)  # again does no harm
    assert line.ppm(420.0) == pytest.approx(900.0, abs=15.0)
    line.lines.set_stuck("co2", False)
    assert line.ppm(420.0) == pytest.approx(420.0, abs=15.0)


def test_a_lying_instrument_is_off_by_what_it_is_told_but_never_below_nothing() -> None:
    line = Measured()
    line.lines.set_lying("co2", 300.0)
    assert line.ppm(420.0) == pytest.approx(720.0, abs=15.0)
    line.lines.set_lying("co2", -1000.0)
    assert line.ppm(420.0) == pytest.approx(0.0, abs=10.0)
    line.lines.set_lying("co2", 0.0)
    assert line.ppm(420.0) == pytest.approx(420.0, abs=15.0)
