"""What a person can get wrong: one line on stderr that says what, where and how to mend it; exit code 2."""

from __future__ import annotations

import pathlib
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from flightstack.recording.recorder import FlightRecorder
from simvehicle.survey.ports import free_ports

pytestmark = pytest.mark.system

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples"
MODULES = {"flightstack": "flightstack.cli", "gcs": "gcs.cli.main", "simvehicle": "simvehicle.cli.main"}
FENCE = "[[-5.0630, 151.2970], [-5.0630, 151.3030], [-5.0570, 151.3030], [-5.0570, 151.2970]]"
CROSSED = "[[-5.0630, 151.2970], [-5.0570, 151.3030], [-5.0630, 151.3030], [-5.0570, 151.2970]]"
AWAY = "[[-5.0830, 151.2970], [-5.0830, 151.3030], [-5.0770, 151.3030], [-5.0770, 151.2970]]"
LINE = "launch_line:\n  count: 5\n  flavour: ardupilot\n  spacing_m: 6.0\n  towards_deg: 50.0\n"


MODULES = {"flightstack": "flightstack.cli", "gcs": "gcs.cli.main", "simvehicle": "simvehicle.cli.main"}


def run(*arguments: str | pathlib.Path, cwd: pathlib.Path, seconds: float = 60.0) -> tuple[int, str, str]:
    """A command's exit code, output and error output; `arguments` begin with the package."""
    package, *rest = map(str, arguments)
    done = subprocess.run(
        [sys.executable, "-m", MODULES[package], *rest],
        capture_output=True,
        text=True,
        timeout=seconds,
        cwd=cwd,
    )
    return done.returncode, done.stdout, done.stderr


def refused(*arguments: str | pathlib.Path, cwd: pathlib.Path, log: bool = False) -> str:
    """The one line with which a command refuses. `log`: it may have logged its start before."""
    code, out, err = run(*arguments, cwd=cwd)
    assert (code, out) == (2, ""), err
    assert "Traceback" not in err
    lines = err.splitlines()
    if log:
        lines = [line for line in lines if line.startswith(f"{arguments[0]}: ")]
    assert len(lines) == 1, err
    return lines[0]


def edited(directory: pathlib.Path, example: str, old: str, new: str) -> pathlib.Path:
    text = (EXAMPLES / example).read_text()
    assert text.count(old) >= 1
    file = directory / example
    file.write_text(text.replace(old, new, 1))
    return file


def line_with(file: pathlib.Path, words: str) -> int:
    return next(n for n, line in enumerate(file.read_text().splitlines(), 1) if words in line)


