"""The swarm's protocol: how soon a loss is healed, what is taken for one and is none, what is said, how far words go.

Kinematic drones with the code of flight over the in-process radio (`simvehicle.scenario.kinematic_swarm`), on
simulated time: the figures are the protocol's, the same on every machine. `python -m benchmarks.healing docs/images`
writes the figures of docs/swarm.md there, and prints the tables in it.
"""

from __future__ import annotations

import pathlib
import statistics
import sys
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from benchmarks import Figures
from flightstack.swarm.membership import UNDOUBTED
from flightstack.swarm.topics import Topic
from flightstack.swarm.wire import MemberRegister
from flightstack.transport.radio_model import RadioModel
from mission.geometry.formation import make_layout
from mission.tree.balanced_tree import problems
from simvehicle.scenario.kinematic_drone import KinematicDrone
from simvehicle.scenario.kinematic_swarm import KinematicSwarm

SPACING_M: Final = 10.0
NEXT_ONLY_M: Final = 1.45 * SPACING_M
"""A range in which a drone hears only those in the slots next to its own, also while the formation moves."""
STEADY_S: Final = 6.0
"""After the start until everybody has heard everybody for long enough."""
TRIALS: Final = 12
LOSSES: Final = (0.0, 0.1, 0.2, 0.3)
CALM_LOSSES: Final = (0.0, 0.1, 0.2, 0.3, 0.5)
SIZES: Final = (5, 20, 50, 100, 200)
HEALED_SIZE: Final = 20
CALM_FOR_S: Final = 60.0
HOP_SIZES: Final = (7, 19, 37, 61, 91)
"""Full levels of the hexagonal layout."""


class Healed(NamedTuple):
    """Seconds from a failure on."""

    missed_s: float
    """Until somebody misses the drone."""
    agreed_s: float
    """From then until all that live have one whole table of themselves."""
    flown_s: float
    """From then until everybody is in its slot."""


def swarm(count: int, loss: float, seed: int, range_m: float | None = None) -> KinematicSwarm:
    return KinematicSwarm(count, SPACING_M, RadioModel(loss=loss, range_m=range_m), seed)


def run_until(flight: KinematicSwarm, done: Callable[[], bool], within_s: float) -> float:
    """Seconds that it took. It ends with an error where it does not come to it."""
    began_s = flight.now_s
    while not done():
        if flight.now_s - began_s > within_s:
            raise SystemExit(f"not after {within_s:g} s: {done.__doc__ or done}")
        flight.step()
    return flight.now_s - began_s


def healed(count: int, loss: float, seed: int) -> Healed:
    """One drone of a swarm at work fails, another with every seed."""
    flight = swarm(count, loss, seed)
    run_until(flight, lambda: flight.now_s >= STEADY_S + 0.1 * (seed % 7), 60.0)
    victim = 1 + seed % count
    before = {d: _register(m.drone, victim) for d, m in flight.members.items()}
    flight.kill(victim)
    live: list[KinematicDrone] = [m.drone for m in flight.members.values() if m.alive]

    def missed() -> bool:
        return any(_register(d, victim) != before[d.drone] for d in live)

    def agreed() -> bool:
        slots = live[0].table.slots
        return (
            len(slots) == count - 1
            and all(d.table.slots == slots for d in live)
            and not _holes(flight, slots)
        )

    def in_place() -> bool:
        return all(d.has_arrived for d in live)

    return Healed(
        run_until(flight, missed, 30.0), run_until(flight, agreed, 30.0), run_until(flight, in_place, 60.0)
    )


def _register(drone: KinematicDrone, of: int) -> MemberRegister:
    """What `drone` knows of the life of another."""
    return dict(drone.table.message().members).get(of, UNDOUBTED)


def _holes(flight: KinematicSwarm, slots: Mapping[int, int]) -> bool:
    return bool(problems(slots, flight.layout))


def false_alarms(count: int, loss: float, seconds: float) -> tuple[float, float]:
    """(suspicions a drone and hour, slots that changed hands a swarm and hour) while nothing fails."""
    flight = swarm(count, loss, 1)
    run_until(flight, lambda: flight.now_s >= STEADY_S, 60.0)
    drones = [m.drone for m in flight.members.values()]
    lives = sum(max(_register(d, other).life for d in drones) for other in flight.ids)
    epochs = max(d.table.epoch for d in drones)
    run_until(flight, lambda: flight.now_s >= STEADY_S + seconds, seconds + 1.0)
    doubts = sum(max(_register(d, other).life for d in drones) for other in flight.ids) - lives
    moves = max(d.table.epoch for d in drones) - epochs
    return 3600.0 * doubts / seconds / count, 3600.0 * moves / seconds


