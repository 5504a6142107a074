"""The default survey end to end, as `make fly` flies it: wall time, speed-up reached, missed deadlines, memory."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
from typing import Final

import psutil

from benchmarks import Figures

SURVEY: Final = "examples/survey.yaml"
SAMPLE_S: Final = 1.0


def main() -> None:
    with (
        tempfile.TemporaryDirectory() as out,
        subprocess.Popen(
            [
                sys.executable,
                "-m",
                "simvehicle.cli.main",
                "fly",
                SURVEY,
                "--json",
                "--no-report",
                "--out",
                out,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as flight,
    ):
        resident_mb = 0.0
        while flight.poll() is None:
            resident_mb = max(resident_mb, largest_agent_mb(flight.pid))
            with contextlib.suppress(subprocess.TimeoutExpired):
                flight.wait(SAMPLE_S)
        assert flight.stdout is not None
        printed = flight.stdout.read()
    if flight.returncode != 0:
        raise SystemExit(f"{SURVEY} did not end well (exit code {flight.returncode}): {printed}")
    summary = json.loads(printed.splitlines()[-1])
    print(f"{SURVEY}: {summary['outcome']}, {summary['simulated_s']:.0f} s simulated")
    figures = Figures()
    figures.show("wall time", summary["wall_s"], "s", most=240.0)
    figures.show("missed deadlines", 100.0 * summary["missed_deadline_fraction"], "%", most=1.0)
    figures.show("speed-up reached", summary["speedup_reached"], "x")
    figures.show("speed-up asked for", summary["speedup"], "x")
    figures.show("resident memory of an agent", resident_mb, "MB", most=140.0)
    figures.leave()


def largest_agent_mb(launcher: int) -> float:
    """Resident memory of the largest agent process that flies now, with zenoh, links and recorder."""
    largest_mb = 0.0
    # A process that ends while it is looked at has no memory to report.
    with contextlib.suppress(psutil.NoSuchProcess):
        for process in psutil.Process(launcher).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                if "flightstack.cli" in process.cmdline():
                    largest_mb = max(largest_mb, process.memory_info().rss / 2**20)
    return largest_mb


if __name__ == "__main__":
    main()
