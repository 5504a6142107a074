"""Stand-ins for the parts of a simulated survey, and a launcher that uses them: python fly_standin.py PART …

They speak the real messages over the real network, but fly by saying so: an agent writes where its vehicle is
into a file, and the vehicles' stand-in makes the world's record of those files. They test the launcher.
"""

from __future__ import annotations

import os
import pathlib
import signal
import sys
import time

import msgspec

from flightstack.config import DroneConfig
from flightstack.config_file import load
from flightstack.recording.clock import make_clock
from flightstack.recording.shared_clock import ClockCells
from flightstack.swarm import topics
from flightstack.swarm.wire import (
    CommandName,
    CommandOutcome,
    DroneState,
    OrderState,
    Phase,
    Result,
    TableState,
)
from flightstack.transport.zenoh_transport import ZenohTransport
from mission.documents.yaml_file import parse
from mission.estimation.estimates import Scalar
from mission.geometry.frames import Vector3
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import configured
from simvehicle.fleet.fleet_clock import FleetClock
from simvehicle.fleet.fleet_config import FleetConfig
from simvehicle.fleet.truth import COLUMNS

TAKE_OFF_S, SEARCH_S, TRACK_S, FOUND_S, HOME_S = 5.0, 10.0, 20.0, 40.0, 50.0
"""Seconds after the start command."""
ENDLESS = "endless"
"""Name of a survey that finds nothing: its drones track until they are told to land."""
FAILSAFE_S = 6.0
"""Silence after which a stand-in vehicle goes home by itself."""


class ToldPlace(msgspec.Struct, array_like=True):
    """What an agent tells the vehicles' stand-in, through a file."""

    time_s: float
    position_ned_m: Vector3
    airborne: bool


def agent(config: DroneConfig) -> None:
    clock = make_clock(config.speedup, config.clock)
    swarm = config.swarm
    receives = (topics.COMMAND,)
    transport = ZenohTransport(
        swarm.name, config.drone, swarm.listen, swarm.connect, receives, swarm.tls, swarm.members
    )
    file = pathlib.Path(config.record_to).parent / f"drone-{config.drone}.told"
    started_s: float | None = None
    landing = False
    ticks = 0
    while True:
        now_s = clock.now_s()
        for received in transport.receive():
            command = topics.COMMAND.codec.decode(received.payload)
            if command.name is CommandName.START and started_s is None:
                started_s = now_s
            landing = landing or command.name in (CommandName.LAND, CommandName.ABORT)
            outcome = CommandOutcome(command.identity, config.drone, Result.ACCEPTED)
            transport.publish(topics.OUTCOME, topics.OUTCOME.codec.encode(outcome))
        age_s = -1.0 if started_s is None else now_s - started_s
        phase, stage = _plot(min(age_s, TRACK_S) if swarm.name == ENDLESS else age_s, landing=landing)
        airborne = phase not in (Phase.DISARMED, Phase.LANDED)
        share = (
            min(max((age_s - TRACK_S) / (FOUND_S - TRACK_S), 0.0), 1.0) if phase is not Phase.LANDED else 0.0
        )
        # Across the line in which they stand: how far apart they are does not hang on when each began.
        where = (90.0 * share, 10.0 * config.drone, -10.0 if airborne else 0.0)
        if phase is Phase.LANDED:
            where = _home(config)
        ticks += 1
        excess = Scalar(100.0 * share, 1.0, 0.1)
        state = DroneState(
            config.drone, os.getpid(), ticks, 7, phase, where, (0.0, 0.0, 0.0), 0.0, _home(config), airborne,
            airborne, "GUIDED", 0.9, 420.0, excess, None, 0, config.drone - 1, None, False, None, (), ticks, 0,
        )  # fmt: skip
        transport.publish(topics.STATE, topics.STATE.codec.encode(state))
        if stage is not None:
            source = (30.5, -84.0, -10.0) if stage is Stage.FOUND else None
            order = Order(list(Stage).index(stage) + 1, stage, where, 0.0, source)
            claims = tuple(configured(swarm.members).items())
            table = TableState(config.drone, os.getpid(), ticks, 7, "", claims, (), ())
            transport.publish(topics.TABLE, topics.TABLE.codec.encode(table))
            ordered = OrderState(config.drone, os.getpid(), ticks, 7, "", order, claims[0][1])
            transport.publish(topics.ORDER, topics.ORDER.codec.encode(ordered))
        told = file.with_suffix(".new")
        told.write_bytes(msgspec.json.encode(ToldPlace(now_s, where, airborne)))
        told.replace(file)
        clock.sleep_until(now_s + 0.5)


