"""Reading a drone's file, and what cannot be flown although every value is of its type."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator

from flightstack.config import DroneConfig
from mission.documents import DocumentError, line_of, parse
from mission.formation import make_layout
from mission.search import make
from sensors.errors import SensorError
from sensors.instruments import make_instrument


def load(path: str | pathlib.Path) -> DroneConfig:
    """Read and check a drone's file. `DocumentError` says in one line what is wrong and how to mend it."""
    file = str(path)
    try:
        text = pathlib.Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DocumentError(file, f"cannot be read: {error}") from error
    config = parse(text, DroneConfig, file)
    for field, problem in problems(config):
        raise DocumentError(file, problem, line=line_of(text, field), field=field)
    return config


def problems(config: DroneConfig) -> Iterator[tuple[str, str]]:
    """What cannot be flown although every value is of its type: (field, what is wrong and how to mend it)."""
    members, limits, formation = config.swarm.members, config.limits, config.formation
    if config.drone not in members:
        yield "drone", f"drone {config.drone} is not in swarm.members {list(members)}"
    if len(set(members)) != len(members):
        yield "swarm.members", "a drone's id stands twice; every drone needs its own"
    if limits.floor_above_home_m >= limits.ceiling_above_home_m:
        yield "limits.floor_above_home_m", "the floor is not below the ceiling"
    layers = min(len(members), formation.layers)
    top_m = formation.above_home_m + formation.layer_gap_m * layers
    if top_m > limits.ceiling_above_home_m:
        yield (
            "formation.layer_gap_m",
            f"the highest of {layers} layers is at {top_m:g} m, above limits.ceiling_above_home_m",
        )
    layout = make_layout(formation.layout, formation.spacing_m)
    for problem in layout.problems(len(members), limits.separation_m, formation.radio_range_m):
        yield "formation", problem
    for problem in config.geofence.problems() if config.geofence else ():
        yield "geofence", problem
    try:
        make(config.strategy.name, layout=layout, **config.strategy.parameters)
    except (TypeError, ValueError) as error:
        yield "strategy", str(error)
    for index, instrument in enumerate(config.instruments):
        field = f"instruments[{index}]"
        if any(instrument.name == other.name for other in config.instruments[:index]):
            yield f"{field}.name", f"two instruments are called {instrument.name}"
        try:
            make_instrument(instrument.type, instrument.name, instrument.options)
        except SensorError as error:
            yield f"{field}.type", str(error)
