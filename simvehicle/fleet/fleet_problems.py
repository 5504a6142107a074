"""What is wrong with a fleet's configuration although every value in it is of its type."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from flightstack.transport.claims import clashes, link_claim
from sensors.instruments.registry import instrument_type
from sensors.instruments.samples import Quantity
from sensors.instruments.sensor_error import SensorError
from simvehicle.drone.drone_spec import VehicleSpec
from simvehicle.faults.fault_table import FAULTS, FaultSpec
from simvehicle.fleet.fleet_config import FARTHEST_HOME_M, FleetConfig
from simvehicle.instruments import make_emulator
from simvehicle.world import world_problems


class FleetError(ValueError):
    """A fleet that cannot be run as configured: which field, and what is wrong with it."""

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")
        self.field = field
        self.problem = problem


def problems(config: FleetConfig) -> Iterator[FleetError]:
    """What cannot be flown although every value is of its type."""
    for field, problem in world_problems.problems(config):
        yield FleetError(field, problem)
    ids = [vehicle.id for vehicle in config.vehicles]
    for index, vehicle in enumerate(config.vehicles):
        if vehicle.id in ids[:index]:
            yield FleetError(f"vehicles[{index}].id", f"two vehicles have the id {vehicle.id}")
        for field in ("home_north_m", "home_east_m"):
            if not abs(getattr(vehicle, field)) <= FARTHEST_HOME_M:
                yield FleetError(
                    f"vehicles[{index}].{field}",
                    f"is more than {FARTHEST_HOME_M / 1000:g} km from the origin",
                )
        for place in vehicle.usb_links:
            if not 0 <= place < len(vehicle.links):
                have = f"it has {len(vehicle.links)}, counted from 0"
                yield FleetError(f"vehicles[{index}].usb_links", f"no link has the number {place}; {have}")
        yield from _instrument_problems(index, vehicle)
    waiting = [
        claim
        for index, vehicle in enumerate(config.vehicles)
        for place, link in enumerate(vehicle.links)
        for claim in link_claim(f"vehicles[{index}].links[{place}]", link)
        if claim.kind != "server"  # all vehicles may send to one place
    ]
    for field, problem in clashes(waiting):
        yield FleetError(field, problem)
    for index, fault in enumerate(config.faults):
        where = f"faults[{index}]"
        target = next((vehicle for vehicle in config.vehicles if vehicle.id == fault.drone), None)
        if target is None:
            yield FleetError(f"{where}.drone", f"no vehicle has the id {fault.drone}; there are {ids}")
        else:
            types = {instrument.name: instrument.type for instrument in target.instruments}
            for field, problem in what_does_not_fit(
                fault, f"vehicle {fault.drone}", types, looks_around=target.range_finder is not None
            ):
                yield FleetError(f"{where}.{field}", problem)
        if fault.until_s is not None and fault.until_s <= fault.at_s:
            yield FleetError(f"{where}.until_s", f"is not after at_s ({fault.at_s:g})")


def what_does_not_fit(
    fault: FaultSpec, whose: str, instruments: Mapping[str, str], *, looks_around: bool
) -> Iterator[tuple[str, str]]:
    """(field of the fault, what is wrong with it) for a vehicle that carries `instruments` (name -> type), and a
    range finder if it `looks_around`."""
    if fault.kind in ("range_silent", "range_lying") and not looks_around:
        yield "kind", f"{whose} carries no range_finder"
    needs = FAULTS[fault.kind].needs
    if "instrument" in needs and fault.instrument not in instruments:
        yield (
            "instrument",
            f"{whose} carries no instrument called {fault.instrument!r}, but {list(instruments)}",
        )
    elif (
        fault.kind == "lying" and instrument_type(instruments[fault.instrument]).quantity is not Quantity.CO2
    ):
        yield "instrument", f"{whose}'s {fault.instrument} measures no CO2; name one that does"
    for field in ("instrument", "unheard"):
        if field not in needs and getattr(fault, field):
            yield field, f'"{fault.kind}" has no {field}; remove it'
    if "unheard" in needs and fault.unheard is None:
        yield "unheard", f'"{fault.kind}" needs unheard; write remote_control or ground_link'


def _instrument_problems(index: int, vehicle: VehicleSpec) -> Iterator[FleetError]:
    carried = [instrument.name for instrument in vehicle.instruments]
    for place, instrument in enumerate(vehicle.instruments):
        where = f"vehicles[{index}].instruments[{place}]"
        if instrument.name in carried[:place]:
            yield FleetError(f"{where}.name", f"two instruments are called {instrument.name}")
        try:
            make_emulator(instrument.type, np.random.default_rng(0))
        except SensorError as error:
            yield FleetError(f"{where}.type", str(error))
