"""The standard atmosphere against its table, and the air that a world gives to instruments."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.geometry.frames import Geodetic, LocalFrame
from simvehicle.world.air import World
from simvehicle.world.atmosphere import air_density_kgpm3, air_pressure_pa, air_temperature_c
from simvehicle.world.gas import make_gas
from simvehicle.world.wind import GustyWind
from simvehicle.world.world_config import WindConfig


@pytest.mark.parametrize(
    ("amsl_m", "temperature_c", "pressure_pa", "density_kgpm3"),
    [(0.0, 15.0, 101_325.0, 1.225), (1000.0, 8.5, 89_876.0, 1.1117), (3000.0, -4.5, 70_121.0, 0.9093),
     (6000.0, -24.0, 47_218.0, 0.6601), (11_000.0, -56.5, 22_632.0, 0.3639)],
)  # fmt: skip
def test_the_table_of_iso_2533(
    amsl_m: float, temperature_c: float, pressure_pa: float, density_kgpm3: float
) -> None:
    assert air_temperature_c(amsl_m) == pytest.approx(temperature_c)
    assert air_pressure_pa(amsl_m) == pytest.approx(pressure_pa, rel=1e-3)
    assert air_density_kgpm3(amsl_m) == pytest.approx(density_kgpm3, rel=1e-3)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_altitude_has_air(amsl_m: float) -> None:
    assert 22_600.0 < air_pressure_pa(amsl_m) < 180_000.0
    assert 0.36 < air_density_kgpm3(amsl_m) < 2.0
    assert -57.0 < air_temperature_c(amsl_m) < 48.0


def test_instruments_get_the_air_of_their_altitude() -> None:
    """A vehicle 100 m above a home at 2400 m."""
    world = World(
        LocalFrame(Geodetic(14.38, -90.6, 2400.0)),
        GustyWind(WindConfig(), 1),
        make_gas(None, GustyWind(WindConfig(), 1), 2400.0),
        background_co2_ppm=415.0,
    )
    air = world.air_at((30.0, 40.0, -100.0), 12.0, (1.0, -2.0, 0.5))
    assert (air.co2_ppm, air.wind_body_mps) == (415.0, (1.0, -2.0, 0.5))
    assert air.temperature_c == pytest.approx(15.0 - 0.0065 * 2500.0)
    assert air.pressure_pa == pytest.approx(
        101_325.0 * math.pow(1.0 - 2.25577e-5 * 2500.0, 5.25588), rel=1e-6
    )
