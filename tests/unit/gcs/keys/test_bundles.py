"""A fleet's directory: what is made, what is kept, and what a person can get wrong."""

from __future__ import annotations

import datetime
import json
import pathlib
import re
import stat
from typing import Any

import pytest
import yaml
import zenoh
from typer.testing import CliRunner

import flightstack.config_file
import gcs.station_config
from flightstack.transport.certificates import check_certificates
from gcs.cli.main import app
from gcs.errors import GroundError
from gcs.keys import authority, bundles
from mission.documents.yaml_file import DocumentError

EXAMPLES = pathlib.Path(__file__).parents[4] / "examples"
INIT = "--swarm crater --drones 1-3,7 --first-address 192.168.2.11 --station ground=192.168.2.1"


def fleet(*words: object) -> str:
    done = CliRunner().invoke(app, ["fleet", *map(str, words)])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture
def made(tmp_path) -> pathlib.Path:
    fleet("init", tmp_path / "crater", *INIT.split())
    return tmp_path / "crater"


def contents(directory: pathlib.Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(directory)): file.read_bytes() for file in directory.rglob("*") if file.is_file()
    }


def written(made: pathlib.Path, example: str, name: str, **changes: object) -> pathlib.Path:
    """An example's file in a node's bundle, with the bundle's swarm section."""
    document = yaml.safe_load((EXAMPLES / example).read_text())
    document |= yaml.safe_load((made / name / "swarm.yaml").read_text()) | changes
    file = made / name / "node.yaml"
    file.write_text(yaml.safe_dump(document))
    return file


def test_everybody_has_a_bundle_and_the_authority_stays(made):
    assert sorted(p.name for p in made.iterdir()) == [
        *("authority", "drone-1", "drone-2", "drone-3", "drone-7", "fleet.yaml", "ground")
    ]
    for bundle in (p for p in made.iterdir() if p.is_dir() and p.name != "authority"):
        assert sorted(p.name for p in bundle.iterdir()) == sorted(
            ["authority.pem", f"{bundle.name}.key", f"{bundle.name}.pem", "swarm.yaml"]
        )
    for key in made.rglob("*.key"):
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
        assert stat.S_IMODE(key.parent.stat().st_mode) == 0o700
    assert len({key.read_bytes() for key in made.rglob("*.key")}) == 6


def test_the_bundles_are_files_that_fly(made):
    for drone, host in ((1, 11), (2, 12), (3, 13), (7, 14)):
        config = flightstack.config_file.load(written(made, "drone.yaml", f"drone-{drone}", drone=drone))
        assert config.swarm.members == (1, 2, 3, 7)
        assert config.swarm.listen == (f"tls/192.168.2.{host}:7447",)
        assert config.swarm.tls is not None
        end = check_certificates(config.swarm.tls, drone)
        left = end - datetime.datetime.now(datetime.UTC)
        assert datetime.timedelta(days=364) < left <= datetime.timedelta(days=365)
    station = gcs.station_config.load(written(made, "ground.yaml", "ground"))
    assert station.swarm.connect == config.swarm.connect
    assert len(station.swarm.connect) == 5


def test_another_drones_bundle_is_told_with_the_files_line(made):
    file = written(made, "drone.yaml", "drone-2", drone=1)
    with pytest.raises(
        DocumentError, match=r"swarm\.tls.*is the certificate of 'drone-2', this is 'drone-1'"
    ):
        flightstack.config_file.load(file)
    with pytest.raises(DocumentError, match=r"base is not in swarm\.tls\.stations"):
        gcs.station_config.load(written(made, "ground.yaml", "ground", station="base"))


def test_nothing_is_overwritten_unasked(made, tmp_path):
    before = contents(made)
    with pytest.raises(GroundError, match="is not empty"):
        fleet("init", made, *INIT.split())
    assert contents(made) == before
    fleet("init", made, *INIT.split(), "--force")
    assert contents(made)["drone-1/drone-1.key"] != before["drone-1/drone-1.key"]
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "thesis.tex").write_text("x")
    with pytest.raises(GroundError, match="is no fleet's directory"):
        fleet("init", tmp_path / "papers", *INIT.split(), "--force")
    assert contents(tmp_path / "papers") == {"thesis.tex": b"x"}
    with pytest.raises(GroundError, match="is no directory"):
        fleet("init", tmp_path / "papers" / "thesis.tex", *INIT.split(), "--force")


