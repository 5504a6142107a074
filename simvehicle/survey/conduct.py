"""`simvehicle fly`: a whole survey on this machine, from its file to its report."""

from __future__ import annotations

import contextlib
import datetime
import math
import os
import pathlib
import time

import msgspec

from flightstack.recording.shared_clock import ClockCells
from flightstack.swarm.topics import COMMAND
from flightstack.swarm.wire import Severity
from flightstack.transport import Transport
from gcs.keys.authority import check_library
from mission.geometry.formation import make_layout
from simvehicle.fleet.truth import TruthTail, read_tracks
from simvehicle.survey import launch, progress, summary
from simvehicle.survey.agent_faults import Freeze, Kill, check_drones
from simvehicle.survey.draft import LAUNCHER, agent_name
from simvehicle.survey.processes import Interrupts, Processes
from simvehicle.survey.supervisor import Finish, FreezeAgent, Give, KillAgent, Supervisor, WakeAgent
from simvehicle.survey.survey_file import Survey
from simvehicle.survey.watch import RECEIVES, Log, SurveyWatch
from simvehicle.world.configured import make_world

PERIOD_WALL_S = 0.1
HEARD_WITHIN_S = 0.5
"""Simulated time goes no further than this past our last look at the swarm: else a busy machine would tell late when
things happened, and give commands and kill late."""
MISSED_LIMIT = 0.01
"""Share of missed deadlines above which the summary warns."""
LINGER_WALL_S = 1.0
"""How long everybody may go on after the end, so that the recordings hold the end too."""


class Flown(msgspec.Struct, frozen=True):
    """A survey that is over, with everything that its report is made from."""

    summary: summary.Summary
    log: Log
    directory: pathlib.Path
    bad_input: bool
    """A part could not start with what it was given; nothing has flown."""


def fly(
    survey: Survey,
    *,
    out: pathlib.Path,
    kills: tuple[Kill, ...] = (),
    freezes: tuple[Freeze, ...] = (),
    tls: bool = False,
    commands: launch.Commands = launch.installed,
) -> Flown:
    """Fly `survey` to its end, whatever that is; nothing that was started is left running.

    Everything is written into a new directory in `out`. Ctrl-C or SIGTERM lands everybody first; the second one ends
    at once. With `tls` the swarm's messages are encrypted, with keys made for this survey. `commands` says which
    programs the parts are.
    """
    check_drones((drone.id for drone in survey.drones), kills, freezes)
    if tls:
        check_library()
    directory = launch.make_directory(
        out, survey.config.name, datetime.datetime.now(datetime.UTC).astimezone()
    )
    prepared = launch.prepare(survey, directory, tls=tls)
    interrupts = Interrupts()
    began_s = time.monotonic()
    with interrupts.watched(), Processes(directory) as processes:
        launch.start(prepared, processes, commands)
        end = _conduct(survey, prepared, processes, interrupts, kills, freezes)
        stubborn = processes.stop()
    prepared.clock.unlink(missing_ok=True)
    prepared.places.unlink(missing_ok=True)
    log = end.watch.log()
    flown = summary.summarise(
        survey.config.name,
        prepared.draft.fleet,
        make_world(prepared.draft.fleet).gas.source_ned_m,
        survey.geofence,
        survey.config.limits.separation_m,
        make_layout(survey.config.formation.layout, survey.config.formation.spacing_m),
        read_tracks(prepared.truth),
        log,
        summary.Ending(
            outcome=str(end.finish.outcome),
            reason=end.finish.reason,
            alive=frozenset(end.supervisor.awake),
            kills=end.supervisor.kills,
            freezes=tuple(end.supervisor.freezes),
            radio=None if prepared.draft.radio is None else prepared.draft.radio.model,
            encrypted=tls,
            lost_processes=end.lost,
            speedup_reached=end.speedup_reached,
            wall_s=time.monotonic() - began_s,
            log_dir=_shown(directory),
            warnings=(
                *survey.warnings,
                *(
                    f"drone {kill.drone}'s agent was not killed at {kill.at_s:g} s: it or the survey had ended"
                    for kill in kills
                    if kill.drone not in end.supervisor.kills
                ),
                *_undone(freezes, end.supervisor.freezes),
                *(f"{name} had to be killed at the end" for name in stubborn),
                *_too_slow(log),
                *(f"{n} unreadable messages: {problem}" for problem, n in end.watch.unreadable.items()),
            ),
        ),
    )
    summary.write(flown, directory)
    (directory / "log.json").write_bytes(msgspec.json.encode(log))
    return Flown(flown, log, directory, end.finish.bad_input)


