"""The swarm's network: codecs, and twenty nodes in processes of their own that each send ten messages a second."""

from __future__ import annotations

import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Callable

from benchmarks import Figures
from flightstack.recording import named_json
from flightstack.swarm.topics import ORDER, STATE, TABLE, Topic
from flightstack.swarm.wire import DroneState, OrderState, Phase, TableState
from flightstack.transport.zenoh_transport import ZenohTransport
from mission.estimation.estimates import Scalar, Wind
from mission.strategies.contract import Order, Stage
from mission.tree.slot_registers import SlotRegister, configured
from simvehicle.survey.ports import free_ports

PEERS = 20
RATE_HZ = 10.0
MEASURE_S = 10.0
SHARE_TARGET_PERCENT = 10.0
HEARD_TARGET_PERCENT = 99.0

STATE_MESSAGE = DroneState(
    sender=3,
    incarnation=1234567890,
    sequence=51234,
    frame=123456789,
    phase=Phase.TRACKING,
    position_ned_m=(101.53, -202.25, -10.04),
    velocity_ned_mps=(1.5, -0.25, 0.04),
    heading_rad=0.1,
    home_ned_m=(0.0, 5.0, 0.0),
    armed=True,
    airborne=True,
    mode="GUIDED",
    battery_fraction=0.75,
    co2_ppm=431.0,
    excess_co2_ppm=Scalar(11.0, 2.0, 0.1),
    wind=Wind((3.0, 0.5, 0.0), 0.2, 0.3),
    epoch=2,
    slot=0,
    parent=None,
    healing=False,
    tracking_best_ppm=14.5,
)
TABLE_MESSAGE = TableState(
    sender=3,
    incarnation=1234567890,
    sequence=51234,
    frame=123456789,
    survey="7f3c2a9e01b4",
    slots=tuple(configured(range(1, PEERS + 1)).items()),
    members=(),
    absent=(),
)
ORDER_MESSAGE = OrderState(
    sender=3,
    incarnation=1234567890,
    sequence=51234,
    frame=123456789,
    survey="7f3c2a9e01b4",
    order=Order(4, Stage.TRACK, (1.0, 2.0, -10.0), 0.5),
    ordered_by=SlotRegister(0, 1),
    digest=3123456789,
)

PEER = """
import resource, struct, sys, time
from flightstack.swarm.topics import STATE
from flightstack.transport.zenoh_transport import ZenohTransport
name, own, endpoints, period_s = sys.argv[1], sys.argv[2], sys.argv[3].split(","), float(sys.argv[4])
node = ZenohTransport("bench", name, (own,), endpoints, (STATE,))
payload = b"x" * 200
heard, cpu_s, wall_s = 0, 0.0, 0.0
for line in sys.stdin:
    # One line a phase: how long it takes.
    heard, cpu_s, began_s = 0, time.process_time(), time.monotonic()
    due_s = began_s
    while due_s - began_s < float(line):
        node.publish(STATE, struct.pack("<d", time.monotonic()) + payload)
        heard += len(node.receive())
        due_s += period_s
        time.sleep(max(0.0, due_s - time.monotonic()))
    cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - began_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(heard, cpu_s, wall_s, peak_mb, len(node.alive()), flush=True)
node.close()
"""


def microseconds(action: Callable[[], object], times: int = 2000) -> float:
    """The median of five runs: other processes disturb single ones."""
    runs = []
    for _ in range(5):
        began_s = time.perf_counter()
        for _ in range(times):
            action()
        runs.append((time.perf_counter() - began_s) / times * 1e6)
    return statistics.median(runs)


def codecs() -> None:
    print(f"{'message':<28} {'bytes':>6} {'encode us':>10} {'decode us':>10} {'json bytes':>11}")
    cases: tuple[tuple[str, Topic, DroneState | TableState | OrderState], ...] = (
        ("state", STATE, STATE_MESSAGE),
        (f"table of {PEERS}", TABLE, TABLE_MESSAGE),
        ("order", ORDER, ORDER_MESSAGE),
    )
    for what, topic, message in cases:
        data = topic.codec.encode(message)
        named = len(named_json.encode(message))
        encode_us = microseconds(lambda topic=topic, message=message: topic.codec.encode(message))  # type: ignore[misc]
        decode_us = microseconds(lambda topic=topic, data=data: topic.codec.decode(data))  # type: ignore[misc]
        print(f"{what:<28} {len(data):>6} {encode_us:>10.2f} {decode_us:>10.2f} {named:>11}")


def swarm() -> None:
    """Twenty nodes for some seconds, with this process among them as the one that measures delays."""
    endpoints = [f"tcp/127.0.0.1:{port}" for port in free_ports(socket.SOCK_STREAM, PEERS + 1)]
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PEER, str(n + 1), endpoints[n], ",".join(endpoints), str(1.0 / RATE_HZ)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for n in range(PEERS)
    ]
    listener = ZenohTransport("bench", "listener", endpoints[-1:], endpoints, (STATE,))
    try:
        began_s = time.monotonic()
        while len(listener.alive()) < PEERS:
            if time.monotonic() - began_s > 120.0:
                raise SystemExit(f"only {len(listener.alive())} of {PEERS} nodes have come up")
            time.sleep(0.05)
        joined_s = time.monotonic() - began_s
        phase(processes, 2.0, listener)  # until everybody has met everybody
        reports, delays_ms = phase(processes, MEASURE_S, listener)
    finally:
        listener.close()
        for process in processes:
            assert process.stdin is not None
            process.stdin.close()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()
    shares = [cpu_s / wall_s for _, cpu_s, wall_s, _, _ in reports]
    heard = sum(count for count, *_ in reports) / (PEERS * (PEERS - 1) * MEASURE_S * RATE_HZ)
    percentiles = statistics.quantiles(delays_ms, n=100)
    print(f"\n{PEERS} nodes, {RATE_HZ:g} messages a second each, {MEASURE_S:g} s, all on this machine")
    print(f"  all met after {joined_s:.1f} s (starting {PEERS} interpreters included)")
    print(
        f"  delay p50 {percentiles[49]:.2f} ms, p99 {percentiles[98]:.2f} ms, largest {max(delays_ms):.1f} ms"
    )
    print(f"  memory of a node with nothing else in it: {max(report[3] for report in reports):.0f} MB")
    figures = Figures()
    figures.show("share of one core a node", 100.0 * max(shares), "%", most=SHARE_TARGET_PERCENT)
    figures.show("messages heard", 100.0 * heard, "%", least=HEARD_TARGET_PERCENT)
    figures.leave()


def phase(
    processes: list[subprocess.Popen[str]], seconds: float, listener: ZenohTransport
) -> tuple[list[tuple[float, ...]], list[float]]:
    """What each node reports of the next `seconds`, and every delay that the listener saw in them."""
    for process in processes:
        assert process.stdin is not None
        process.stdin.write(f"{seconds}\n")
        process.stdin.flush()
    delays_ms = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        for message in listener.receive():
            sent_s = struct.unpack_from("<d", message.payload)[0]  # one machine, one monotonic clock
            delays_ms.append(1000.0 * (time.monotonic() - sent_s))
        time.sleep(0.0005)
    reports = []
    for process in processes:
        assert process.stdout is not None
        reports.append(tuple(float(word) for word in process.stdout.readline().split()))
    return reports, delays_ms


def main() -> None:
    codecs()
    swarm()


if __name__ == "__main__":
    main()
