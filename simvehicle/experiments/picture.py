"""One trial as a picture or a film: tracks over the plume, contact, failures, heals (the paper's figures 1 and 2)."""

from __future__ import annotations

import pathlib
import shutil
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from mission.geometry.formation import FloatArray
from simvehicle.compiled import compiled
from simvehicle.trials.cell import Cell
from simvehicle.trials.flight import ORIGIN_X, ORIGIN_Y, Scene, read_at
from simvehicle.trials.motion import ROW, TICKS_PER_S, X, Y
from simvehicle.trials.outcome import RecordedTrial
from simvehicle.trials.plume import SOURCE_X, SOURCE_Y
from simvehicle.trials.trace import Tracks
from simvehicle.trials.trials_error import TrialsError

_PIXELS = 400
_FRAMES = 160
_FRAMES_PER_S = 16


@compiled
def _plume_map(
    scene: Scene, norths_m: FloatArray, easts_m: FloatArray, tick: int, values: FloatArray
) -> None:
    row = np.zeros(ROW)
    for i in range(norths_m.shape[0]):
        for j in range(easts_m.shape[0]):
            row[X] = norths_m[i]
            row[Y] = easts_m[j]
            values[i, j] = read_at(scene, row, tick)


def _map(trial: RecordedTrial, axes: Axes, time_s: float) -> Any:
    """Draw the plume within the axes' limits, north up."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    norths, easts = np.linspace(south, north, _PIXELS), np.linspace(west, east, _PIXELS)
    values = np.zeros((_PIXELS, _PIXELS))
    _plume_map(trial.setup.scene, norths, easts, round(time_s * TICKS_PER_S), values)
    masked = np.ma.masked_less_equal(values, 0.0)
    return axes.imshow(
        masked,
        extent=(west, east, south, north),
        origin="lower",
        cmap="YlGn",
        norm=LogNorm(0.005, 1.0),
        interpolation="bilinear",
        aspect="equal",
        zorder=0,
    )


def _frame(trial: RecordedTrial, tracks: Tracks, cell: Cell) -> tuple[Figure, Axes, Any]:
    """Axes with the plume, the source and the launch point, wide enough for every track."""
    figure = Figure(figsize=(7.4, 6.6), layout="constrained")
    axes = figure.add_subplot()
    world, plume = trial.setup.scene.world, trial.setup.scene.plume
    source = (world[ORIGIN_X] + plume[SOURCE_X], world[ORIGIN_Y] + plume[SOURCE_Y])
    seen = tracks.place_m.reshape(-1, 2)
    seen = np.vstack([seen[np.isfinite(seen[:, 0])], source, (0.0, 0.0)])
    low, high = seen.min(axis=0) - 8.0, seen.max(axis=0) + 8.0
    half = 0.5 * max(high - low)
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[1] - half, middle[1] + half)
    axes.set_ylim(middle[0] - half, middle[0] + half)
    image = _map(trial, axes, float(tracks.time_s[-1]))
    figure.colorbar(image, ax=axes, shrink=0.8, format="%g", label="reading (share of the plume's maximum)")
    axes.plot(0.0, 0.0, "k+", markersize=10.0, label="launch")
    axes.plot(
        source[1], source[0], "*", color="gold", markeredgecolor="black", markersize=14.0, label="max flux"
    )
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.set_title(
        f"{cell.label()}, seed {trial.row['seed']}, trial {trial.row['trial']}\n{outcome_words(trial)}"
    )
    return figure, axes, image


def outcome_words(trial: RecordedTrial) -> str:
    """How the trial went, for people."""
    row: dict[str, Any] = trial.row
    words = [
        f"max flux after {row['source_s'] / 60:.1f} min" if row["success"] else f"no success ({row['ended']})"
    ]
    if np.isfinite(row["contact_s"]):
        words.append(f"contact {row['contact_s'] / 60:.1f} min")
    if row["survivors"] < row["drones"]:
        words.append(f"{row['survivors']} of {row['drones']} survive, {row['heals']} heals")
    return ", ".join(words)


def picture(trial: RecordedTrial, cell: Cell) -> Figure:
    """The whole trial in one figure."""
    with mpl.rc_context({"font.size": 9}):
        tracks = Tracks(trial, 0.5)
        figure, axes, _ = _frame(trial, tracks, cell)
        axes.plot(tracks.place_m[:, :, 1], tracks.place_m[:, :, 0], color="firebrick", lw=0.5, alpha=0.8)
        heirs = np.where(tracks.heir[:, :, None] > 0.0, tracks.place_m, np.nan)
        if np.isfinite(heirs).any():
            axes.plot(heirs[:, :, 1], heirs[:, :, 0], color="royalblue", lw=1.6)
            axes.plot([], [], color="royalblue", lw=1.6, label="heir on its way")
        failures = tracks.failures()
        if failures:
            axes.plot(
                [one[3] for one in failures],
                [one[2] for one in failures],
                "x",
                color="black",
                markersize=6.0,
                label="failed drone",
            )
        contact_s = float(str(trial.row["contact_s"]))
        if np.isfinite(contact_s):
            at = min(int(np.searchsorted(tracks.time_s, contact_s)), len(tracks.time_s) - 1)
            norths, easts = tracks.place_m[at, :, 0], tracks.place_m[at, :, 1]
            axes.plot(easts, norths, ".", color="darkorange", markersize=5.0, label="swarm at first contact")
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)
        return figure


def film(trial: RecordedTrial, cell: Cell, path: pathlib.Path) -> None:
    """Write the trial as a GIF or MP4, by the path's ending."""
    suffix = path.suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise TrialsError(f"{path}: a film ends in .gif or .mp4")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise TrialsError(f"{path}: MP4 needs the program ffmpeg; install it or choose a .gif")
    with mpl.rc_context({"font.size": 9}):
        end_s = float(str(trial.row["end_s"]))
        tracks = Tracks(trial, max(end_s / _FRAMES, 1.0 / TICKS_PER_S))
        figure, axes, image = _frame(trial, tracks, cell)
        lines = [
            axes.plot([], [], color="firebrick", lw=0.6, alpha=0.8)[0] for _ in range(trial.setup.drones)
        ]
        dots = axes.plot([], [], ".", color="black", markersize=5.0)[0]
        clock = axes.text(0.02, 0.97, "", transform=axes.transAxes, va="top", fontsize=10)
        moving = cell.plume == "gusty"

        def draw(frame: int) -> None:
            for drone, line in enumerate(lines):
                line.set_data(tracks.place_m[: frame + 1, drone, 1], tracks.place_m[: frame + 1, drone, 0])
            dots.set_data(tracks.place_m[frame, :, 1], tracks.place_m[frame, :, 0])
            clock.set_text(f"{tracks.time_s[frame] / 60.0:.1f} min")
            if moving:
                values = np.zeros((_PIXELS, _PIXELS))
                (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
                norths, easts = np.linspace(south, north, _PIXELS), np.linspace(west, east, _PIXELS)
                tick = round(float(tracks.time_s[frame]) * TICKS_PER_S)
                _plume_map(trial.setup.scene, norths, easts, tick, values)
                image.set_data(np.ma.masked_less_equal(values, 0.0))

        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, not in every frame
        writer: Any = PillowWriter(_FRAMES_PER_S) if suffix == ".gif" else FFMpegWriter(_FRAMES_PER_S)
        try:
            with writer.saving(figure, path, 80):
                for frame in range(len(tracks.time_s)):
                    draw(frame)
                    writer.grab_frame()
        except OSError as error:
            raise TrialsError(f"{path}: {error.strerror or error}") from error
