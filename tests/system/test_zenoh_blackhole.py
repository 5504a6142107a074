"""Nodes that vanish without a word, on network stacks of their own: the others must go on hearing each other."""

from __future__ import annotations

import json
import pathlib
import subprocess
import sys

import pytest

NAMESPACE = ["unshare", "--map-root-user", "--net"]
SCRIPT = pathlib.Path(__file__).with_name("zenoh_blackhole.py")


def namespaces_work() -> bool:
    try:
        probe = subprocess.run(
            [*NAMESPACE, "ip", "link", "add", "probe", "type", "veth"], capture_output=True, timeout=20
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return probe.returncode == 0


@pytest.mark.system
@pytest.mark.optional
def test_vanished_nodes_are_missed_silence_nobody_and_come_back():
    if not namespaces_work():
        pytest.skip("needs unshare, iproute2 and the right to make network namespaces")
    done = subprocess.run(
        [*NAMESPACE, sys.executable, str(SCRIPT)], capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["missed"]
    # 20 ticks a second: a lingering connection would make one of them deaf for 200.
    assert max(result["silence_ticks"]) < 100
