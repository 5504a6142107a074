"""A trial in a traced world as a picture or a film: plume, wind, obstacles and tracks."""

from __future__ import annotations

import pathlib
import shutil
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from mission.geometry.formation import FloatArray
from simvehicle.trials.tracing.flying import ARRIVAL, CONTACT, NEVER
from simvehicle.trials.tracing.swarm_flight import TracedFlights, fly_trials
from simvehicle.trials.tracing.traced_world import TracedAir, TracedWorld, make_air, start_places
from simvehicle.trials.trials_error import TrialsError
from simvehicle.world.recorded_air import AirRecordingError

_ARROWS: Final = 19
"""Along a side."""
_FRAMES: Final = 160
_FRAMES_PER_S: Final = 16
_SAMPLES: Final = 700
"""Of a track at most."""
_DECADES: Final = 4.0
"""Below the largest density of the plume that are shown."""


class TracedTrial(NamedTuple):
    """One trial of one strategy, with the air that it was flown in."""

    world: TracedWorld
    strategy: str
    seed: int
    trial: int
    air: TracedAir
    flown: TracedFlights
    every: int
    """Steps between two places of a track."""

    @property
    def arrival_step(self) -> int | None:
        step = int(self.flown.counts[0, ARRIVAL])
        return step if step < NEVER else None

    @property
    def contact_step(self) -> int | None:
        step = int(self.flown.counts[0, CONTACT])
        return step if step < NEVER else None

    @property
    def steps(self) -> int:
        """Until a little after the arrival, or all of them."""
        arrival, limit = self.arrival_step, self.world.vehicles.limit_steps
        return limit if arrival is None else min(limit, round(1.1 * arrival) + 2 * self.every)

    @property
    def tracks_m(self) -> FloatArray:
        """(samples, robots, 2) of the steps that are shown."""
        return self.flown.tracks_m[: self.steps // self.every + 1]


def record(world: TracedWorld, strategy: str, robots: int, seed: int, trial: int) -> TracedTrial:
    """Fly one trial and keep its tracks. `TrialsError` names what cannot be flown."""
    for problem in world.problems():
        raise TrialsError(problem)
    try:
        air = make_air(world, seed)
    except AirRecordingError as error:
        raise TrialsError(str(error)) from error
    starts_m = start_places(world, air.place, seed, trial, robots)[None]
    every = max(1, world.vehicles.limit_steps // _SAMPLES)
    flown = fly_trials(
        air.place, world.vehicles, strategy, starts_m, seed=seed, first=trial, every=every,
        parameters=world.parameters_of(strategy),
    )  # fmt: skip
    return TracedTrial(world, strategy, seed, trial, air, flown, every)


def words(trial: TracedTrial) -> str:
    """How the trial went, for people."""
    arrival, contact = trial.arrival_step, trial.contact_step
    told = "no arrival" if arrival is None else f"at the source in step {arrival}"
    return told if contact is None else f"{told}, contact in step {contact}"


def _frame_at(trial: TracedTrial, step: int) -> int:
    recorded = trial.air.place.air
    return min(int(step * trial.world.vehicles.step_s / recorded.frame_s), len(recorded.gas) - 1)


def _densities(trial: TracedTrial, step: int) -> Any:
    recorded = trial.air.place.air
    frame = _frame_at(trial, step)
    # What is inside an obstacle has no gas.
    return np.ma.masked_where(recorded.solid | (recorded.gas[frame] <= 0.0), recorded.gas[frame])


def _winds(trial: TracedTrial, step: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(east_m, north_m, east_mps, north_mps) of the arrows."""
    recorded = trial.air.place.air
    frame = min(_frame_at(trial, step), len(recorded.wind_mps) - 1)
    every = max(1, recorded.wind_mps.shape[2] // _ARROWS)
    north_mps, east_mps = recorded.wind_mps[frame][:, ::every, ::every].astype(np.float64)
    rows, columns = (
        np.arange(recorded.wind_mps.shape[2])[::every],
        np.arange(recorded.wind_mps.shape[3])[::every],
    )
    north_m = recorded.wind_origin_m[0] + rows * recorded.wind_spacing_m
    east_m = recorded.wind_origin_m[1] + columns * recorded.wind_spacing_m
    east, north = np.meshgrid(east_m, north_m)
    return east, north, east_mps, north_mps


def _scene(trial: TracedTrial, step: int) -> tuple[Figure, Axes, Any, Any]:
    """Axes with the world as it is in one step: figure, axes, the plume's image, the wind's arrows."""
    recorded, place = trial.air.place.air, trial.air.place
    figure = Figure(figsize=(7.4, 6.8), layout="constrained")
    axes = figure.add_subplot()
    north_m, east_m = recorded.length_m.tolist()
    axes.set_xlim(0.0, east_m)
    axes.set_ylim(0.0, north_m)
    axes.set_aspect("equal")
    half_m = 0.5 * recorded.gas_spacing_m
    first_n, first_e = recorded.gas_origin_m.tolist()
    rows, columns = recorded.gas.shape[1:]
    most = float(max(recorded.gas[_frame_at(trial, step)].max(), 1e-30))
    image = axes.imshow(
        _densities(trial, step), origin="lower", cmap="YlOrBr", norm=LogNorm(most / 10.0**_DECADES, most), zorder=0,
        extent=(
            first_e - half_m, first_e + (columns - 1) * recorded.gas_spacing_m + half_m,
            first_n - half_m, first_n + (rows - 1) * recorded.gas_spacing_m + half_m,
        ),
    )  # fmt: skip
    figure.colorbar(image, ax=axes, shrink=0.8, label="density of the gas, the plume's unit")
    east, north, east_mps, north_mps = _winds(trial, step)
    fastest = float(np.hypot(east_mps, north_mps).max()) or 1.0
    arrows = axes.quiver(
        east, north, east_mps, north_mps, color="#3a6ea5", alpha=0.6, width=0.0022, zorder=1, angles="xy",
        scale=fastest * _ARROWS * 1.1,
    )  # fmt: skip
    axes.quiverkey(arrows, 0.9, 1.03, fastest, f"wind {fastest:.2f} m/s", labelpos="W", coordinates="axes")
    terrain = place.terrain
    for begin, end in zip(terrain.first[:-1].tolist(), terrain.first[1:].tolist(), strict=True):
        corners = terrain.corners_m[begin:end, ::-1]
        axes.add_patch(
            Polygon(corners, facecolor="#bdbdbd", edgecolor="#333333", hatch="////", linewidth=0.7, zorder=2)
        )
    sources = place.sources.places_m
    moment = min(int(step * trial.world.vehicles.step_s / place.sources.every_s), len(sources) - 1)
    axes.plot(
        sources[moment, :, 1], sources[moment, :, 0], "*", color="gold", markeredgecolor="black", markersize=14.0,
        zorder=5, linestyle="none", label="source",
    )  # fmt: skip
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    robots = trial.flown.tracks_m.shape[1]
    what = f"{trial.strategy}, {robots} robots, {trial.world.regime}, seed {trial.seed}, trial {trial.trial}"
    axes.set_title(f"{what}\n{words(trial)}", loc="left", fontsize=9)
    return figure, axes, image, arrows


def picture(trial: TracedTrial) -> Figure:
    """The whole trial over the plume and the wind of its end."""
    with mpl.rc_context({"font.size": 9}):
        figure, axes, _, _ = _scene(trial, trial.steps - 1)
        tracks_m = trial.tracks_m
        axes.plot(tracks_m[:, :, 1], tracks_m[:, :, 0], color="firebrick", linewidth=0.5, alpha=0.8, zorder=3)
        axes.plot(tracks_m[0, :, 1], tracks_m[0, :, 0], "k+", markersize=6.0, zorder=4, label="start")
        axes.plot(_last(tracks_m)[:, 1], _last(tracks_m)[:, 0], "k.", markersize=4.0, zorder=4, label="end")
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)
        return figure


def _last(tracks_m: FloatArray) -> FloatArray:
    """(robots, 2) where each is known last."""
    known = np.isfinite(tracks_m[:, :, 0])
    last = len(tracks_m) - 1 - np.argmax(known[::-1], axis=0)
    return np.asarray(tracks_m[last, np.arange(tracks_m.shape[1])])


def film(trial: TracedTrial, path: pathlib.Path) -> None:
    """Write the trial as a GIF or MP4, by the path's ending."""
    suffix = path.suffix.lower()
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise TrialsError(f"{path}: MP4 needs the program ffmpeg; install it or choose a .gif")
    with mpl.rc_context({"font.size": 9}):
        tracks_m = trial.tracks_m
        figure, axes, image, arrows = _scene(trial, trial.steps - 1)
        lines = [
            axes.plot([], [], color="firebrick", linewidth=0.6, alpha=0.8, zorder=3)[0]
            for _ in range(tracks_m.shape[1])
        ]
        dots = axes.plot([], [], ".", color="black", markersize=5.0, zorder=4)[0]
        clock = axes.text(0.02, 0.97, "", transform=axes.transAxes, va="top", fontsize=10, zorder=6)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, not in every frame
        writer: Any = PillowWriter(_FRAMES_PER_S) if suffix == ".gif" else FFMpegWriter(_FRAMES_PER_S)
        try:
            with writer.saving(figure, path, 80):
                for sample in np.unique(np.linspace(0, len(tracks_m) - 1, _FRAMES).astype(int)).tolist():
                    step = sample * trial.every
                    image.set_data(_densities(trial, step))
                    _, _, east_mps, north_mps = _winds(trial, step)
                    arrows.set_UVC(east_mps, north_mps)
                    for robot, line in enumerate(lines):
                        line.set_data(tracks_m[: sample + 1, robot, 1], tracks_m[: sample + 1, robot, 0])
                    dots.set_data(tracks_m[sample, :, 1], tracks_m[sample, :, 0])
                    clock.set_text(f"step {step}")
                    writer.grab_frame()
        except OSError as error:
            raise TrialsError(f"{path}: {error.strerror or error}") from error
