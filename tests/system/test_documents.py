"""Every command of README.md and docs/ is run, every link and path in them leads somewhere.

The commands run as they stand there, in a directory with copies of the examples, next to a field of three simulated
drones with their agents and a ground station. What cannot stay as it is (addresses, ports, what takes minutes)
is changed by the tables below and by nothing else. A command that no table foresees is simply run.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import pathlib
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence

import click
import pytest
import typer
import yaml
from typer.testing import CliRunner

import flightstack.cli
import gcs.cli.main
import simvehicle.cli.main
from simvehicle.survey.ports import free_ports

pytestmark = [pytest.mark.system, pytest.mark.timeout(900)]

REPOSITORY = pathlib.Path(__file__).parents[2]
PROGRAMS = {
    "flightstack": flightstack.cli.app,
    "gcs": gcs.cli.main.app,
    "simvehicle": simvehicle.cli.main.app,
}
DOCUMENTS = (REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md")))
DRONES = (1, 2, 3)
PATIENCE_S = 400.0
"""For what a quiet machine does in seconds: no test may fail because others use the machine as well."""

SERVICES = {
    "flightstack run": "ready: autopilot on",
    "flightstack sensors read": "ppm",
    "gcs serve": "ground station ground of swarm crater ready",
    "gcs watch": "3 of 3 live",
    "simvehicle run": "Ctrl-C ends it",
}
"""Commands that run until Ctrl-C, with what they show when they are up; then they must end with exit code 0."""

CHANGED = {
    "udpin:0.0.0.0:14560": "{operator_link}",
    "/dev/ttysba5": "{bench_port}",
    "flightstack sensors doctor": "flightstack sensors doctor --port {bench_port} --seconds 20",
    "simvehicle run --count": "simvehicle run --companion-port {spare} --ground-port {spare} --count",
    # The drones of this field may be in the air by then.
    "plan clear": "plan clear --force",
    "fence clear": "fence clear --force",
    # One agent's, that has ended: the other grows with everything that is tested before.
    "flights/drone-1-*.mcap": "$(ls -tr flights/drone-1-*.mcap | head -1)",
    # The same command with fewer trials: the documented ones take minutes of both cores.
    "--trials 3000": "--trials 5",
    "--trials 1000": "--trials 5",
    "--trials 100 ": "--trials 5 ",
    "--full": "--quick --trials 5",
    "fluxo-3 --quick": "fluxo-3 --worlds 1 --trials 1 --sizes 3 --strategies casting",
    "fluxo-3 --worlds 9 --trials 4": "fluxo-3 --worlds 1 --trials 1 --sizes 3 --strategies casting",
    "forces-small --seed 1": "forces-small --worlds 1 --trials 1 --sizes 5 --strategies upwind --seed 1",
    "forces-large --seed 1": "forces-large --worlds 1 --trials 1 --sizes 10 --strategies upwind --seed 1",
    "fluxo-1 --seed 1": "fluxo-1 --worlds 1 --trials 1 --seed 1",
    "locus-2 --quick --strategies": "locus-2 --sizes 5 --trials 5 --strategies",
    "--rates 1e-6,1e-5,1e-4 --json": "--rates 1e-6,1e-5,1e-4 --trials 5 --json",
    # Where nothing is overwritten; a copy of the sources, because building leaves files behind.
    "pip install .": "python -m pip install --quiet --no-deps --target installed {sources}",
}
"""What in a command is written differently here, and how: with the addresses of the field."""

AIRBORNE = ("gcs survey pause", "gcs survey resume", "gcs survey abort", "gcs survey rtl", "gcs survey land")
"""Commands that are for drones that fly."""

REPEATED = ("gcs status", "gcs survey")
"""Commands that say "nobody is heard" or "no answer" when the machine is too busy: given again, as a person would."""


def blocks(path: pathlib.Path) -> Iterator[tuple[str, str]]:
    """Language and text of every fenced block."""
    for match in re.finditer(
        r"^( *)```(\w*)\n(.*?)^\1```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ):
        yield match[2], textwrap.dedent(match[3])


def commands(text: str) -> Iterator[str]:
    """The commands of a block: continued lines joined, comments left out."""
    for line in text.replace("\\\n", " ").splitlines():
        command = re.sub(r"(^|\s)#.*", "", line).strip()
        if command:
            yield command


def documented() -> list[str]:
    """Every command once, in the order in which a person reads them."""
    found = (
        c for path in DOCUMENTS for language, text in blocks(path) if language == "sh" for c in commands(text)
    )
    return list(dict.fromkeys(found))


COMMANDS = documented()


def shell(command: str) -> list[str]:
    """A shell that runs a command with this environment's programs."""
    programs = pathlib.Path(sys.executable).parent
    return ["bash", "-c", f'PATH={shlex.quote(str(programs))}:"$PATH"; {command}']


