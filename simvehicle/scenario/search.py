"""Many drawn scenarios on all cores, with a store that a later search goes on from."""

from __future__ import annotations

import concurrent.futures
import hashlib
import multiprocessing
import pathlib
import time
from collections.abc import Iterable, Iterator
from typing import Final

import msgspec

import flightstack
import mission
import sensors
import simvehicle
from mission.documents.yaml_file import DocumentError
from mission.documents.yaml_values import text_of
from simvehicle.scenario.level import LEVELS, Document
from simvehicle.scenario.scenario_result import Violation
from simvehicle.scenario.shrinking import shrunk

_WAITING: Final = 4
"""Scenarios handed to each process ahead: an end by Ctrl-C loses no more."""


class SeedResult(msgspec.Struct, frozen=True):
    level: str
    code: str
    """Identity of the code that flew it: another's results are not taken for this one's."""
    seed: int
    violations: tuple[Violation, ...]
    core_s: float
    """Processor time."""


class SearchSummary(msgspec.Struct, frozen=True):
    level: str
    seeds: int
    violations: dict[str, int]
    """By kind, in how many scenarios."""
    failing_seeds: tuple[int, ...]
    wall_s: float
    core_s: float
    """Processor time of all scenarios, those of earlier searches in the store included."""


class ResultStore:
    """A file with a line for each scenario. `DocumentError` where it cannot be read or written."""

    def __init__(self, directory: pathlib.Path, level: str, code: str) -> None:
        self._path = directory / f"{level}.jsonl"
        self._level, self._code = level, code
        self.known: dict[int, SeedResult] = {}
        try:
            directory.mkdir(parents=True, exist_ok=True)
            whole = self._read(self._path.read_bytes() if self._path.exists() else b"")
            self._file = self._path.open("ab")
            self._file.truncate(whole)
        except OSError as error:
            raise DocumentError(
                str(self._path), f"cannot be used: {error.strerror}; give another --out"
            ) from error

    def _read(self, data: bytes) -> int:
        """How many bytes are whole lines: a search that was killed leaves its last one unfinished."""
        whole = data.rfind(b"\n") + 1
        for number, line in enumerate(data[:whole].splitlines(), 1):
            try:
                result = msgspec.json.decode(line, type=SeedResult)
            except msgspec.MsgspecError as error:
                problem = "is no result of a search; remove the line or give another --out"
                raise DocumentError(str(self._path), problem, line=number) from error
            if (result.level, result.code) == (self._level, self._code):
                self.known[result.seed] = result
        return whole

    def add(self, result: SeedResult) -> None:
        self.known[result.seed] = result
        self._file.write(msgspec.json.encode(result) + b"\n")
        self._file.flush()

    def close(self) -> None:
        self._file.close()


def sources_identity() -> str:
    """16 hexadecimal digits for the sources of all that flies in a scenario."""
    digest = hashlib.sha256()
    for package in (mission, sensors, flightstack, simvehicle):
        root = pathlib.Path(package.__path__[0])
        for path in sorted(root.rglob("*.py")):
            digest.update(f"{package.__name__}/{path.relative_to(root)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def fly_seed(level: str, code: str, seed: int) -> SeedResult:
    """One drawn scenario."""
    began_s = time.process_time()
    simulation = LEVELS[level]()
    violations = simulation.run(simulation.draw(seed)).violations
    return SeedResult(level, code, seed, violations, round(time.process_time() - began_s, 3))


def search(
    level: str, code: str, seeds: Iterable[int], store: ResultStore, *, jobs: int
) -> Iterator[SeedResult]:
    """The results of the seeds that the store does not know, as they come; each is in the store by then."""
    waiting = iter([seed for seed in seeds if seed not in store.known])
    if jobs == 1:  # no other process is needed
        for seed in waiting:
            result = fly_seed(level, code, seed)
            store.add(result)
            yield result
        return
    # A copy of this process needs neither to import everything again nor to be able to run its main program twice.
    way = "fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(way)
    with concurrent.futures.ProcessPoolExecutor(jobs, mp_context=context) as pool:
        running: set[concurrent.futures.Future[SeedResult]] = set()
        while True:
            for seed in waiting:
                running.add(pool.submit(fly_seed, level, code, seed))
                if len(running) >= _WAITING * jobs:
                    break
            if not running:
                return
            done, running = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
            for future in sorted(done, key=lambda one: one.result().seed):
                store.add(future.result())
                yield future.result()


def summarized(level: str, results: Iterable[SeedResult], wall_s: float) -> SearchSummary:
    ordered = sorted(results, key=lambda result: result.seed)
    kinds: dict[str, int] = {}
    for result in ordered:
        for kind in sorted({violation.kind for violation in result.violations}):
            kinds[kind] = kinds.get(kind, 0) + 1
    failing = tuple(result.seed for result in ordered if result.violations)
    core_s = round(sum(result.core_s for result in ordered), 1)
    return SearchSummary(level, len(ordered), kinds, failing, round(wall_s, 1), core_s)


def failing(level: str, seed: int, kind: str, *, smallest: bool) -> str:
    """YAML of the scenario of `seed`, which has a violation of this kind; or the smallest made of it that has."""
    simulation = LEVELS[level]()

    def fails(document: Document) -> bool:
        return any(violation.kind == kind for violation in simulation.run(document).violations)

    drawn = simulation.draw(seed)
    return text_of(shrunk(drawn, fails) if smallest else drawn)
