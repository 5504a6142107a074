"""`python -m benchmarks [NAME...]`: run the benchmarks of this directory, or those that are named.

Each is a module with `main()`, which prints what it measured and leaves with an error where it misses its target.
Each runs in a process of its own, so that none measures what another has imported or left behind.
"""

from __future__ import annotations

import argparse
import os
import pathlib
import pkgutil
import platform
import subprocess
import sys
import time

DIRECTORY = pathlib.Path(__file__).parent


def names() -> list[str]:
    return sorted(
        module.name for module in pkgutil.iter_modules([str(DIRECTORY)]) if module.name != "__main__"
    )


def machine() -> str:
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return (
        f"{platform.machine()} {platform.system()}, {cores} cores, load {load}, "
        f"{platform.python_implementation()} {platform.python_version()}"
    )


def run(name: str) -> bool:
    """Whether the benchmark ended without an error and met its targets."""
    print(f"\n== {name}", flush=True)
    began_s = time.monotonic()
    code = subprocess.run(
        [sys.executable, "-c", f"from benchmarks.{name} import main; main()"],
        cwd=DIRECTORY.parent,
        stdin=subprocess.DEVNULL,
        check=False,
    ).returncode
    print(
        f"   {'done' if code == 0 else f'FAILED (exit code {code})'} in {time.monotonic() - began_s:.0f} s",
        flush=True,
    )
    return code == 0


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Measure, and compare with the targets."
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"one of: {', '.join(names())} (default: all)"
    )
    chosen = parser.parse_args().names or names()
    unknown = sorted(set(chosen) - set(names()))
    if unknown:
        parser.error(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(names())}")
    print(machine())
    failed = [name for name in chosen if not run(name)]
    print(
        f"\n{len(chosen) - len(failed)} of {len(chosen)} benchmarks ok"
        + (f"; failed: {', '.join(failed)}" if failed else "")
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