class Said(NamedTuple):
    """Of one drone in one second."""

    messages: float
    bytes: float


class Ears:
    """Counts what is put on the air."""

    def __init__(self, flight: KinematicSwarm) -> None:
        self.messages = self.bytes = 0
        send = flight.radio.send

        def counted(sender: str, topic: Topic, payload: bytes) -> None:
            self.messages += 1
            self.bytes += len(payload)
            send(sender, topic, payload)

        flight.radio.send = counted  # type: ignore[method-assign]

    def over(self, flight: KinematicSwarm, seconds: float, drones: int) -> Said:
        self.messages = self.bytes = 0
        end_s = flight.now_s + seconds
        run_until(flight, lambda: flight.now_s >= end_s, seconds + 1.0)
        return Said(self.messages / seconds / drones, self.bytes / seconds / drones)


def said(count: int) -> tuple[Said, Said]:
    """(at work, in the two seconds in which the loss of the first child of the root is healed), at 10 % loss."""
    flight = swarm(count, 0.1, 1)
    ears = Ears(flight)
    run_until(flight, lambda: flight.now_s >= STEADY_S, 60.0)
    at_work = ears.over(flight, 5.0, count)
    flight.kill(2)
    end_s = flight.now_s + 0.6
    run_until(flight, lambda: flight.now_s >= end_s, 60.0)
    return at_work, ears.over(flight, 2.0, count - 1)


class Hops(NamedTuple):
    levels: int
    """Hops from the outermost drones to the root."""
    order_s: float
    """From the root's order until everybody has it."""
    readings_s: float
    """From then until the last reading is with the root, the flight of 0.6 s to where it is taken included."""


def hops(count: int) -> Hops:
    """Everybody hears only those in the slots next to its own."""
    flight = swarm(count, 0.1, 1, NEXT_ONLY_M)
    run_until(flight, lambda: flight.now_s >= STEADY_S, 60.0)
    root = flight.members[1].drone.table
    drones = [m.drone for m in flight.members.values()]
    orders, readings = [], []
    for _ in range(5):
        known = root.order
        run_until(flight, lambda known=known: root.order is not known, 60.0)  # type: ignore[misc]
        newest = root.order
        orders.append(
            run_until(flight, lambda: all(d.table.order == newest for d in drones), 60.0)  # noqa: B023
        )
        readings.append(run_until(flight, lambda: len(root.readings) == count or root.order != newest, 60.0))  # noqa: B023
    levels = make_layout("hexagonal", SPACING_M).level(count - 1)
    return Hops(levels, statistics.mean(orders), statistics.mean(readings))


class Measured(NamedTuple):
    healing: dict[float, list[Healed]]
    """By loss, of swarms of `HEALED_SIZE`."""
    alarms: dict[float, tuple[float, float]]
    said: dict[int, tuple[Said, Said]]
    hops: dict[int, Hops]


def measure() -> Measured:
    return Measured(
        {loss: [healed(HEALED_SIZE, loss, seed) for seed in range(TRIALS)] for loss in LOSSES},
        {loss: false_alarms(HEALED_SIZE, loss, CALM_FOR_S) for loss in CALM_LOSSES},
        {count: said(count) for count in SIZES},
        {count: hops(count) for count in HOP_SIZES},
    )


