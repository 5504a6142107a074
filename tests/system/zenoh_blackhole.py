"""Six nodes on six network stacks, four of which vanish without a word, as drones do behind a crater wall.

Runs in a user and network namespace of its own (`unshare --map-root-user --net`); prints one JSON object.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import pathlib
import subprocess
import sys

ADDRESSES = [f"10.99.0.{n}" for n in range(1, 7)]
STAY = 2
"""So many stay; the others, more than zenoh has receiving threads, vanish together."""
HERE = pathlib.Path(__file__)

spec = importlib.util.spec_from_file_location("mesh", HERE.with_name("test_zenoh_mesh.py"))
assert spec is not None
assert spec.loader is not None
mesh = importlib.util.module_from_spec(spec)
spec.loader.exec_module(mesh)


def ip(*words: str, inside: int | None = None) -> None:
    enter = [] if inside is None else ["nsenter", "--target", str(inside), "--net"]
    subprocess.run([*enter, "ip", *words], check=True)


def main() -> None:
    endpoints = [f"tcp/{address}:7447" for address in ADDRESSES]
    with contextlib.ExitStack() as stack:
        ip("link", "add", "air", "type", "bridge")
        ip("link", "set", "air", "up")
        nodes = []
        for n, address in enumerate(ADDRESSES, 1):
            # `cat` holds the namespace open, says when it is there, and ends with its standard input.
            holder = subprocess.Popen(
                ["unshare", "--net", "cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            stack.callback(holder.communicate)
            assert holder.stdin is not None
            assert holder.stdout is not None
            holder.stdin.write("ready\n")
            holder.stdin.flush()
            holder.stdout.readline()
            ip("link", "add", f"air{n}", "type", "veth", "peer", "name", "radio", "netns", str(holder.pid))
            ip("link", "set", f"air{n}", "master", "air", "up")
            ip("address", "add", f"{address}/24", "dev", "radio", inside=holder.pid)
            ip("link", "set", "radio", "up", inside=holder.pid)
            wrap = ["nsenter", "--target", str(holder.pid), "--net"]
            nodes.append(mesh.NodeProcess(str(n), endpoints[n - 1], endpoints, wrap))
            stack.callback(nodes[-1].end)
        mesh.until(lambda: mesh.whole_mesh(nodes), "everybody hears everybody")
        for n in range(STAY + 1, len(ADDRESSES) + 1):
            ip("link", "set", f"air{n}", "down")
        gone_at = [node.ticks for node in nodes]
        # 15 s of ticks: longer than the 10 s for which zenoh would let the closing connection linger.
        mesh.until(
            lambda: all(n.ticks > t + 300 for n, t in zip(nodes[:STAY], gone_at, strict=False)), "time passes"
        )
        silence = [nodes[0].longest_silence["2"], nodes[1].longest_silence["1"]]
        missed = [node.alive() for node in nodes[:STAY]] == [{"2"}, {"1"}]
        for n in range(STAY + 1, len(ADDRESSES) + 1):
            ip("link", "set", f"air{n}", "up")
        mesh.until(lambda: mesh.whole_mesh(nodes), "the lost ones are back")
    sys.stdout.write(json.dumps({"silence_ticks": silence, "missed": missed}) + "\n")


if __name__ == "__main__":
    main()