@pytest.mark.parametrize(
    ("old", "new", "at", "says"),
    [
        ("record_to: flights", "recordto: flights", "recordto", "recordto: unknown key"),
        ("speed_mps: 5.0", "speed_mps: fast", "speed_mps", "limits.speed_mps: Expected `float`"),
        ("speed_mps: 5.0", "speed_mps: .inf", "speed_mps", "no number to work with"),
        ("drone: 1 ", "drone: 7 ", "drone: 7", "drone: drone 7 is not in swarm.members"),
        ("[1, 2, 3, 4, 5]", "[1, 2, 3, 4, 4]", "members", "a drone's id stands twice"),
        ("tcp/192.168.2.11:7447", "192.168.2.11", "listen", "swarm.listen[0]: '192.168.2.11' is no endpoint"),
        ("/dev/ttypixhawk,115200", "ttyACM0", "link", "autopilot.link: link 'ttyACM0' is none of"),
        ("type: sba5", "type: sba6", "sba6", "did you mean sba5"),
        ("spacing_m: 10.0", "spacing_m: 3.0", "formation:", "must stay 4 m apart"),
        ("radio_range_m: 60.0", "radio_range_m: 8.0", "formation:", "the radio reaches 8 m"),
        ("above_home_m: 10.0", "above_home_m: 4.0", "above_home_m", "formation.above_home_m: below 4 m"),
        (FENCE, CROSSED, "geofence", "geofence inclusion polygon 0 is not simple"),
        (FENCE, AWAY, "origin", "outside the geofence; move it or widen the fence"),
        ("name: locus", "name: lotus", "strategy", "there are locus, mobs"),
    ],
)
def test_a_drones_file(tmp_path: pathlib.Path, old: str, new: str, at: str, says: str) -> None:
    file = edited(tmp_path, "drone.yaml", old, new)
    line = refused("flightstack", "check", "--config", file, cwd=tmp_path)
    assert line.startswith(f"flightstack: {file}:{line_with(file, at)}: ")
    assert says in line


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (bytes(range(256)), "cannot be read"),
        (b"drone: 1\n\tswarm: 2\n", ":2: "),
        (b"drone: 1\ndrone: 2\n", ":2: the key 'drone' stands twice"),
        (b"drone: 2020-99-99\n", ":1: drone: Expected `int`, got `str`"),
        (b"drone: " + b"9" * 5000, "a value cannot be read"),
        (b"a: " + b"[" * 5000 + b"]" * 5000, "nested too deeply"),
    ],
    ids=["empty", "binary", "tab", "twice", "date", "huge", "deep"],
)
def test_odd_yaml(tmp_path: pathlib.Path, content: bytes, says: str) -> None:
    file = tmp_path / "odd.yaml"
    file.write_bytes(content)
    assert says in refused("flightstack", "check", "--config", file, cwd=tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "at", "says"),
    [
        ("launch_line:", "lunch_line:", "lunch_line", "lunch_line: unknown key"),
        ("latitude_deg: 38.4040", "latitude_deg: 38.4140", "launch_line", "m outside the geofence; move it"),
        ("[38.405712, 14.960710]", "[38.402649, 14.964030]", "geofence", "polygon 0 is not simple"),
        ("radio_range_m: 60.0", "radio_range_m: 5.0", "formation", "the radio reaches 5 m"),
        (
            LINE,
            "drones:\n  - {id: 3}\n  - {id: 3, home_east_m: 9}\n",
            "home_east_m: 9",
            "every drone needs its own",
        ),
        (LINE, "drones:\n  - {id: 3}\n  - {id: 4, home_east_m: 1}\n", "home_east_m: 1", "start 1.0 m apart"),
        ("seed: 1", "seed: -1", "seed", "seed: -1 is not within"),
    ],
)
def test_a_surveys_file(tmp_path: pathlib.Path, old: str, new: str, at: str, says: str) -> None:
    file = edited(tmp_path, "survey.yaml", old, new)
    line = refused("simvehicle", "fly", file, cwd=tmp_path)
    assert line.startswith(f"simvehicle: {file}:{line_with(file, at)}: ")
    assert says in line
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_not_there(tmp_path: pathlib.Path) -> None:
    for command in (
        ("flightstack", "run", "--config", "none.yaml"),
        ("flightstack", "replay", "none.mcap"),
        ("simvehicle", "fly", "none.yaml"),
        ("gcs", "serve", "--config", "none.yaml"),
    ):
        line = refused(*command, cwd=tmp_path)
        assert "none." in line
        assert "No such file" in line


def test_a_directory_that_cannot_be_written(tmp_path: pathlib.Path) -> None:
    (tmp_path / "file").write_text("")
    line = refused("simvehicle", "fly", EXAMPLES / "survey.yaml", "--out", tmp_path / "file", cwd=tmp_path)
    assert line.endswith("cannot be written: File exists; choose another --out")


class DroneFiles:
    """A drone's file for this machine, with free ports."""

    def __init__(self, directory: pathlib.Path) -> None:
        self.udp = free_ports(socket.SOCK_DGRAM, 1)[0]
        self.tcp = free_ports(socket.SOCK_STREAM, 1)[0]
        self.file = directory / "drone.yaml"
        self.lines = {
            "drone": "1",
            "swarm": f"{{name: lonely, members: [1, 2], listen: [tcp/127.0.0.1:{self.tcp}]}}",
            "origin": "{latitude_deg: -5.06, longitude_deg: 151.3, amsl_m: 500.0}",
            "autopilot": f'{{link: "udpin:127.0.0.1:{self.udp}", answer_timeout_s: 0.5}}',
            "record_to": str(directory / "flights"),
        }

    def write(self, **changes: str) -> pathlib.Path:
        lines = self.lines | changes
        self.file.write_text("".join(f"{key}: {value}\n" for key, value in lines.items()))
        return self.file


@pytest.fixture
def drone(tmp_path: pathlib.Path) -> DroneFiles:
    return DroneFiles(tmp_path)