def write_report(survey: Survey, flown: Flown) -> pathlib.Path:
    """Draw `report.html` from what a survey left in its directory."""
    from simvehicle.survey import report

    report.write(
        survey, flown.summary, read_tracks(flown.directory / "truth.csv"), flown.log, flown.directory
    )
    return flown.directory / "report.html"


def words(flown: summary.Summary) -> str:
    """The summary in a few lines for a person."""
    lines = [f"{flown.outcome}: {flown.reason}"]
    if flown.time_to_source_s is not None:
        contact = (
            "" if flown.time_to_contact_s is None else f"contact after {flown.time_to_contact_s:.0f} s, "
        )
        error = "" if flown.source_error_m is None else f", {flown.source_error_m:.1f} m off"
        known = "" if flown.source_sd_m is None else f", standard deviation told {flown.source_sd_m:.1f} m"
        lines.append(f"{contact}source after {flown.time_to_source_s:.0f} s{error}{known}")
    separation = (
        "" if flown.min_separation_m is None else f", smallest separation {flown.min_separation_m:.1f} m"
    )
    clearance = (
        ""
        if flown.min_clearance_m is None
        else f", {flown.min_clearance_m:.1f} m from an obstacle at the nearest"
        + (f" ({flown.obstacles_touched} touched)" if flown.obstacles_touched else "")
    )
    lines.append(
        f"{flown.alive} of {flown.drones} drones alive, {flown.heals} heals, {flown.fence_breaches} fence breaches"
        f"{separation}{clearance}, {flown.missed_deadline_fraction:.2%} of deadlines missed"
    )
    lines += [
        f"drone {f.drone}: agent frozen at {f.at_s:.0f} s"
        + (" and not woken again" if f.until_s is None else f", woken at {f.until_s:.0f} s")
        for f in flown.freezes
    ]
    lines += [healing.words for healing in flown.healings]
    lines += [rejoin.words for rejoin in flown.rejoined]
    lines += [f"drone {orphan.drone}: {orphan.story}" for orphan in flown.orphans]
    told = {orphan.drone for orphan in flown.orphans}
    lines += [
        f"drone {d.drone}: came down {d.home_distance_m:.1f} m from its home, in {d.last_mode}"
        for d in flown.per_drone
        if d.away and d.drone not in told
    ]
    if flown.radio is not None or flown.encrypted:
        radio = (
            ""
            if flown.radio is None
            else f" through the survey's radio ({flown.radio.loss:.0%} lost everywhere)"
        )
        lines.append(f"messages were heard{radio}{', encrypted' * flown.encrypted}")
    lines += [*flown.lost_processes, *flown.warnings]
    reached = "" if flown.speedup_reached is None else f" ({flown.speedup_reached:.1f} times real time)"
    lines.append(
        f"{flown.simulated_s:.0f} s simulated in {flown.wall_s:.0f} s{reached}; everything is in {flown.log_dir}"
    )
    return "\n".join(lines)


class _End(msgspec.Struct, frozen=True):
    """How the conducting ended."""

    watch: SurveyWatch
    supervisor: Supervisor
    finish: Finish
    lost: tuple[str, ...]
    speedup_reached: float | None


