"""Where everybody was, from the recorded legs of one trial."""

from __future__ import annotations

import numpy as np

from mission.geometry.formation import FloatArray
from simvehicle.compiled import compiled
from simvehicle.trials.flight import (
    LEG_DRONE,
    LEG_HEIR,
    LEG_ROW,
    LEG_START,
    LEG_TICKS,
    LEG_X,
    LEG_Y,
)
from simvehicle.trials.motion import ROW, TICKS_PER_S, X, Y, copy_row, fly
from simvehicle.trials.outcome import RecordedTrial


@compiled
def _trace(
    motion: FloatArray,
    powers: FloatArray,
    legs: FloatArray,
    every: int,
    places: FloatArray,
    heirs: FloatArray,
) -> None:
    row = np.zeros(ROW)
    for leg in range(legs.shape[0]):
        start = int(legs[leg, LEG_START])
        drone = int(legs[leg, LEG_DRONE])
        for sample in range((start + every - 1) // every, places.shape[0]):
            k = sample * every - start
            if k > legs[leg, LEG_TICKS]:
                break
            copy_row(legs[leg, LEG_ROW:], row)
            fly(motion, row, legs[leg, LEG_X], legs[leg, LEG_Y], k, powers)
            places[sample, drone, 0] = row[X]
            places[sample, drone, 1] = row[Y]
            heirs[sample, drone] = legs[leg, LEG_HEIR]


class Tracks:
    """Positions of all drones of a recorded trial, sampled evenly."""

    def __init__(self, trial: RecordedTrial, every_s: float) -> None:
        end_s = float(str(trial.row["end_s"]))
        every = max(1, round(every_s * TICKS_PER_S))
        samples = int(end_s * TICKS_PER_S) // every + 1
        drones = trial.setup.drones
        self.time_s: FloatArray = np.arange(samples) * every / TICKS_PER_S
        self.place_m: FloatArray = np.full((samples, drones, 2), np.nan)
        """(samples, drones, 2) north and east; NaN after a drone's failure."""
        self.heir: FloatArray = np.zeros((samples, drones))
        """1 where a drone was on its way to another's slot."""
        if trial.track is not None:
            self.place_m[:] = trial.track.places_m(np.arange(samples) * every)
            return
        _trace(trial.setup.scene.motion, trial.setup.scene.powers, trial.legs, every, self.place_m, self.heir)

    def failures(self) -> list[tuple[int, float, float, float]]:
        """(drone, time_s, north_m, east_m) of those that failed before the end."""
        found = []
        for drone in range(self.place_m.shape[1]):
            there = np.flatnonzero(np.isfinite(self.place_m[:, drone, 0]))
            if len(there) and there[-1] < len(self.time_s) - 1:
                last = there[-1]
                north_m, east_m = self.place_m[last, drone]
                found.append((drone, float(self.time_s[last]), float(north_m), float(east_m)))
        return found
