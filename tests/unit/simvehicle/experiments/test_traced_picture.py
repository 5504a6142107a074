"""Pictures and films of trials in traced worlds, of a small world that is made by hand."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest
from matplotlib.patches import Polygon
from matplotlib.quiver import Quiver
from PIL import Image

from simvehicle.experiments import traced_picture
from simvehicle.experiments.traced_picture import TracedTrial
from simvehicle.trials.tracing.flying import COUNTS, DISTANCES, NEVER
from simvehicle.trials.tracing.swarm_flight import TracedFlights, TracingVehicles, make_place
from simvehicle.trials.tracing.traced_world import TracedAir, TracedWorld
from simvehicle.world.obstacles import Obstacles
from simvehicle.world.recorded_air import RecordedAir
from simvehicle.world.world_config import RectangularObstacle

ROCK = RectangularObstacle(centre_north_m=6.0, centre_east_m=6.0, length_north_m=2.0, length_east_m=2.0)


def trial(arrival: int = NEVER, contact: int = 40) -> TracedTrial:
    rows = np.arange(11.0)
    gas = np.exp(-((rows[:, None] - 5.0) ** 2) - 0.1 * rows[None, :]).astype(np.float32)
    solid = (np.abs(rows[:, None] - 6.0) <= 1.0) & (np.abs(rows[None, :] - 6.0) <= 1.0)
    wind = np.zeros((3, 2, 11, 11), np.float32)
    wind[:, 1] = 0.5
    wind[2, 0] = 0.25
    air = RecordedAir(
        np.stack([gas, 0.5 * gas, gas]),
        wind,
        solid,
        np.zeros(2),
        1.0,
        np.zeros(2),
        1.0,
        60.0,
        np.full(2, 10.0),
    )
    standing = Obstacles((ROCK,))
    counts = np.full((1, COUNTS), NEVER)
    counts[0, traced_picture.ARRIVAL], counts[0, traced_picture.CONTACT] = arrival, contact
    tracks = np.linspace((1.0, 9.0), (5.0, 1.0), 20)[:, None, :] + np.array([[0.0, 0.0], [1.0, 0.0]])
    tracks[12:, 1] = np.nan  # the second robot is lost
    world = TracedWorld(number=0, vehicles=TracingVehicles(limit_steps=100))
    flown = TracedFlights(counts, np.zeros((1, DISTANCES)), tracks, np.zeros(0))
    place = make_place(air, np.array([[5.0, 0.5]]), standing)
    return TracedTrial(world, "fluxotaxis", 3, 1, TracedAir(place, standing, {}), flown, 5)


def test_a_picture_has_plume_wind_obstacles_tracks_and_source() -> None:
    figure = traced_picture.picture(trial(arrival=80))
    axes = figure.axes[0]
    (image,) = axes.images
    assert np.ma.getmaskarray(image.get_array())[5:8, 5:8].all(), "no gas in the rock"
    (arrows,) = [one for one in axes.collections if isinstance(one, Quiver)]
    assert np.allclose(arrows.U, 0.5)
    (rock,) = [patch for patch in axes.patches if isinstance(patch, Polygon)]
    assert rock.get_xy()[:4].mean(axis=0).tolist() == [6.0, 6.0]
    lines = {line.get_label(): line for line in axes.lines}
    assert lines["source"].get_xydata().tolist() == [[0.5, 5.0]]
    ends = lines["end"].get_xydata()
    assert ends[1].tolist() == pytest.approx(
        [trial().flown.tracks_m[11, 1, 1], trial().flown.tracks_m[11, 1, 0]]
    )
    assert "at the source in step 80, contact in step 40" in axes.get_title(loc="left")


def test_words_of_a_trial_that_did_not_arrive() -> None:
    assert traced_picture.words(trial()) == "no arrival, contact in step 40"
    assert traced_picture.words(trial(contact=NEVER)) == "no arrival"
    assert trial().steps == 100
    assert trial(arrival=50).steps == 65, "shown until a little after the arrival"


def test_a_film_moves(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "trial.gif"
    traced_picture.film(trial(arrival=20), path)
    with Image.open(path) as film:
        assert film.n_frames == len(trial(arrival=20).tracks_m)