def test_an_autopilot_that_never_answers(tmp_path: pathlib.Path, drone: DroneFiles) -> None:
    file = drone.write()
    line = refused("flightstack", "run", "--config", file, cwd=tmp_path, log=True)
    assert line.startswith(f"flightstack: {file}:4: autopilot.link: no autopilot with system id 1 answers")
    assert "check the cable" in line


def test_an_autopilot_with_another_system_id(tmp_path: pathlib.Path, drone: DroneFiles) -> None:
    """The commonest mistake with new vehicles: all have system id 1."""
    file = drone.write(drone="2")
    over = threading.Event()

    def autopilot() -> None:
        encoder = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        heartbeat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 81, 0, 3, 3)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not over.wait(0.1):
                sender.sendto(heartbeat.pack(encoder), ("127.0.0.1", drone.udp))

    thread = threading.Thread(target=autopilot)
    thread.start()
    try:
        line = refused("flightstack", "run", "--config", file, cwd=tmp_path, log=True)
    finally:
        over.set()
        thread.join()
    assert line.startswith(f"flightstack: {file}:4: autopilot.link: no autopilot with system id 2 answers")
    assert line.endswith("has system id 1, this drone is 2: set its SYSID_THISMAV (PX4: MAV_SYS_ID) to 2")


def test_a_connection_that_is_refused(tmp_path: pathlib.Path, drone: DroneFiles) -> None:
    (port,) = free_ports(socket.SOCK_STREAM, 1)
    file = drone.write(autopilot=f'{{link: "tcp:127.0.0.1:{port}", answer_timeout_s: 0.5}}')
    line = refused("flightstack", "run", "--config", file, cwd=tmp_path, log=True)
    assert f"answers: tcp:127.0.0.1:{port}: Connection refused; " in line


def test_an_instrument_that_is_absent_is_a_state_and_no_error(
    tmp_path: pathlib.Path, drone: DroneFiles
) -> None:
    file = drone.write(instruments="[{name: co2, type: sba5, port: /dev/ttynone}]")
    line = refused("flightstack", "run", "--config", file, cwd=tmp_path, log=True)
    assert "no autopilot with system id 1 answers" in line


def test_a_serial_port_that_is_absent(tmp_path: pathlib.Path, drone: DroneFiles) -> None:
    file = drone.write(autopilot='{link: "/dev/ttynone,115200"}')
    line = refused("flightstack", "run", "--config", file, cwd=tmp_path)
    assert line.startswith(f"flightstack: {file}:4: autopilot.link: ")
    assert line.endswith("there is no port /dev/ttynone; is the device plugged in and switched on?")


def test_ports_in_use(tmp_path: pathlib.Path, drone: DroneFiles) -> None:
    file = drone.write()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", drone.udp))
        line = refused("flightstack", "run", "--config", file, cwd=tmp_path)
        assert line.startswith(f"flightstack: {file}:4: autopilot.link: ")
        assert "Address already in use; end the other process" in line
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", drone.tcp))
        taken.listen()
        line = refused("flightstack", "run", "--config", file, cwd=tmp_path)
        assert line.startswith(f"flightstack: {file}:2: swarm.listen: cannot listen on tcp/127.0.0.1:")
        assert "the port is in use" in line
        station = edited(tmp_path, "ground.yaml", "tcp/127.0.0.1:7447", f"tcp/127.0.0.1:{drone.tcp}")
        station.write_text(station.read_text().replace('"udpin:127.0.0.1:14550"', ""))
        line = refused("gcs", "serve", "--config", station, cwd=tmp_path)
        assert line.startswith(
            f"gcs: {station}:{line_with(station, 'listen')}: swarm.listen: cannot listen on"
        )