def becoming(command: str) -> list[str]:
    """The same, but the shell becomes the program, so that signals reach it."""
    return shell(f"exec {command}")


def service_of(command: str) -> str | None:
    """Which of SERVICES a command is."""
    endless = (name for name in SERVICES if command.startswith(name))
    return next(endless, None) if "--seconds" not in command else None


@dataclasses.dataclass
class Field:
    """A directory with everything that the documents name, and the processes that their commands talk to."""

    directory: pathlib.Path
    names: dict[str, str]
    """What CHANGED fills in."""
    services: tuple[str, ...]
    """The commands whose processes the others talk to, in the order of starting."""
    running: dict[str, subprocess.Popen[bytes]] = dataclasses.field(default_factory=dict)

    def mend(self) -> None:
        """Start what does not run: at first all, later what a test has ended or what has failed in one."""
        missing = [c for c in self.services if c not in self.running or self.running[c].poll() is not None]
        for command in missing:
            self.start(command)
        if missing:
            until(self.all_live)

    def written(self, command: str) -> str:
        """A documented command with this field's addresses."""
        for old, new in CHANGED.items():
            command = command.replace(old, new.format_map(self.names))
        return command

    def run(self, command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            shell(command), cwd=self.directory, capture_output=True, text=True, timeout=PATIENCE_S
        )

    def start(self, command: str) -> None:
        """Start a process that stays, and wait until its output says that it is up."""
        log = self.directory / f"{len(list(self.directory.glob('*.log')))}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                becoming(command), cwd=self.directory, stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        self.running[command] = process
        name = service_of(command)
        assert name is not None
        sign = SERVICES[name]
        until(lambda: sign in log.read_text() or process.poll() is not None)
        assert process.poll() is None, f"{command}: {log.read_text()}"

    def end(self, command: str) -> None:
        """End one as a person would; one that does not is killed."""
        process = self.running.pop(command)
        process.send_signal(signal.SIGINT)
        try:
            process.wait(120.0)  # an agent in the air comes home first
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(20.0)

    def drones(self) -> list[dict[str, object]]:
        """What `gcs status` says of each drone."""
        done = self.run("gcs status --config examples/ground.yaml --seconds 2 --json")
        return json.loads(done.stdout)["drones"] if done.returncode == 0 else []

    def all_live(self) -> bool:
        found = self.drones()
        return len(found) == len(DRONES) and all(d["agent"] == d["vehicle"] == "live" for d in found)

    def all_fly(self) -> bool:
        found = self.drones()
        return len(found) == len(DRONES) and all(drone["airborne"] for drone in found)

    def started_again(self) -> bool:
        """Whether all fly. If not, those on the ground are started: others may be on their way home just now."""
        if self.all_fly():
            return True
        self.run("gcs survey start --config examples/ground.yaml")
        return False

    def close(self) -> None:
        for process in self.running.values():
            process.kill()
            process.wait(20.0)


def until(condition: Callable[[], object], limit_s: float = PATIENCE_S) -> None:
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s, f"it never happened: {condition}"
        time.sleep(0.2)


