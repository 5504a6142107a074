"""A reader of files, and what may come of a damaged one."""

from __future__ import annotations

import pathlib
from collections.abc import Callable

from flightstack.errors import FlightstackError
from mission.documents.yaml_file import DocumentError
from sensors.instruments.sensor_error import SensorError

USER_ERRORS = (DocumentError, FlightstackError, SensorError)


def refused(error: Exception, path: pathlib.Path) -> str:
    """A user's error is one line that names the file and can be shown."""
    text = str(error)
    assert path.name in text, text
    assert text.isprintable(), text
    assert len(text) < 2000, text
    return "refused"


def reading(path: pathlib.Path, take: Callable[[pathlib.Path], None]) -> Callable[[bytes], str]:
    """Write a case to `path`, read it, and say what came of it."""

    def read(data: bytes) -> str:
        path.write_bytes(data)
        try:
            take(path)
        except USER_ERRORS as error:
            return refused(error, path)
        return "read"

    return read


def assert_tried(outcomes: dict[str, int]) -> None:
    """Both happen: damage that is no longer a file of its kind, and damage that is still one."""
    assert outcomes["read"], outcomes
    assert outcomes["refused"], outcomes
