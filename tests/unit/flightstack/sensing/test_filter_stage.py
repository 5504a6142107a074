"""The filters take what the drone's file knows of its own instruments."""

from __future__ import annotations

import pytest

from flightstack.config import FiltersConfig, InstrumentConfig
from flightstack.sensing.filter_stage import Sensing, co2_settings, wind_settings
from sensors.filters.filter_settings import co2_filter_config
from sensors.filters.wind_config import UNCALIBRATED_DRAG_SCALE_SD
from sensors.instruments.sensor_error import SensorError

CO2 = InstrumentConfig(name="co2", type="k30", port="/dev/ttyk30")


def test_the_data_sheet_of_the_instrument_that_is_carried() -> None:
    assert co2_settings((CO2,), FiltersConfig()) == co2_filter_config("k30", "co2")


def test_tuned_values_stand_over_the_data_sheet() -> None:
    tuned = co2_settings((CO2,), FiltersConfig(co2={"lag_s": 7.5}))
    assert tuned.lag_s == 7.5
    assert tuned.noise_ppm == co2_filter_config("k30").noise_ppm
    wind = wind_settings(FiltersConfig(wind={"drag": {"linear_per_s": 0.3}}))
    assert wind.drag is not None
    assert wind.drag.linear_per_s == 0.3


def test_an_airframe_that_nobody_calibrated_tells_little_of_the_winds_strength() -> None:
    assert wind_settings(FiltersConfig()).drag_scale_sd == UNCALIBRATED_DRAG_SCALE_SD
    assert wind_settings(FiltersConfig(wind={"drag": {"linear_per_s": 0.3}})).drag_scale_sd < 0.1
    assert wind_settings(FiltersConfig(wind={"drag_scale_sd": 0.2})).drag_scale_sd == 0.2


@pytest.mark.parametrize(
    ("filters", "field"),
    [
        (FiltersConfig(co2={"lagg_s": 1.0}), "filters.co2"),
        (FiltersConfig(co2={"lag_s": "slow"}), "filters.co2"),
        (FiltersConfig(wind={"gusts": 1.0}), "filters.wind"),
    ],
)
def test_a_setting_that_no_filter_has_is_refused(filters: FiltersConfig, field: str) -> None:
    with pytest.raises(SensorError, match=field):
        Sensing((CO2,), filters)