def test_a_drone_more(made):
    before = contents(made)
    text = fleet("add", made, "--drones", "9", "--first-address", "192.168.2.19")
    after = contents(made)
    changed = {name for name in before if before[name] != after[name]}
    nodes = ("ground", "drone-1", "drone-2", "drone-3", "drone-7")
    assert changed == {"fleet.yaml", *(f"{name}/swarm.yaml" for name in nodes)}
    assert all(f"{made / name / 'swarm.yaml'}: changed; copy it to {name}" in text for name in nodes)
    config = flightstack.config_file.load(written(made, "drone.yaml", "drone-9", drone=9))
    assert config.swarm.members == (1, 2, 3, 7, 9)
    with pytest.raises(GroundError, match="drone 9 is in this fleet already"):
        fleet("add", made, "--drones", "9", "--first-address", "192.168.2.20")
    with pytest.raises(GroundError, match=r"drone-7 and drone-8 have the same address 192\.168\.2\.14"):
        fleet("add", made, "--drones", "8", "--first-address", "192.168.2.14")
    fleet("add", made, "--station", "base=192.168.2.2")
    assert gcs.station_config.load(written(made, "ground.yaml", "base", station="base")).station == "base"


def section(made: pathlib.Path, name: str) -> dict[str, Any]:
    return yaml.safe_load((made / name / "swarm.yaml").read_text())["swarm"]


@pytest.fixture
def sites(tmp_path) -> pathlib.Path:
    """Two drones at one site, one and a station at another that has the same addresses."""
    made = tmp_path / "sites"
    first = "--swarm crater --drones 1,2 --first-address 192.168.2.11 --site rim --router relay=203.0.113.7"
    fleet("init", made, *first.split())
    second = "--drones 3 --first-address 192.168.2.11 --station ground=192.168.2.1 --site valley"
    text = fleet("add", made, *second.split(), "--router", "relay=10.0.0.7")
    changed = made / "relay" / "zenohd.json5"
    assert f"{changed}: changed; copy it to relay and start it again" in text
    return made


def test_sites_have_the_router_first_and_their_own_nodes_alone(sites):
    routers = {"rim": "tls/203.0.113.7:7448", "valley": "tls/10.0.0.7:7448"}
    own = {
        "rim": ["tls/192.168.2.11:7447", "tls/192.168.2.12:7447"],
        "valley": ["tls/192.168.2.1:7447", "tls/192.168.2.11:7447"],
    }
    for name, site in (("drone-1", "rim"), ("drone-2", "rim"), ("drone-3", "valley"), ("ground", "valley")):
        facts = section(sites, name)
        assert facts["site"] == site
        assert facts["connect"] == [routers[site], *own[site]]
        assert facts["listen"][0] in own[site]
        assert facts["members"] == [1, 2, 3]
        assert facts["tls"]["routers"] == ["relay"]
        assert facts["tls"]["stations"] == ["ground"]
    config = flightstack.config_file.load(written(sites, "drone.yaml", "drone-3", drone=3))
    assert config.swarm.site == "valley"
    station = gcs.station_config.load(written(sites, "ground.yaml", "ground"))
    assert station.swarm.site == "valley"


def test_the_routers_bundle_is_a_router_that_believes_the_fleet(sites):
    bundle = sites / "relay"
    assert sorted(p.name for p in bundle.iterdir()) == [
        *("authority.pem", "relay.key", "relay.pem", "zenohd.json5")
    ]
    config = zenoh.Config.from_file(str(bundle / "zenohd.json5"))
    assert json.loads(config.get_json("mode")) == "router"
    assert json.loads(config.get_json("listen/endpoints")) == ["tls/[::]:7448"]
    subjects = json.loads(config.get_json("access_control/subjects"))
    assert {subject["id"] for subject in subjects} == {"drone-1", "drone-2", "drone-3", "ground"}
    regions = json.loads(config.get_json("gateway"))["south"]
    assert [site["filters"][0]["region_names"] for site in regions] == [["rim"], ["valley"]]
    tls = json.loads(config.get_json("transport/link/tls"))
    assert (tls["listen_certificate"], tls["listen_private_key"]) == ("relay.pem", "relay.key")
    assert tls["enable_mtls"]


