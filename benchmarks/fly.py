"""The default survey end to end, as `make fly` flies it: wall time, the speed-up reached, missed deadlines."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile

from benchmarks.agent import report

SURVEY = "examples/survey.yaml"


def main() -> None:
    with tempfile.TemporaryDirectory() as out:
        flown = subprocess.run(
            [sys.executable, "-m", "simvehicle.cli", "fly", SURVEY, "--json", "--no-report", "--out", out],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            check=True,
        )
    summary = json.loads(flown.stdout.splitlines()[-1])
    print(f"{SURVEY}: {summary['outcome']}, {summary['simulated_s']:.0f} s simulated")
    report("wall time", summary["wall_s"], "s", 240.0)
    report("missed deadlines", 100.0 * summary["missed_deadline_fraction"], "%", 1.0)
    report("speed-up reached", summary["speedup_reached"], "x", None)
    report("speed-up asked for", summary["speedup"], "x", None)


if __name__ == "__main__":
    main()
