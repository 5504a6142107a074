"""Watching from outside: what `gcs status` and `gcs watch` know, from the swarm's own messages."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import msgspec

from flightstack.swarm.topics import REPORT, Received
from flightstack.swarm.wire import Severity
from gcs.connection import Connection
from gcs.fleet.monitor import NEVER_HEARD_AFTER_S, Alarm, Monitor, why_unheard
from gcs.fleet.view import DroneRow, FleetView

SILENCES = frozenset({"absent", "agent_silent", "lost", "orphan"})
"""Alarms that say that an agent is not heard."""


class Observer:
    """A fleet view fed by peer messages alone; the running ground station's report adds its vehicles and alarms."""

    def __init__(self, connection: Connection, now_s: float, *, patience: float = 1.0) -> None:
        self.view = FleetView(connection.members, connection.frame, now_s)
        self._swarm = connection.swarm
        self._patience = patience
        self._monitor = Monitor(connection.alarms, connection.local_fence(), patience=patience)

    def step(self, now_s: float, received: Sequence[Received]) -> None:
        for message in received:
            self.view.receive_peer(now_s, message)
        self._monitor.step(now_s, self.view)

    def station(self, now_s: float) -> str | None:
        """Name of the ground station that runs, if one does."""
        view = self.view
        if view.report is None or view.report_s is None or now_s - view.report_s > (REPORT.stale_s or 0.0):
            return None
        return view.report.sender

    def alarms(self, now_s: float) -> list[Alarm]:
        """The running station's alarms (it has watched for longer and hears the autopilots), else our own. That we
        do not hear a drone of which the station says nothing is ours in any case."""
        report = self.view.report
        if report is None or self.view.report_s is None or self.station(now_s) is None:
            return self._monitor.alarms
        at_s = self.view.report_s
        theirs = [Alarm(a.severity, a.drone, a.code, a.text, at_s - a.age_s) for a in report.alarms]
        silent = {alarm.drone for alarm in theirs if alarm.code in SILENCES}
        return [*theirs, *self._unheard_here(now_s, silent)]

    def _unheard_here(self, now_s: float, silent: set[int]) -> list[Alarm]:
        """Members that the station hears and this node, which has connections of its own, does not."""
        since_s = self.view.started_s + NEVER_HEARD_AFTER_S * self._patience
        if now_s < since_s:
            return []
        return [
            Alarm(
                Severity.WARNING,
                drone,
                "absent",
                f"no agent heard{why_unheard(now_s, self.view, drone)}",
                since_s,
            )
            for drone in self.view.members
            if drone not in self.view.agents and drone not in silent
        ]

    def heard_anybody(self) -> bool:
        return bool(self.view.agents) or self.view.report is not None

    def snapshot(self, now_s: float) -> Snapshot:
        return Snapshot(
            self._swarm,
            self.station(now_s),
            tuple(self.view.rows(now_s)),
            tuple(
                AlarmLine(str(a.severity), a.drone, a.code, a.text, max(now_s - a.since_s, 0.0))
                for a in self.alarms(now_s)
            ),
        )


class AlarmLine(msgspec.Struct, frozen=True):
    severity: str
    drone: int
    code: str
    text: str
    age_s: float


class Snapshot(msgspec.Struct, frozen=True):
    """What `gcs status --json` prints."""

    swarm: str
    station: str | None
    drones: tuple[DroneRow, ...]
    alarms: tuple[AlarmLine, ...]


def listen(connection: Connection, seconds: float) -> tuple[Observer, float]:
    """Join the swarm for `seconds` of real time; returns what was learnt, and the clock's time of it."""
    clock = connection.clock()
    transport = connection.open(connection.node("status"))
    try:
        observer = Observer(connection, clock.now_s(), patience=0.0)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(0.05)
            observer.step(clock.now_s(), transport.receive())
    finally:
        transport.close()
    return observer, clock.now_s()


def to_json(value: Any) -> str:
    """One line of JSON; what is not a number (nan, inf) becomes null."""
    return msgspec.json.encode(value).decode()
