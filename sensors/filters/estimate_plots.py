"""Drawings of readings and estimates with their 95 % bands. They need matplotlib, which a drone does not
have."""

from __future__ import annotations

import importlib
import itertools
import math
import pathlib
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sensors.filters.co2_filter import Co2Filter, Co2FilterConfig
from sensors.instruments.samples import InstrumentState, Sample
from sensors.instruments.sensor_error import SensorError
from sensors.serial.captures import co2_series

_INK: Final = "#222222"
_RAW: Final = "#c0562b"
_ESTIMATE: Final = "#1f5fa8"
_SHADES: Final = {
    InstrumentState.WARMING: "#f2d7a0",
    InstrumentState.ZEROING: "#cfe3c0",
    InstrumentState.ERROR: "#f0b8b0",
    InstrumentState.SILENT: "#d8d8d8",
}

Numbers = Sequence[float] | npt.NDArray[np.float64]


def canvas(rows: int, height_in: float) -> tuple[Any, list[Any]]:
    """A figure without any window behind it, and its axes, one above the other with common time."""
    try:
        # Named by text: the packages that fly must not depend on it, and import checks follow imports.
        figures = importlib.import_module("matplotlib.figure")
    except ImportError as error:
        raise SensorError(
            "plots need matplotlib, which is not installed: pip install flightstack[sim]"
        ) from error
    figure = figures.Figure(figsize=(9.0, height_in), layout="constrained", facecolor="white")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0].tolist()
    for ax in axes:
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.margins(x=0.0)
    return figure, axes


def save(figure: Any, path: pathlib.Path) -> None:
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise SensorError(f"{path}: the plot cannot be written: {error}") from error


def band(ax: Any, time_s: Numbers, mean: Numbers, sd: Numbers, label: str) -> None:
    """An estimate as a line in the band that holds 95 % of an honest one's truth."""
    middle, half = np.asarray(mean), 1.96 * np.asarray(sd)
    ax.fill_between(
        time_s, middle - half, middle + half, color=_ESTIMATE, alpha=0.22, linewidth=0, label="95 % band"
    )
    ax.plot(time_s, middle, color=_ESTIMATE, linewidth=1.6, label=label)


def raw(ax: Any, time_s: Numbers, values: Numbers, label: str) -> None:
    ax.plot(time_s, values, color=_RAW, linewidth=0.0, marker=".", markersize=2.5, label=label)


def truth(ax: Any, time_s: Numbers, values: Numbers) -> None:
    ax.plot(time_s, values, color=_INK, linewidth=1.2, linestyle=(0, (4, 2)), label="truth")


def recording_figure(samples: Sequence[Sample], config: Co2FilterConfig | None, title: str) -> Any:
    """A recording: CO2 with the filter's estimate, wind by its components, and the states that gave no
    value."""
    has_co2 = any(s.co2_ppm is not None for s in samples)
    vectors = [
        (s.time_s, s.wind_body_mps or s.wind_ned_mps) for s in samples if s.wind_body_mps or s.wind_ned_mps
    ]
    if not has_co2 and not vectors:
        raise SensorError("the recording holds no valid reading: nothing to draw")
    rows = 2 if has_co2 else 1
    figure, axes = canvas(rows, 3.0 * rows + 0.6)
    for ax in axes:
        _shade_states(ax, samples)
    if has_co2:
        times, values = co2_series(samples)
        raw(axes[0], times, values, "reading")
        axes[0].set_ylabel("CO2, ppm")
        axes[0].legend(loc="upper right", frameon=False)
        _draw_estimate(axes[1], samples, config)
    else:
        body = any(s.wind_body_mps for s in samples)
        for axis, name in enumerate(("forward", "right", "down") if body else ("north", "east", "down")):
            axes[0].plot(
                [t for t, _ in vectors], [v[axis] for _, v in vectors if v], linewidth=1.0, label=name
            )
        axes[0].set_ylabel("where the air goes, m/s")
        axes[0].legend(loc="upper right", frameon=False)
    axes[0].set_title(title, loc="left")
    axes[-1].set_xlabel("time, s")
    return figure


def _draw_estimate(ax: Any, samples: Sequence[Sample], config: Co2FilterConfig | None) -> None:
    filter_ = Co2Filter(config)
    rows = []
    for sample in sorted(samples, key=lambda s: s.time_s):
        estimate = filter_.step(sample.time_s, (sample,))
        if estimate is not None and estimate.health != "bad":
            rows.append((sample.time_s, estimate.excess_co2_ppm, math.sqrt(estimate.variance_ppm2)))
    if rows:
        time_s, mean, sd = np.array(rows).T
        band(ax, time_s, mean, sd, "estimate")
        ax.legend(loc="upper right", frameon=False)
    ax.set_ylabel("excess CO2, ppm")


def _shade_states(ax: Any, samples: Sequence[Sample]) -> None:
    """Coloured ground, with a name in the legend, where the instrument gave no value."""
    named: set[InstrumentState] = set()
    ordered = sorted(samples, key=lambda s: s.time_s)
    for sample, after in itertools.pairwise(ordered):
        if sample.state in _SHADES:
            label = None if sample.state in named else sample.state.value
            named.add(sample.state)
            ax.axvspan(sample.time_s, after.time_s, color=_SHADES[sample.state], linewidth=0, label=label)