def tables(found: Measured) -> str:
    """As docs/swarm.md shows them, in Markdown."""
    lines = [
        "| loss | missed | agreed | in the slot | whole, median | whole, worst |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for loss, trials in found.healing.items():
        missed, agreed, flown = (statistics.median(column) for column in zip(*trials, strict=True))
        whole = [sum(trial) for trial in trials]
        lines.append(
            f"| {loss:.0%} | {missed:.2f} s | {agreed:.2f} s | {flown:.2f} s "
            f"| {statistics.median(whole):.2f} s | {max(whole):.2f} s |"
        )
    lines += [
        "",
        "| loss | doubts a drone and hour | changes of slots a swarm and hour |",
        "| --- | --- | --- |",
    ]
    lines += [
        f"| {loss:.0%} | {doubts:.1f} | {moves:.1f} |" for loss, (doubts, moves) in found.alarms.items()
    ]
    lines += [
        "",
        "| drones | messages at work | bytes at work | messages healing | bytes healing |",
        "| --- | --- | --- | --- | --- |",
    ]
    for count, (work, heal) in found.said.items():
        lines.append(
            f"| {count} | {work.messages:.1f} | {work.bytes:.0f} | {heal.messages:.1f} | {heal.bytes:.0f} |"
        )
    lines += ["", "| drones | hops | order at all | readings at the root |", "| --- | --- | --- | --- |"]
    for count, far in found.hops.items():
        lines.append(f"| {count} | {far.levels} | {far.order_s:.2f} s | {far.readings_s:.2f} s |")
    return "\n".join(lines)


def draw(found: Measured, directory: pathlib.Path) -> None:
    """swarm-healing.png and swarm-traffic.png of docs/swarm.md."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    times, alarms = figure.subplots(1, 2)
    places = range(len(found.healing))
    below = [0.0] * len(found.healing)
    for index, name in enumerate(("missed", "agreed", "in the slot")):
        shares = [statistics.median(trial[index] for trial in trials) for trials in found.healing.values()]
        times.bar(places, shares, bottom=below, label=name)
        below = [a + b for a, b in zip(below, shares, strict=True)]
    times.set_xticks(list(places), [f"{loss:.0%}" for loss in found.healing])
    times.set_xlabel("loss")
    times.set_ylabel("s after the failure, median")
    times.set_title("one drone fails")
    times.set_ylim(0.0, 1.2 * max(below))
    times.legend(loc="upper center", ncols=3)
    percent = [100.0 * loss for loss in found.alarms]
    alarms.plot(
        percent, [doubts for doubts, _ in found.alarms.values()], "o-", label="doubts a drone and hour"
    )
    alarms.plot(
        percent, [m for _, m in found.alarms.values()], "s-", label="changes of slots a swarm and hour"
    )
    alarms.set_yscale("symlog", linthresh=1.0)
    alarms.set_xlabel("loss, %")
    alarms.set_title("while nothing fails")
    alarms.legend()
    figure.savefig(directory / "swarm-healing.png", dpi=110)

    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    traffic, latency = figure.subplots(1, 2)
    for index, name in enumerate(("at work", "healing")):
        rates = [both[index].bytes for both in found.said.values()]
        traffic.plot(list(found.said), rates, "o-", label=name)
    traffic.set_xlim(left=0.0)
    traffic.set_ylim(bottom=0.0)
    traffic.set_xlabel("drones")
    traffic.set_ylabel("bytes a drone and second")
    traffic.legend()
    roots = [count**0.5 for count in found.hops]
    latency.plot(roots, [far.levels for far in found.hops.values()], "o-", label="hops")
    latency.plot(roots, [far.order_s for far in found.hops.values()], "s-", label="order at all, s")
    latency.plot(
        roots, [far.readings_s for far in found.hops.values()], "^-", label="readings at the root, s"
    )
    latency.plot(roots, [(root * root / 3.0) ** 0.5 for root in roots], ":", label="sqrt(N / 3)")
    latency.set_xlabel("square root of the number of drones")
    latency.set_ylabel("hops, or seconds")
    latency.legend()
    figure.savefig(directory / "swarm-traffic.png", dpi=110)


def main() -> None:
    found = measure()
    print(tables(found))
    figures = Figures()
    missed, agreed, _ = (statistics.median(column) for column in zip(*found.healing[0.1], strict=True))
    figures.show("until a loss is missed, 10 % loss, median", missed, "s", most=1.0)
    figures.show("from then until all agree, median", agreed, "s", most=0.5)
    figures.show("doubts a drone and hour, 10 % loss", found.alarms[0.1][0], most=10.0)
    figures.show("changes of slots an hour, 10 % loss", found.alarms[0.1][1], most=1.0)
    small, large = found.said[min(SIZES)][0].bytes, found.said[max(SIZES)][0].bytes
    figures.show("bytes at work, 200 drones to 5", large / small, "times", most=2.0)
    figures.leave()


if __name__ == "__main__":
    draw(measured := measure(), pathlib.Path(sys.argv[1]))
    print(tables(measured))
