"""Rows on disk: finished work is never lost and never done twice, however a run ends.

A run's directory holds `run.json` (what the run is) and one Parquet file a finished block of trials, each written
beside and renamed, so that a file is there whole or not at all. A run that was killed goes on with the blocks
that are missing.
"""

from __future__ import annotations

import errno
import os
import pathlib
from typing import Any

import msgspec
import pandas as pd

from simvehicle.trials.outcome import engine_of
from simvehicle.trials.trials_error import TrialsError


class Run(msgspec.Struct, frozen=True):
    """What rows must have in common to be put together."""

    name: str
    seed: int
    trials: int
    block: int
    cells: tuple[Any, ...]
    """Structs, one a cell: `simvehicle.trials.cell.Cell`, or those of another kind of trials (`batch.Trials`)."""
    engine: str = ""
    """Of the code that computes the rows; empty: as it is now, for cells of `Cell`."""

    def __post_init__(self) -> None:
        if not self.engine:
            msgspec.structs.force_setattr(self, "engine", engine_of(self.cells))


class Block(msgspec.Struct, frozen=True):
    """Some successive trials of one cell: the unit of work, of spreading and of resuming."""

    cell: int
    first: int
    count: int

    @property
    def file(self) -> str:
        return f"cell-{self.cell:04d}-{self.first:06d}.parquet"


def blocks(run: Run) -> list[Block]:
    """All of a run's work, in order."""
    return [
        Block(cell, first, min(run.block, run.trials - first))
        for cell in range(len(run.cells))
        for first in range(0, run.trials, run.block)
    ]


class Store:
    """The directory of one run."""

    def __init__(self, directory: pathlib.Path, run: Run) -> None:
        self._directory = directory
        self._parts = directory / "rows"
        self._run = run
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            self._check_or_write(directory / "run.json")
            for leftover in self._parts.glob("*.part"):
                leftover.unlink()
        except OSError as error:
            raise _disk_error(directory, error) from error

    def _check_or_write(self, path: pathlib.Path) -> None:
        if not path.exists():
            if any(self._parts.iterdir()):
                raise TrialsError(f"{self._parts}: rows without {path.name}; choose another directory")
            _write_whole(path, msgspec.json.format(msgspec.json.encode(self._run)) + b"\n")
            return
        try:
            before = _plain(msgspec.json.decode(path.read_bytes(), type=Run))
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise TrialsError(f"{path}: not the description of a run: {error}") from error
        now = _plain(self._run)
        differs = [field for field in Run.__struct_fields__ if before[field] != now[field]]
        if not differs:
            return
        raise TrialsError(
            f"{path}: holds the results of another experiment ({before['name']}; {', '.join(differs)} "
            "differ); choose another directory with --out or remove this one"
        )

    def missing(self) -> list[Block]:
        """The blocks that are still to be done."""
        there = {path.name for path in self._parts.glob("*.parquet")}
        return [block for block in blocks(self._run) if block.file not in there]

    def add(self, block: Block, rows: pd.DataFrame) -> None:
        """Keep a finished block. `TrialsError` when the disk is full; what was kept before stays."""
        path = self._parts / block.file
        part = path.with_suffix(".part")
        try:
            rows.to_parquet(part, index=False)
            os.replace(part, path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise _disk_error(path, error) from error

    def rows(self) -> pd.DataFrame:
        """All rows in order, whoever made them in whatever order. Every block must be there."""
        frames = []
        for block in blocks(self._run):
            path = self._parts / block.file
            try:
                frames.append(pd.read_parquet(path))
            except (OSError, ValueError) as error:
                raise TrialsError(f"{path}: cannot be read ({error}); remove it and run again") from error
        return pd.concat(frames, ignore_index=True)


def _plain(run: Run) -> dict[str, Any]:
    """A run as its file has it: its cells may be of any struct."""
    fields: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(run))
    return fields


def _write_whole(path: pathlib.Path, data: bytes) -> None:
    part = path.with_suffix(".part")
    part.write_bytes(data)
    os.replace(part, path)


def _disk_error(path: pathlib.Path, error: OSError) -> TrialsError:
    if error.errno == errno.ENOSPC:
        return TrialsError(
            f"{path}: no space left on the disk; free some and run the same command again: finished trials "
            "are kept"
        )
    return TrialsError(f"{path}: {error.strerror or error}")