def test_a_fleet_gets_a_router_by_hand(made):
    file = made / "fleet.yaml"
    document = yaml.safe_load(file.read_text())
    document |= {
        "router": "relay",
        "sites": {
            "rim": {"router": "10.0.0.7", "nodes": ["drone-1", "drone-2", "drone-3"]},
            "valley": {"router": "10.0.0.7", "nodes": ["drone-7", "ground"]},
        },
    }
    file.write_text(yaml.safe_dump(document))
    keys = {name: data for name, data in contents(made).items() if name.endswith(".key")}
    fleet("renew", made)
    after = contents(made)
    assert all(after[name] == data for name, data in keys.items())
    assert "relay/relay.key" in after
    assert section(made, "drone-7")["connect"][0] == "tls/10.0.0.7:7448"
    document["sites"]["rim"]["nodes"].append("drone-7")
    file.write_text(yaml.safe_dump(document))
    with pytest.raises(GroundError, match="drone-7 is at 2 sites"):
        fleet("renew", made)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            "--drones 4 --first-address 192.168.2.14",
            "drone-4 is at 0 sites; with a router every node is at one",
        ),
        ("--drones 4 --first-address 192.168.2.12 --site rim", "drone-2 and drone-4 have the same address"),
        (
            "--station x=10.0.0.1 --site rim --router other=10.0.0.7",
            "--router other: this fleet's router is relay",
        ),
        ("--station x=10.0.0.1 --site rim --router relay=a/b", "the router of site rim: 'a/b' is no address"),
        ("--station x=10.0.0.1 --site a/b", "--site 'a/b': use letters"),
        ("--station x=10.0.0.1 --site rim --router relay", "--router relay: write NAME=ADDRESS"),
        ("--station relay=10.0.0.1 --site rim", "'relay' stands twice"),
    ],
)
def test_what_is_wrong_with_a_site_is_one_line_and_changes_nothing(sites, words, text):
    before = contents(sites)
    with pytest.raises(GroundError) as caught:
        fleet("add", sites, *words.split())
    assert text in str(caught.value)
    assert contents(sites) == before


def test_a_site_needs_a_router(made, tmp_path):
    with pytest.raises(GroundError, match="--site rim: this fleet has no router"):
        fleet("add", made, "--drones", "4", "--first-address", "192.168.2.14", "--site", "rim")
    with pytest.raises(GroundError, match="give both or neither"):
        fleet("init", tmp_path / "f", *INIT.split(), "--site", "rim")
    assert not (tmp_path / "f").exists()


def test_renewing_changes_certificates_alone(made):
    before = contents(made)
    facts = json.loads(fleet("renew", made, "drone-2", "--days", "700", "--json"))
    assert facts["changed"] == [str(made / "drone-2" / "drone-2.pem")]
    after = contents(made)
    assert {name for name in before if before[name] != after[name]} == {"drone-2/drone-2.pem"}
    config = flightstack.config_file.load(written(made, "drone.yaml", "drone-2", drone=2))
    assert config.swarm.tls is not None
    left = check_certificates(config.swarm.tls, 2) - datetime.datetime.now(datetime.UTC)
    assert left > datetime.timedelta(days=699)
    assert len(json.loads(fleet("renew", made, "--json"))["changed"]) == 5
    with pytest.raises(GroundError, match="drone-8 is not in this fleet"):
        fleet("renew", made, "drone-8")


