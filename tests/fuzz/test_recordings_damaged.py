"""Damaged flight recordings: the records up to the first that is not whole, or one line why there is none."""

from __future__ import annotations

import functools
import math
import pathlib

import msgspec
import mutations
from interference import hovering
from reader import assert_tried, reading
from trial import run_cases

from flightstack.agent import Inputs, Outputs
from flightstack.mavlink.framing import FrameFinder
from flightstack.recording.agent_recording import AgentRecording
from flightstack.recording.recorder import read_recording
from flightstack.recording.replay import replay

DATA = pathlib.Path(__file__).parent.parent / "data"


@functools.cache
def flown(directory: pathlib.Path) -> bytes:
    """The recording of ten ticks of an agent in flight."""
    flight = hovering()
    config = flight.members[1].config
    recording = AgentRecording(
        msgspec.structs.replace(config, record_to=str(directory)), 1, 0.0, "drone.yaml"
    )

    def record(drone: int, now_s: float, inputs: Inputs, outputs: Outputs) -> None:
        if drone == 1:
            recording.tick(now_s, inputs, outputs)

    flight.tap = record
    flight.run(1.0)
    recording.close()
    return recording.path.read_bytes()


def test_a_damaged_recording(cases: int, tmp_path: pathlib.Path) -> None:
    mutator = mutations.Mutator("mcap", [flown(tmp_path)])

    def take(path: pathlib.Path) -> None:
        for record in read_recording(path):
            assert math.isfinite(record.time_s)
            assert math.isfinite(record.wall_s)
            assert isinstance(record.message, dict)
        replay(path)

    assert_tried(run_cases(cases, mutator.case, reading(tmp_path / "case.mcap", take)))


def test_a_damaged_tlog(cases: int) -> None:
    """What is behind the damage is found again: a log that lost some of its bytes has still all other frames."""
    whole = (DATA / "px4-1.16-dev-flight.tlog").read_bytes()[:20_000]
    frames = {frame.data for frame in FrameFinder().find(whole)}
    mutator = mutations.Mutator("tlog", [whole], (mutations.flip, mutations.cut, mutations.insert))

    def read(data: bytes) -> str:
        found = {frame.data for frame in FrameFinder().find(data + bytes(300))}
        # A case has at most six damages of at most 4096 bytes and 20 flips each; most have one.
        assert len(frames - found) < len(frames)
        return "all" if frames <= found else "most"

    outcomes = run_cases(cases, mutator.case, read)
    assert outcomes["most"]
