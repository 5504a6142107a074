"""Gas and wind of one seed, recorded once for all the trials that are flown in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission.geometry.formation import FloatArray


class RecordedAir(NamedTuple):
    """Frames of gas and wind over a level area that begins at (0, 0); rows go north, columns east."""

    gas: NDArray[np.float32]
    """(frames, rows, columns) at the nodes, in the plume's unit; 0 inside obstacles."""
    wind_mps: NDArray[np.float32]
    """(frames, 2, rows, columns) of the wind's own nodes: to the north, to the east."""
    solid: NDArray[np.bool_]
    """(rows, columns) of the gas' nodes that are inside an obstacle."""
    gas_origin_m: FloatArray
    """(2,) north and east of the first node."""
    gas_spacing_m: float
    wind_origin_m: FloatArray
    """(2,)"""
    wind_spacing_m: float
    frame_s: float
    """Time between frames; the first is at 0 s."""
    length_m: FloatArray
    """(2,) of the area, to the north and to the east."""
