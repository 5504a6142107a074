"""The running ground station: the shell that gives `gcs.station.Station` its clock, links, network and files."""

from __future__ import annotations

import contextlib
import datetime
import logging
import pathlib
import time
from collections.abc import Iterator

from flightstack.mavlink.link import ByteLink, LinkError, open_link
from flightstack.mavlink.link.signed_link import SignedLink
from flightstack.mavlink.signing_store import SigningKeyError, SigningStore
from flightstack.recording.background_file import make_directory
from flightstack.recording.clock import Clock, make_clock
from flightstack.recording.recorder import FlightRecorder, RecordingError, TlogWriter
from flightstack.recording.start_number import next_start
from flightstack.stop_signals import StopSignals
from flightstack.swarm.wire import Severity
from flightstack.transport import Transport, TransportError
from flightstack.transport.endpoints import faulty_field
from flightstack.transport.shared_radio import behind_radio
from flightstack.transport.zenoh_transport import ZenohTransport
from gcs.connection import RECEIVED
from gcs.plans.checks import load_fence
from gcs.station import Station, StationOutputs
from gcs.station_config import GroundConfig
from mission.documents.yaml_file import fault_of

log = logging.getLogger("gcs")

LINK_PATIENCE_S = 5.0
"""Real seconds after the start in which a link that does not work yet is nothing to tell."""

LEVELS = {Severity.INFO: logging.INFO, Severity.WARNING: logging.WARNING, Severity.CRITICAL: logging.ERROR}


class Recordings:
    """One timeline of the swarm, and one MAVLink log a vehicle, opened when the vehicle is first heard."""

    def __init__(self, directory: pathlib.Path, now: datetime.datetime, now_s: float) -> None:
        """`now` on the calendar is `now_s` on the station's clock."""
        self._directory = directory
        self._unix_at_zero_s = now.timestamp() - now_s
        """Common to all logs, so that they fit together."""
        self.timeline = FlightRecorder(directory / f"swarm-{now:%Y%m%dT%H%M%SZ}.mcap")
        # Two stations of one second may record into one directory: the vehicles' logs are named as their timeline is.
        self._stamp = self.timeline.path.stem.removeprefix("swarm-")
        self._logs: dict[int, TlogWriter] = {}
        self._unopened: dict[int, str] = {}
        """Why a vehicle has no log."""

    def write(self, now_s: float, outputs: StationOutputs) -> None:
        for entry in outputs.timeline:
            self.timeline.record(entry.topic, now_s, entry.message)
        for frame in outputs.frames:
            tlog = self._logs.get(frame.system)
            if tlog is None:
                tlog = self._open(frame.system)
            if tlog is not None:
                tlog.write(now_s, frame.data)

    def _open(self, system: int) -> TlogWriter | None:
        """A disk that is full in flight must not end the station that brings orphans home: None, and told once."""
        if system in self._unopened:
            return None
        path = self._directory / f"vehicle-{system}-{self._stamp}.tlog"
        try:
            make_directory(self._directory)
            self._logs[system] = TlogWriter(path, self._unix_at_zero_s)
        except (OSError, RecordingError) as error:
            self._unopened[system] = str(error)
        return self._logs.get(system)

    def problems(self) -> set[str]:
        """Why something is not recorded now (the disk is full), a line each."""
        found = {self.timeline.problem, *(tlog.problem for tlog in self._logs.values())}
        found.update(self._unopened.values())
        return found - {""}

    def close(self) -> None:
        self.timeline.close()
        for tlog in self._logs.values():
            tlog.close()


def serve(config: GroundConfig, file: pathlib.Path) -> int:
    """Run until a signal; returns the exit code. What cannot be opened raises with one clear line."""
    stop = StopSignals()
    stop.install()
    clock = make_clock(config.speedup, config.clock)
    directory = _directory(config, file)
    incarnation = next_start(directory, config.station)
    station = Station(config, load_fence(config, file), clock.now_s(), incarnation=incarnation)
    with contextlib.ExitStack() as opened:
        links: list[ByteLink] = []
        for link in _open_links(config, file):
            links.append(link)
            opened.callback(link.close)
        try:
            transport = ZenohTransport(
                config.swarm.name,
                config.station,
                config.swarm.listen,
                config.swarm.connect,
                RECEIVED,
                config.swarm.tls,
                config.swarm.members,
                config.swarm.site,
            )
        except TransportError as error:
            raise fault_of(str(file), faulty_field(error), str(error)) from error
        heard = behind_radio(transport, config.station, config.radio, clock.now_s)
        opened.callback(heard.close)
        try:
            recordings = Recordings(directory, datetime.datetime.now(datetime.UTC), clock.now_s())
        except RecordingError as error:
            raise fault_of(str(file), "record_to", str(error)) from error
        opened.callback(recordings.close)
        recordings.timeline.record("/config", clock.now_s(), config)
        log.info(
            "ground station %s of swarm %s ready: %d MAVLink links, recording to %s",
            config.station,
            config.swarm.name,
            len(links),
            recordings.timeline.path,
        )
        _loop(config, station, clock, heard, links, recordings, stop)
    log.info("ground station %s stopped", config.station)
    return 0


def _open_links(config: GroundConfig, file: pathlib.Path) -> Iterator[ByteLink]:
    key = config.mavlink.signing_key
    try:
        store = None if key is None else SigningStore(pathlib.Path(key))
    except SigningKeyError as error:
        raise fault_of(str(file), "mavlink.signing_key", str(error)) from error
    for index, text in enumerate(config.mavlink.links):
        try:
            link = open_link(text)
        except LinkError as error:
            raise fault_of(str(file), f"mavlink.links[{index}]", str(error)) from error
        # The link's own number; the commands of this station have others.
        yield link if store is None else SignedLink(link, store, index % 100)


def _in_short(problems: set[str]) -> str:
    """The first, and how many more there are: every vehicle has a log on the same disk."""
    first, *more = sorted(problems) or [""]
    return f"{first} (and {len(more)} more)" if more else first


def _directory(config: GroundConfig, file: pathlib.Path) -> pathlib.Path:
    directory = pathlib.Path(config.record_to)
    try:
        make_directory(directory)
    except OSError as error:
        problem = f"{directory} cannot be made: {error.strerror}; name another directory"
        raise fault_of(str(file), "record_to", problem) from error
    return directory


def _loop(
    config: GroundConfig,
    station: Station,
    clock: Clock,
    transport: Transport,
    links: list[ByteLink],
    recordings: Recordings,
    stop: StopSignals,
) -> None:
    period_s = 1.0 / config.tick_hz
    due_s = clock.now_s()
    problems = [""] * len(links)
    begun_s = time.monotonic()
    while not stop.asked:
        clock.sleep_until(due_s)
        received = transport.receive()
        data = [link.read() for link in links]
        now_s = clock.now_s()
        outputs = station.step(now_s, received, data, _in_short(recordings.problems()))
        for topic, message in outputs.publish:
            transport.publish(topic, topic.codec.encode(message))
        for link, written in zip(links, outputs.writes, strict=True):
            if written:
                link.write(written)
        recordings.write(now_s, outputs)
        for severity, line in outputs.log:
            log.log(LEVELS[severity], "%s", line)
        for index, link in enumerate(links):
            patient = time.monotonic() < begun_s + LINK_PATIENCE_S
            if link.problem != problems[index] and not patient:
                problems[index] = link.problem
                log.warning("%s", link.problem or f"{link.describe} works again")
        # Ticks that are past are not made up: after a stall the station goes on with the present.
        due_s = max(due_s + period_s, clock.now_s() - period_s)