def rewritten(path: pathlib.Path, target: pathlib.Path, changes: dict[str, object]) -> None:
    """An example with other values at dotted places."""
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    for place, value in changes.items():
        *outer, last = [int(part) if part.isdigit() else part for part in place.split(".")]
        section = content
        for part in outer:
            section = section[part]
        section[last] = value
    target.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def write_field(directory: pathlib.Path) -> dict[str, str]:
    """Copies of examples/ and of what else the documents name; returns what CHANGED fills in."""
    shutil.copytree(REPOSITORY / "examples", directory / "examples")
    shutil.copyfile(REPOSITORY / "tests" / "data" / "plans" / "crater.plan", directory / "mission.plan")
    sources = directory / "sources"
    sources.mkdir()
    for package in ("mission", "sensors", "flightstack", "gcs", "simvehicle"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(REPOSITORY / package, sources / package, ignore=ignored)
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copyfile(REPOSITORY / file, sources / file)

    count = len(DRONES)
    udp = free_ports(socket.SOCK_DGRAM, count + 3)
    companions, (ground, operator, spare) = udp[:count], udp[count:]
    tcp = free_ports(socket.SOCK_STREAM, 2 * count + 2)
    endpoints = [f"tcp/127.0.0.1:{port}" for port in tcp[: count + 1]]
    *instruments, bench = [f"127.0.0.1:{port}" for port in tcp[count + 1 :]]
    common = {"swarm.members": list(DRONES)}
    example = REPOSITORY / "examples" / "drone.yaml"
    for index, drone in enumerate(DRONES):
        own = {
            "drone": drone,
            "swarm.listen": [endpoints[1 + index]],
            "swarm.connect": [endpoints[0], endpoints[1 + (index + 1) % count]],  # ground station and a peer
            "autopilot.link": f"udpin:127.0.0.1:{companions[index]}",
            "instruments.0.port": f"socket://{instruments[index]}",
        }
        name = "drone.yaml" if drone == 1 else f"drone-{drone}.yaml"
        rewritten(example, directory / "examples" / name, common | own)
    own = {"swarm.listen": endpoints[:1], "mavlink.links": [f"udpin:127.0.0.1:{ground}"]}
    rewritten(REPOSITORY / "examples" / "ground.yaml", directory / "examples" / "ground.yaml", common | own)
    fleet = {
        "origin": yaml.safe_load(example.read_text(encoding="utf-8"))["origin"],
        "ready_after_s": 5.0,
        "vehicles": [
            {
                "id": drone,
                "home_east_m": 8.0 * index,
                "links": [f"udpout:127.0.0.1:{port}" for port in (companions[index], ground, operator)],
                "instruments": [{"name": "co2", "type": "sba5", "port": instruments[index]}],
            }
            for index, drone in enumerate(DRONES)
        ],
    }
    fleet["vehicles"][0]["instruments"].append({"name": "bench", "type": "sba5", "port": bench})
    (directory / "fleet.yaml").write_text(yaml.safe_dump(fleet), encoding="utf-8")
    return {
        "operator_link": f"udpin:127.0.0.1:{operator}",
        "bench_port": f"socket://{bench}",
        "spare": str(min(spare, 65000)),
        "sources": str(sources),
    }


@pytest.fixture(scope="module")
def kept_field(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Field]:
    directory = tmp_path_factory.mktemp("field")
    agents = ("drone", *(f"drone-{drone}" for drone in DRONES[1:]))
    services = (
        "simvehicle run --config fleet.yaml",
        "gcs serve --config examples/ground.yaml",
        *(f"flightstack run --config examples/{agent}.yaml" for agent in agents),
    )
    with contextlib.closing(Field(directory, write_field(directory), services)) as field:
        yield field


@pytest.fixture
def field(kept_field: Field) -> Field:
    """The field with everything running, whatever became of it in the test before."""
    kept_field.mend()
    return kept_field


def of(names: Sequence[str]) -> list[str]:
    """The documented commands that begin with one of these."""
    return [command for command in COMMANDS if command.startswith(tuple(names))]


def words(commands: Sequence[str]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("command", commands, ids=commands)


ELSEWHERE = ("make ", "simvehicle fly ")
LASTING = [command for command in COMMANDS if service_of(command)]


@words(LASTING)
def test_a_documented_service_runs_until_ctrl_c(command: str, field: Field, open_terminal) -> None:
    if command in field.running:
        field.end(command)
    terminal = open_terminal(*becoming(field.written(command)), cwd=field.directory)
    name = service_of(command)
    assert name is not None
    until(lambda: SERVICES[name].encode() in terminal.output or terminal.process.poll() is not None)
    assert terminal.process.poll() is None, terminal.output
    terminal.process.send_signal(signal.SIGINT)
    assert terminal.finish(PATIENCE_S) == 0, terminal.output
    assert b"Traceback" not in terminal.output


@words([c for c in COMMANDS if c not in LASTING and not c.startswith(ELSEWHERE)])
def test_a_documented_command_does_its_work(command: str, field: Field) -> None:
    if command.startswith(AIRBORNE):
        until(field.started_again)
    written = field.written(command)
    done = field.run(written)
    for _ in range(5 if command.startswith(REPEATED) else 0):
        if done.returncode != 0:
            done = field.run(written)
    assert done.returncode == 0, f"{written}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr


def flown(command: str, known: Sequence[str]) -> bool:
    """Whether test_fly_survey.py flies this command; `--json` only says how the same flight is told."""
    return command.removesuffix(" --json") in {one.removesuffix(" --json") for one in known}


@words(of(["simvehicle fly "]))
def test_a_documented_survey_is_flown(command: str, flown_commands: tuple[str, ...]) -> None:
    assert flown(command, flown_commands), f"add it to FLOWN in conftest.py: {command}"


@words(of(["make "]))
def test_a_documented_target_is_there(command: str, flown_commands: tuple[str, ...]) -> None:
    done = subprocess.run(
        ["bash", "-c", command.replace("make ", "make --dry-run ", 1)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    flights = re.findall(r"\bsimvehicle fly .*", done.stdout)
    assert all(flown(flight, flown_commands) for flight in flights)
    assert flights or command != "make fly"


def test_commands_are_found_wherever_they_stand(tmp_path: pathlib.Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "1. So:\n\n   ```sh\n   a --b \\\n     c  # why\n   # only words\n   d\n   ```\n\n```\nno sh\n```\n"
    )
    (language, text), (other, _) = blocks(page)
    assert (language, other) == ("sh", "")
    assert [command.split() for command in commands(text)] == [["a", "--b", "c"], ["d"]]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_what_a_document_names_is_there(path: pathlib.Path) -> None:
    text = path.read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!\w+:|#)([^)#\s]+)", text)
    missing = [link for link in links if not (path.parent / link).exists()]
    named = re.findall(
        r"`((?:mission|sensors|flightstack|gcs|simvehicle|tests|docs|examples|benchmarks)/[\w./-]*)`", text
    )
    missing += [name for name in named if not (REPOSITORY / name).exists()]
    assert not missing
    for language, block in blocks(path):
        unmarked = (
            [] if language else [c for c in commands(block) if c.split()[0] in {*PROGRAMS, "make", "pip"}]
        )
        assert not unmarked, "commands stand in blocks marked sh, so that they are run here"


def verbs(command: click.Command, *path: str) -> Iterator[tuple[str, ...]]:
    """A command and all under it, by their names."""
    yield path
    for name, inner in getattr(command, "commands", {}).items():
        yield from verbs(inner, *path, name)


HELP = [(program, *path) for program, app in PROGRAMS.items() for path in verbs(typer.main.get_command(app))]


@pytest.mark.parametrize("arguments", HELP, ids=" ".join)
def test_every_command_explains_itself(arguments: tuple[str, ...]) -> None:
    program, *path = arguments
    done = CliRunner().invoke(PROGRAMS[program], [*path, "--help"])
    assert done.exit_code == 0
    assert "Usage:" in done.output


@pytest.mark.parametrize("program", PROGRAMS)
def test_programs_are_installed(program: str) -> None:
    done = subprocess.run(shell(f"{program} --help"), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for (first, *path) in HELP if first == program for name in path[:1])


def test_the_examples_are_good_as_they_are() -> None:
    for command in of(["flightstack check"]):
        done = subprocess.run(shell(command), cwd=REPOSITORY, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