def _plot(age_s: float, *, landing: bool) -> tuple[Phase, Stage | None]:
    if age_s < 0.0:
        return Phase.DISARMED, None
    if landing or age_s >= HOME_S:
        return Phase.LANDED, None if landing else Stage.FOUND
    steps = [
        (FOUND_S, Phase.RETURNING, Stage.FOUND),
        (TRACK_S, Phase.TRACKING, Stage.TRACK),
        (SEARCH_S, Phase.SEARCHING, Stage.SEARCH),
        (TAKE_OFF_S, Phase.TAKEOFF, None),
    ]
    return next(((phase, stage) for since_s, phase, stage in steps if age_s >= since_s), (Phase.ARMING, None))


def _home(config: DroneConfig) -> Vector3:
    return 0.0, 10.0 * config.drone, 0.0


def vehicles(fleet: FleetConfig) -> None:
    assert fleet.truth is not None
    assert fleet.clock is not None
    fleet_clock = FleetClock(fleet.speedup, ClockCells(fleet.clock))
    directory = pathlib.Path(fleet.truth).parent
    with pathlib.Path(fleet.truth).open("w", encoding="utf-8") as truth:
        truth.write(",".join(COLUMNS) + "\n")
        tick = 0
        while True:
            tick += 1
            while fleet_clock.advance() < tick / 10.0:
                fleet_clock.publish()
                time.sleep(0.002)
            fleet_clock.publish()
            for vehicle in fleet.vehicles:
                try:
                    data = (directory / f"drone-{vehicle.id}.told").read_bytes()
                except FileNotFoundError:
                    data = msgspec.json.encode(ToldPlace(tick / 10.0, (0.0, 10.0 * vehicle.id, 0.0), False))
                told = msgspec.json.decode(data, type=ToldPlace)
                silent_s = tick / 10.0 - told.time_s
                mode = "RTL" if silent_s > FAILSAFE_S else "GUIDED"
                flies = told.airborne and silent_s < 2.0 * FAILSAFE_S
                n, e, d = told.position_ned_m if flies else (0.0, 10.0 * vehicle.id, 0.0)
                row = (tick / 10.0, vehicle.id, n, e, d, int(flies), int(flies), mode, 420.0, 0.9)
                truth.write(",".join(map(str, row)) + "\n")
            truth.flush()


def standin(part: str, config: pathlib.Path) -> list[str]:
    """As `simvehicle.survey.launch.installed`, with the parts of this file."""
    return [sys.executable, __file__, part, str(config)]


def broken(part: str, config: pathlib.Path) -> list[str]:
    """The same, but the ground station's port is taken."""
    if part == "ground":
        return [sys.executable, "-c", "print('ground.yaml: port 14550 is in use'); raise SystemExit(2)"]
    return standin(part, config)


def main() -> None:
    part, path = sys.argv[1], pathlib.Path(sys.argv[2])
    if part == "fly":
        from simvehicle.survey.conduct import fly, words
        from simvehicle.survey.survey_file import load as load_survey

        flown = fly(load_survey(path), out=pathlib.Path(sys.argv[3]), commands=standin)
        sys.stdout.write(words(flown.summary))
        return
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if part == "vehicles":
        vehicles(parse(path.read_text(encoding="utf-8"), FleetConfig, str(path)))
    elif part == "agent":
        agent(load(path))
    else:
        signal.pause()


if __name__ == "__main__":
    main()