def _conduct(
    survey: Survey,
    prepared: launch.Prepared,
    processes: Processes,
    interrupts: Interrupts,
    kills: tuple[Kill, ...],
    freezes: tuple[Freeze, ...],
) -> _End:
    """The loop: hear, see, decide, do; until the supervisor says that it is over, and a moment longer."""
    watch = SurveyWatch([drone.id for drone in survey.drones], prepared.draft.drones[0].tick_hz)
    supervisor = Supervisor(
        watch,
        launcher=LAUNCHER,
        survey=prepared.directory.name,
        time_limit_s=survey.config.time_limit_s,
        kills=kills,
        freezes=freezes,
    )
    own = prepared.slot(LAUNCHER)
    assert own is not None  # noqa: S101 (the launcher follows the clock)
    lost: list[str] = []
    finish: Finish | None = None
    with contextlib.ExitStack() as open_ends:
        transport = _join(prepared)
        open_ends.callback(transport.close)
        clock = ClockCells(prepared.clock)
        open_ends.callback(clock.close)
        open_ends.callback(_leave, clock, prepared, LAUNCHER)
        truth = TruthTail(prepared.truth)
        open_ends.callback(truth.close)
        display = open_ends.enter_context(progress.make_progress(watch, supervisor, survey.config.speedup))
        began_s = time.monotonic()
        moving: tuple[float, float] | None = (
            None  # when the simulated time was first seen to move: (it, wall)
        )
        until_wall_s = math.inf
        while (wall_s := time.monotonic()) < until_wall_s:
            now_s = clock.values[0]
            if moving is None and now_s > 0.0:
                moving = (now_s, wall_s)
            for received in transport.receive():
                watch.hear(now_s, received.topic, received.payload)
            watch.see(now_s, truth.read())
            ended = processes.ended()
            for one in ended:
                lost.append(str(one))
                _leave(clock, prepared, one.name)
            if finish is None:
                for action in supervisor.step(now_s, wall_s, ended, interrupted=interrupts.asked):
                    match action:
                        case Give(command):
                            transport.publish(COMMAND, COMMAND.codec.encode(command))
                        case KillAgent(drone):
                            processes.kill(agent_name(drone))
                            _leave(clock, prepared, agent_name(drone))
                        case FreezeAgent(drone):
                            # Only what stands still can no longer renew its promise.
                            if processes.freeze(agent_name(drone)):
                                _leave(clock, prepared, agent_name(drone))
                        case WakeAgent(drone):
                            _wait_for(clock, prepared, agent_name(drone))
                            processes.wake(agent_name(drone))
                        case Finish():
                            finish = action
                            until_wall_s = wall_s + (
                                LINGER_WALL_S if watch.first_takeoff_s is not None else 0.0
                            )
                            watch.note(now_s, Severity.INFO, "end", f"{action.outcome}: {action.reason}")
            note = "landing everybody; Ctrl-C again ends at once" if interrupts.asked else ""
            display.show(now_s, wall_s=wall_s - began_s, note=note)
            clock.values[own] = now_s + HEARD_WITHIN_S
            time.sleep(min(PERIOD_WALL_S, 0.4 * HEARD_WITHIN_S / survey.config.speedup))
        assert finish is not None  # noqa: S101 (the loop ends no other way)
        reached = None if moving is None else (clock.values[0] - moving[0]) / (time.monotonic() - moving[1])
    return _End(watch, supervisor, finish, tuple(lost), reached)


def _too_slow(log: Log) -> list[str]:
    """Missed deadlines although everybody is waited for: some process hung, or did not follow the clock."""
    missed = log.late_ticks / max(log.ticks, 1)
    return [] if missed <= MISSED_LIMIT else [f"{missed:.1%} of the agents' deadlines were missed"]


def _leave(clock: ClockCells, prepared: launch.Prepared, process: str) -> None:
    """The dead are not waited for."""
    slot = prepared.slot(process)
    if slot is not None:
        clock.leave(slot)


def _wait_for(clock: ClockCells, prepared: launch.Prepared, process: str) -> None:
    """Simulated time waits for one that left the clock and comes again."""
    slot = prepared.slot(process)
    if slot is not None:
        clock.values[slot] = clock.values[0]


def _undone(asked: tuple[Freeze, ...], done: list[Freeze]) -> list[str]:
    """What of the freezes the end of the agent or of the survey forestalled."""
    told = []
    for drone in sorted({freeze.drone for freeze in asked}):
        wanted = sorted(f.at_s for f in asked if f.drone == drone)
        happened = sum(f.drone == drone for f in done)
        told += [
            f"drone {drone}'s agent was not frozen at {at_s:g} s: it or the survey had ended"
            for at_s in wanted[happened:]
        ]
    return told


def _join(prepared: launch.Prepared) -> Transport:
    """Join the swarm. Imported late: zenoh starts threads, and the children are started before them."""
    from flightstack.transport.zenoh_transport import ZenohTransport

    return ZenohTransport(
        prepared.draft.ground.swarm.name,
        LAUNCHER,
        listen=(),
        connect=prepared.draft.ground.swarm.connect,
        receives=RECEIVES,
        tls=prepared.draft.launcher_tls,
        members=prepared.draft.ground.swarm.members,
    )


def _shown(directory: pathlib.Path) -> str:
    """The directory as the user would write it, from where they are."""
    with contextlib.suppress(ValueError):
        return os.fspath(directory.relative_to(pathlib.Path.cwd()))
    return os.fspath(directory)
