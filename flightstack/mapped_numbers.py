"""Numbers that the processes of a simulated flight share: a small file that all map into memory.

Doubles in the machine's own order. Each number has one writer; an aligned double is read and written in one
instruction.
"""

from __future__ import annotations

import mmap
import pathlib

from mission.documents.yaml_file import DocumentError

NUMBER_BYTES = 8


class MappedNumbers:
    """The numbers of such a file, as `values`."""

    def __init__(self, path: str | pathlib.Path, what: str) -> None:
        """`DocumentError` where the file is not there or is empty; `what` says what it should have held."""
        try:
            with pathlib.Path(path).open("r+b") as file:
                self._map = mmap.mmap(file.fileno(), 0)
        except (OSError, ValueError) as error:
            raise DocumentError(str(path), f"{what}: {error}; its launcher makes it") from error
        self.values = memoryview(self._map).cast("d")

    def close(self) -> None:
        self.values.release()
        self._map.close()
