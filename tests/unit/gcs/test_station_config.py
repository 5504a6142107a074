"""The ground station's file: what is taken, and what is refused with which words."""

from __future__ import annotations

import pathlib

import pytest

from flightstack.mavlink.signing_store import write_key
from gcs.connection import Connection, from_options, own_endpoint, reachable
from gcs.errors import GroundError
from gcs.station_config import load
from mission.documents.yaml_file import DocumentError

GOOD = """\
station: ground
swarm:
  name: etna
  members: [1, 2, 3]
  listen: [tcp/0.0.0.0:7447]
  connect: [tcp/10.0.0.2:7447]
origin: {latitude_deg: 37.75, longitude_deg: 15.0, amsl_m: 2900}
mavlink:
  links: ["udpin:0.0.0.0:14550"]
orphans: {grace_s: 4, action: land}
alarms: {ceiling_above_home_m: 60}
record_to: flights
"""


@pytest.fixture
def written(tmp_path):
    def write(text: str) -> pathlib.Path:
        path = tmp_path / "ground.yaml"
        path.write_text(text)
        return path

    return write


def test_reads_a_whole_file(written):
    config = load(written(GOOD))
    assert config.mavlink.system == 255
    assert config.orphans.action == "land"
    assert config.swarm.members == (1, 2, 3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("station: ground", "sation: ground", ["ground.yaml:1", "sation", "unknown key"]),
        ("station: ground", 'station: "7"', ["ground.yaml:1", "station"]),
        ("[1, 2, 3]", "[1, 2, 2]", ["swarm.members", "twice"]),
        ("[1, 2, 3]", "[1, 2, 251]", ["swarm.members"]),
        ("links:", "system: 3\n  links:", ["mavlink.system", "255"]),
        ('["udpin:0.0.0.0:14550"]', '["udpin:a:1", "udpin:a:1"]', ["mavlink.links", "twice"]),
        ("action: land", "action: hover", ["orphans.action"]),
        ("record_to: flights", "speedup: 1000", ["speedup", "100"]),
        ("record_to: flights", "tick_hz: 1", ["tick_hz"]),
        ("record_to: flights", "radio: radio.yaml", ["radio", "only a simulated flight"]),
        ("ceiling_above_home_m: 60", "battery_low_fraction: 0.1", ["battery_critical_fraction"]),
        ("latitude_deg: 37.75", "latitude_deg: 97.75", ["origin", "latitude"]),
        ("record_to: flights", "geofence: {inclusion: [[[0, 0], [1, 1]]]}", ["geofence"]),
    ],
)
def test_refuses_in_one_line_that_names_the_place(written, old, new, words):
    assert old in GOOD
    with pytest.raises(DocumentError) as caught:
        load(written(GOOD.replace(old, new)))
    text = str(caught.value)
    assert "\n" not in text
    for word in ["ground.yaml:", *words]:
        assert word in text


def test_an_absent_file(tmp_path):
    with pytest.raises(DocumentError, match=r"none\.yaml: cannot be read: No such file or directory$"):
        load(tmp_path / "none.yaml")


def test_a_command_connects_where_the_station_listens(written):
    connection = from_options(written(GOOD), None, ["tcp/10.0.0.9:7447"])
    assert connection.connect == ("tcp/127.0.0.1:7447", "tcp/10.0.0.2:7447", "tcp/10.0.0.9:7447")
    assert connection.members == (1, 2, 3)
    assert connection.node("status") != connection.node("status")


@pytest.mark.parametrize(
    ("swarm", "connect", "word"),
    [(None, [], "--config"), ("etna", [], "--connect")],
)
def test_what_is_missing_to_connect(swarm, connect, word):
    with pytest.raises(GroundError, match=word):
        from_options(None, swarm, connect)


def test_not_both_ways_to_connect(written):
    with pytest.raises(GroundError, match="not both"):
        from_options(written(GOOD), "etna", [])


def test_a_file_without_any_endpoint(written):
    text = GOOD.replace("  listen: [tcp/0.0.0.0:7447]\n", "").replace("  connect: [tcp/10.0.0.2:7447]\n", "")
    with pytest.raises(GroundError, match=r"swarm\.connect"):
        from_options(written(text), None, [])


def test_endpoints_to_connect_to():
    assert reachable("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"
    assert reachable("tls/[::]:7447") == "tls/[::1]:7447"
    assert reachable("tcp/10.1.2.3:7447") == "tcp/10.1.2.3:7447"


def test_a_short_lived_node_can_be_reached_in_the_network_of_the_swarm(written):
    assert own_endpoint("tcp/127.0.0.1:7447") == "tcp/127.0.0.1:0"
    assert own_endpoint("tcp/0.0.0.0:7447") == "tcp/0.0.0.0:0"
    assert own_endpoint("tls/[::]:7447") == "tls/[::]:0"
    assert own_endpoint("nonsense") is None
    assert from_options(written(GOOD), None, []).listen() == ("tcp/0.0.0.0:0",)
    several = Connection("etna", (), ("tcp/127.0.0.1:1", "tcp/127.0.0.1:2"))
    assert several.listen() == ("tcp/127.0.0.1:0",)


def test_a_host_that_does_not_exist_is_named(written):
    with pytest.raises(GroundError, match=r"--connect tcp/no-such-host\.invalid:7447: no host is called"):
        from_options(None, "etna", ["tcp/no-such-host.invalid:7447"])
    with pytest.raises(GroundError, match=r"no host is called 'a\.\.b' \(it is no name of a host\)"):
        from_options(None, "etna", ["tcp/a..b:7447"])
    with pytest.raises(GroundError, match="--connect tcp/no-such-host"):
        from_options(written(GOOD), None, ["tcp/no-such-host.invalid:7447"])


def test_a_host_of_the_file_that_does_not_exist_leaves_the_others(written):
    file = written(GOOD.replace("tcp/0.0.0.0:7447", "tcp/no-such-host.invalid:7447"))
    (problem,) = from_options(file, None, []).unresolved
    assert problem.startswith(f"{file}: tcp/no-such-host.invalid:7447: no host is called")


def test_a_signing_key_lies_beside_the_file(written, tmp_path):
    write_key(tmp_path / "mavlink.key")
    text = GOOD.replace("mavlink:\n", "mavlink:\n  signing_key: mavlink.key\n")
    assert load(written(text)).mavlink.signing_key == str(tmp_path / "mavlink.key")
    (tmp_path / "mavlink.key").chmod(0o644)
    with pytest.raises(DocumentError, match=r"ground\.yaml:9: mavlink\.signing_key: .*chmod 600") as caught:
        load(written(text))
    assert "\n" not in str(caught.value)