def test_renewing_says_what_else_has_changed(made):
    file = made / "fleet.yaml"
    file.write_text(file.read_text().replace("192.168.2.12", "192.168.2.99"))
    changed = json.loads(fleet("renew", made, "drone-1", "--json"))["changed"]
    nodes = ("ground", "drone-1", "drone-2", "drone-3", "drone-7")
    assert set(changed) == {
        str(made / "drone-1" / "drone-1.pem"),
        *(str(made / name / "swarm.yaml") for name in nodes),
    }


def test_a_fleet_that_was_left_half_made_is_made_again(tmp_path, monkeypatch):
    made = tmp_path / "crater"
    signed = iter(range(2))

    def full_disk(*arguments: object) -> authority.Pair:
        if next(signed, None) is None:
            raise OSError(28, "No space left on device", str(made))
        return authority.sign(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(bundles, "sign", full_disk)
        with pytest.raises(GroundError, match="No space left on device"):
            fleet("init", made, *INIT.split())
    with pytest.raises(GroundError, match="--force makes a new one"):
        fleet("init", made, *INIT.split())
    fleet("init", made, *INIT.split(), "--force")
    assert flightstack.config_file.load(written(made, "drone.yaml", "drone-7", drone=7)).drone == 7


def test_a_fleet_made_anew_leaves_no_keys_of_those_who_are_gone(made):
    (made / "drone-7" / "notes.txt").write_text("propeller 3 is bent")
    fleet("init", made, *INIT.replace("1-3,7", "1,2").split(), "--force")
    assert not (made / "drone-3").exists()
    assert [p.name for p in (made / "drone-7").iterdir()] == ["notes.txt"]


def test_a_clock_that_is_not_set_makes_no_certificates(tmp_path, monkeypatch):
    class Unset(datetime.datetime):
        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> datetime.datetime:
            return datetime.datetime(1970, 1, 2, tzinfo=tz)

    monkeypatch.setattr(bundles.datetime, "datetime", Unset)
    with pytest.raises(GroundError, match="this computer's clock says 1970-01-02; set it"):
        fleet("init", tmp_path / "f", *INIT.split())
    assert not (tmp_path / "f").exists()


def templates(directory: pathlib.Path) -> list[str]:
    """Options that give the examples as templates, the drone's with a fence in a file and remarks of its own."""
    document = (EXAMPLES / "drone.yaml").read_text()
    fence = document.index("geofence:")
    strategy = document.index("strategy:")
    text = f"{document[:fence]}geofence: crater.plan\n# wide {document[strategy:]}".replace(
        "# wide ", "# wide\n"
    )
    (directory / "drone.yaml").write_text(text)
    (directory / "crater.plan").write_text("a plan")
    return ["--drone-file", str(directory / "drone.yaml"), "--ground-file", str(EXAMPLES / "ground.yaml")]


def test_whole_files_from_a_template(tmp_path):
    made = tmp_path / "crater"
    fleet("init", made, *INIT.split(), *templates(tmp_path))
    original = (tmp_path / "drone.yaml").read_text()
    for drone in (1, 7):
        text = (made / f"drone-{drone}" / "drone.yaml").read_text()
        assert text.startswith("# A Dragonfly-class drone")
        assert "# wide\n" in text
        read = yaml.safe_load(text)
        assert read == yaml.safe_load(original) | {"drone": drone, "swarm": section(made, f"drone-{drone}")}
        assert (made / f"drone-{drone}" / "crater.plan").read_text() == "a plan"
    assert gcs.station_config.load(made / "ground" / "ground.yaml").swarm.members == (1, 2, 3, 7)


def test_what_a_person_writes_into_a_whole_file_stays(tmp_path):
    made = tmp_path / "crater"
    fleet("init", made, *INIT.split(), *templates(tmp_path))
    file = made / "drone-2" / "drone.yaml"
    file.write_text(re.sub(r"RTL_ALT: \d+", "RTL_ALT: 2025", file.read_text()))
    words = ["--drones", "9", "--first-address", "192.168.2.19"]
    changed = json.loads(fleet("add", made, *words, "--json"))["changed"]
    assert str(file) in changed
    assert str(file.with_name("swarm.yaml")) not in changed
    assert "RTL_ALT: 2025" in file.read_text()
    assert yaml.safe_load(file.read_text())["swarm"]["members"] == [1, 2, 3, 7, 9]
    assert not (made / "drone-9" / "drone.yaml").exists()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[1, 2]", "is no configuration"),
        ("drone: 1\n", "has no swarm section"),
        ("{drone: 1, swarm: {name: x}}", "drone and swarm cannot be replaced in it"),
        ("drone: [1\n", "drone.yaml:2: "),
        ("drone: 1\nswarm: {name: x}\ngeofence: no.plan\n", "no.plan: No such file"),
        ("drone: 1\nswarm: {name: x}\ngeofence: ../crater.plan\n", "../crater.plan is not beside it"),
    ],
)
def test_a_template_that_cannot_be_used_is_one_line_and_makes_nothing(tmp_path, text, problem):
    (tmp_path / "drone.yaml").write_text(text)
    with pytest.raises((GroundError, DocumentError)) as caught:
        fleet("init", tmp_path / "f", *INIT.split(), "--drone-file", tmp_path / "drone.yaml")
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "f").exists()


