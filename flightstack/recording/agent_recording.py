"""An agent's flight on disk: everything that `flightstack.recording.replay` needs to fly it again."""

from __future__ import annotations

import pathlib

from flightstack.agent import Inputs, Outputs
from flightstack.config import DroneConfig
from flightstack.recording.background_file import make_directory
from flightstack.recording.fingerprint import fingerprint
from flightstack.recording.recorder import FlightRecorder, RecordingError, unused
from flightstack.swarm.wire import VERSION
from mission.documents.yaml_file import fault_of


class AgentRecording:
    """The configuration, then every tick: its inputs whole, and a fingerprint of what left the drone."""

    def __init__(self, config: DroneConfig, incarnation: int, now_s: float, file: str) -> None:
        """A new recording in the configured directory. What cannot be a directory raises with one clear line; a disk
        that takes nothing now does not keep an agent from its drone, and is told by `problem`."""
        directory = pathlib.Path(config.record_to)
        try:
            make_directory(directory)
            path = unused(directory / f"drone-{config.drone}-{incarnation:08x}.mcap")
            self._recorder = FlightRecorder(path)
        except OSError as error:
            problem = f"{directory} cannot be made: {error.strerror}; name another directory"
            raise fault_of(file, "record_to", problem) from error
        except RecordingError as error:
            raise fault_of(file, "record_to", str(error)) from error
        about = {"config": config, "incarnation": incarnation, "wire": VERSION}
        self._recorder.record("/config", now_s, about)

    @property
    def path(self) -> pathlib.Path:
        return self._recorder.path

    @property
    def problem(self) -> str:
        """Why the flight is not recorded now; empty when all is well."""
        return self._recorder.problem

    def tick(self, now_s: float, inputs: Inputs, outputs: Outputs) -> None:
        self._recorder.record("/inputs", now_s, inputs)
        self._recorder.record("/outputs", now_s, {"crc32": fingerprint(outputs)})
        for event in outputs.events:
            self._recorder.record("/event", now_s, event)

    def close(self) -> None:
        self._recorder.close()