def test_the_port_of_an_emulated_instrument_in_use(tmp_path: pathlib.Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        file = tmp_path / "fleet.yaml"
        file.write_text(
            "origin: {latitude_deg: 1, longitude_deg: 2}\nvehicles:\n  - id: 1\n    links: ['udpout:127.0.0.1:9']\n"
            f"    instruments: [{{name: co2, type: sba5, port: '127.0.0.1:{port}'}}]\n"
        )
        line = refused("simvehicle", "run", "--config", file, cwd=tmp_path)
        assert line.startswith(f"simvehicle: {file}:5: vehicles[0].instruments[0].port: ")
        assert "Address already in use" in line


def test_recordings_that_cannot_be_made(tmp_path: pathlib.Path, drone: DroneFiles) -> None:
    (tmp_path / "taken").write_text("")
    file = drone.write(record_to=str(tmp_path / "taken" / "flights"))
    line = refused("flightstack", "run", "--config", file, cwd=tmp_path)
    assert line.startswith(f"flightstack: {file}:5: record_to: ")
    assert line.endswith("name another directory")


@pytest.fixture
def first_agent(tmp_path: pathlib.Path) -> Iterator[DroneFiles]:
    """An agent that is drone 1 and waits for its autopilot."""
    (tmp_path / "first").mkdir()
    first = DroneFiles(tmp_path / "first")
    file = first.write(autopilot=f'{{link: "udpin:127.0.0.1:{first.udp}"}}')
    log = tmp_path / "first.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "flightstack.cli", "run", "--config", str(file)], stdout=out, stderr=out
        )
    try:
        deadline_s = time.monotonic() + 60.0
        while "ready: " not in log.read_text():
            assert process.poll() is None
            assert time.monotonic() < deadline_s
            time.sleep(0.1)
        yield first
        assert process.poll() is None, log.read_text()
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def test_two_drones_with_one_id(tmp_path: pathlib.Path, first_agent: DroneFiles) -> None:
    """The newcomer gives way; the one that is there already stays."""
    (tmp_path / "second").mkdir()
    second = DroneFiles(tmp_path / "second")
    file = second.write(
        swarm=f"{{name: lonely, members: [1, 2], connect: [tcp/127.0.0.1:{first_agent.tcp}]}}",
        autopilot=f'{{link: "udpin:127.0.0.1:{second.udp}"}}',
    )
    code, _, err = run("flightstack", "run", "--config", file, cwd=tmp_path)
    assert code == 2
    assert err.splitlines()[-1] == (
        f"flightstack: {file}:1: drone: another agent of the swarm is drone 1 already; every drone needs its own id"
    )


def test_replaying_what_is_no_agents_recording(tmp_path: pathlib.Path) -> None:
    (tmp_path / "text.mcap").write_text("hello")
    assert "is no MCAP file" in refused("flightstack", "replay", "text.mcap", cwd=tmp_path)
    recorder = FlightRecorder(tmp_path / "station.mcap")
    recorder.record("/config", 0.0, {"station": "ground"})
    recorder.close()
    line = refused("flightstack", "replay", "station.mcap", cwd=tmp_path)
    assert "holds no drone's configuration" in line


@pytest.mark.parametrize(
    ("old", "new", "at", "says"),
    [
        ("orphans:", "orphan:", "orphan:", "orphan: unknown key"),
        ("udpin:127.0.0.1:14550", "14550", "mavlink", "mavlink.links[0]: link '14550' is none of"),
        (
            "udpin:127.0.0.1:14550",
            "/dev/ttynone,57600",
            "mavlink",
            "mavlink.links[0]: link '/dev/ttynone,57600': there is",
        ),
        ("tcp/127.0.0.1:7447", "127.0.0.1", "listen", "swarm.listen[0]: '127.0.0.1' is no endpoint"),
        (
            "record_to: flights",
            "record_to: ground.yaml",
            "record_to",
            "record_to: ground.yaml cannot be made",
        ),
    ],
)
def test_a_ground_stations_file(tmp_path: pathlib.Path, old: str, new: str, at: str, says: str) -> None:
    file = edited(tmp_path, "ground.yaml", old, new)
    line = refused("gcs", "serve", "--config", file, cwd=tmp_path)
    assert line.startswith(f"gcs: {file}:{line_with(file, at)}: {says}")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("status",), "which swarm? give --config ground.yaml"),
        (("status", "--swarm", "a b", "--connect", "tcp/127.0.0.1:9"), "swarm name 'a b'"),
        (
            ("survey", "start", "--swarm", "a", "--connect", "nowhere"),
            "swarm.connect: 'nowhere' is no endpoint",
        ),
        (("param", "get", "X", "--drone", "1"), "which link?"),
    ],
)
def test_the_operators_commands(tmp_path: pathlib.Path, arguments: tuple[str, ...], says: str) -> None:
    assert says in refused("gcs", *arguments, cwd=tmp_path)