def test_a_damaged_fleet_is_one_line(made):
    with pytest.raises(GroundError, match="is no fleet's directory"):
        fleet("renew", made / "drone-1")
    (made / "drone-2" / "drone-2.key").write_text("nonsense")
    with pytest.raises(GroundError, match="private key of drone-2 is damaged"):
        fleet("renew", made, "drone-2")
    (made / "authority" / "authority.key").write_bytes((made / "drone-1" / "drone-1.key").read_bytes())
    with pytest.raises(GroundError, match="the authority's private key does not belong to its certificate"):
        fleet("renew", made, "drone-1")
    (made / "authority" / "authority.key").unlink()
    with pytest.raises(GroundError, match=r"authority\.key: No such file"):
        fleet("renew", made, "drone-1")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("--station ground=192.168.2.1", ""), "--station: name at least one ground station"),
        (("ground=192.168.2.1", "ground"), "write NAME=ADDRESS"),
        (("ground=192.168.2.1", "drone-9=192.168.2.1"), "'drone-9' is a drone's name"),
        (("ground=192.168.2.1", "authority=192.168.2.1"), "'authority' stands twice"),
        (("ground=192.168.2.1", "ground=a/b"), "'a/b' is no address"),
        (("ground=192.168.2.1", "ground=192.168.2.12"), "ground and drone-2 have the same address"),
        (("1-3,7", "3-1"), "3-1 is not within 1 to 250, lowest first"),
        (("1-3,7", "0"), "0 is not within 1 to 250"),
        (("1-3,7", "1,1"), "a number stands twice"),
        (("1-3,7", "x"), "write numbers as 1-5 or 1,2,7"),
        (("192.168.2.11", "192.168.2"), "--first-address 192.168.2: "),
        (("192.168.2.11", "255.255.255.254"), "--first-address 255.255.255.254: "),
        (("--first-address 192.168.2.11", ""), "which drones, and where?"),
        (("crater", "a/b"), "--swarm 'a/b': use letters"),
        (("crater", "c" * 49), "the swarm's name is longer than 48 letters"),
        (("ground=", "g" * 49 + "="), "is longer than 48 letters"),
    ],
)
def test_what_a_person_can_get_wrong_is_one_line_and_makes_nothing(tmp_path, change, text):
    with pytest.raises(GroundError) as caught:
        fleet("init", tmp_path / "f", *INIT.replace(*change).split())
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "f").exists()


def test_without_the_library_the_mend_is_told(tmp_path, monkeypatch):
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(authority.importlib, "import_module", absent)
    with pytest.raises(GroundError, match=r"pip install '\.\[ground\]'"):
        fleet("init", tmp_path / "f", *INIT.split())


def test_a_certificate_never_outlives_the_authority():
    now = datetime.datetime.now(datetime.UTC)
    made = authority.new_authority("s", now - datetime.timedelta(days=20 * 365 - 10))
    with pytest.raises(GroundError, match="the authority itself ends on"):
        authority.sign(made, "drone-1", now, datetime.timedelta(days=11))
