"""The standard atmosphere (ISO 2533): temperature, pressure and density of the air by altitude.

The formulas are those of the troposphere; above and below it the air is that of its nearer edge.
"""

from __future__ import annotations

import math

_SEA_LEVEL_K = 288.15
_SEA_LEVEL_PA = 101_325.0
_SEA_LEVEL_KGPM3 = 1.225
_LAPSE_KPM = 0.0065
_CO2_TO_AIR_MASS = 44.0095 / 28.9647
"""Molar masses of CO2 and dry air: their ratio is that of the gases' densities at one temperature and
pressure."""
_LOWEST_M, _HIGHEST_M = -5000.0, 11_000.0


def _relative_temperature(amsl_m: float) -> float:
    """Absolute temperature over that at sea level."""
    return 1.0 - _LAPSE_KPM * min(max(amsl_m, _LOWEST_M), _HIGHEST_M) / _SEA_LEVEL_K


def air_temperature_c(amsl_m: float) -> float:
    return _SEA_LEVEL_K * _relative_temperature(amsl_m) - 273.15


def air_pressure_pa(amsl_m: float) -> float:
    return _SEA_LEVEL_PA * math.pow(_relative_temperature(amsl_m), 5.25588)


def air_density_kgpm3(amsl_m: float) -> float:
    return _SEA_LEVEL_KGPM3 * math.pow(_relative_temperature(amsl_m), 4.2559)


def co2_density_kgpm3(amsl_m: float) -> float:
    """Of pure CO2 at the air's temperature and pressure: kg/m^3 over this are the share of CO2 by volume."""
    return _CO2_TO_AIR_MASS * air_density_kgpm3(amsl_m)
