"""What `flightstack replay` says of a recording that this version cannot answer as it was answered then."""

from __future__ import annotations

import pathlib
from typing import Any

import pytest

from flightstack.agent import Agent, Inputs
from flightstack.config_file import load
from flightstack.recording.fingerprint import fingerprint
from flightstack.recording.recorder import GAP, FlightRecorder
from flightstack.recording.replay import ReplayError, replay
from flightstack.swarm.wire import VERSION

EXAMPLE = pathlib.Path(__file__).parents[4] / "examples" / "drone.yaml"


def recording(directory: pathlib.Path, **about: Any) -> pathlib.Path:
    """Two ticks of a drone on the ground, told to be `about` what they were made with."""
    config = load(EXAMPLE)
    agent = Agent(config, incarnation=7)
    recorder = FlightRecorder(directory / "drone-1.mcap")
    recorder.record("/config", 0.0, {"config": config, "incarnation": 7, **about})
    for now_s in (1.0, 1.1):
        recorder.record("/inputs", now_s, Inputs())
        recorder.record("/outputs", now_s, {"crc32": fingerprint(agent.step(now_s, Inputs()))})
    recorder.close()
    return recorder.path


def test_a_recording_of_this_version_is_flown_again(tmp_path: pathlib.Path) -> None:
    result = replay(recording(tmp_path, wire=VERSION))
    assert (result.ticks, result.differing) == (2, 0)


def test_behind_a_gap_nothing_is_compared(tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture) -> None:
    config = load(EXAMPLE)
    agent = Agent(config, incarnation=7)
    recorder = FlightRecorder(tmp_path / "drone-1.mcap")
    recorder.record("/config", 0.0, {"config": config, "incarnation": 7, "wire": VERSION})
    for now_s in (1.0, 1.1, 1.2):
        recorder.record("/inputs", now_s, Inputs())
        recorder.record("/outputs", now_s, {"crc32": fingerprint(agent.step(now_s, Inputs()))})
    recorder.record(GAP, 9.0, {"records": 140})
    recorder.record("/inputs", 9.0, Inputs())
    recorder.record("/outputs", 9.0, {"crc32": 1})
    recorder.close()
    result = replay(recorder.path)
    assert (result.ticks, result.differing) == (3, 0)
    assert "cannot be flown again" in caplog.text


@pytest.mark.parametrize(
    ("about", "then"),
    [({}, "messages older than version 3"), ({"wire": VERSION + 1}, f"messages of version {VERSION + 1}")],
)
def test_a_recording_of_another_version_is_refused_in_one_line(
    tmp_path: pathlib.Path, about: dict[str, int], then: str
) -> None:
    with pytest.raises(
        ReplayError, match=f"drone-1.mcap: was recorded with {then}.* replay it with"
    ) as caught:
        replay(recording(tmp_path, **about))
    assert "\n" not in str(caught.value)
