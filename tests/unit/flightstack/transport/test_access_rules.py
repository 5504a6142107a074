"""Who may say what: the rules by themselves, and what zenoh makes of them between sessions that lie."""

from __future__ import annotations

import datetime
import itertools
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh

from flightstack.config import SwarmConfig, TlsConfig
from flightstack.swarm.topics import COMMAND, EVENT, STATE, TOPICS
from flightstack.transport.access_rules import (
    access_problems,
    access_rules,
    common_name,
    name_clashes,
    speakers_of,
)
from flightstack.transport.zenoh_options import peer_options, router_options
from flightstack.transport.zenoh_router import ZenohRouter
from flightstack.transport.zenoh_session import configured
from flightstack.transport.zenoh_transport import ZenohTransport
from gcs.keys.authority import new_authority, sign
from simvehicle.survey.ports import free_port

MEMBERS = (1, 2)
NOW = datetime.datetime.now(datetime.UTC)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory) -> Callable[[str], TlsConfig]:
    """Certificates of one fleet by name, made when asked for."""
    directory = tmp_path_factory.mktemp("fleet")
    authority = new_authority("s", NOW)
    (directory / "authority.pem").write_bytes(authority.certificate)

    def of(name: str, routers: tuple[str, ...] = ()) -> TlsConfig:
        pair = sign(authority, name, NOW, datetime.timedelta(days=1))
        (directory / f"{name}.pem").write_bytes(pair.certificate)
        (directory / f"{name}.key").write_bytes(pair.private_key)
        return TlsConfig(
            authority=str(directory / "authority.pem"),
            certificate=str(directory / f"{name}.pem"),
            private_key=str(directory / f"{name}.key"),
            routers=routers,
        )

    return of


def session(tls: TlsConfig, listen=(), connect=(), rules=None, **options) -> zenoh.Session:
    """A session of somebody's own software: with a member's certificate, and only the rules that it likes."""
    chosen = peer_options(listen, connect, tls) | options
    if rules is not None:
        chosen["access_control"] = rules
    return zenoh.open(configured(chosen))


class Swarm:
    """Two drones and an operator's command, and what each has heard; drone 1 at a site of its own if a router joins
    the sites."""

    def __init__(self, fleet, connect: Callable[[list[str], int], list[str]], *routers: str) -> None:
        self.endpoints = [f"tls/127.0.0.1:{free_port()}" for _ in range(3)]
        names = ((1, "drone-1"), (2, "drone-2"), ("ground-survey-1a", "ground"))
        receives = (STATE, EVENT, COMMAND)
        self.nodes = [
            ZenohTransport(
                "s",
                node,
                (endpoint,),
                connect(self.endpoints, index),
                receives,
                fleet(name, routers),
                MEMBERS,
                ("valley" if index else "rim") if routers else None,
            )
            for index, ((node, name), endpoint) in enumerate(zip(names, self.endpoints, strict=True))
        ]
        self.heard: set[tuple[str, str, str, bytes]] = set()
        self.count = 0

    def tick(self) -> None:
        for node in self.nodes:
            node.publish(COMMAND if node.node.startswith("ground") else STATE, b"own")
        for node in self.nodes:
            for m in node.receive():
                self.heard.add((node.node, m.topic.name, m.sender, m.payload))
                self.count += 1

    def close(self) -> None:
        for node in self.nodes:
            node.close()


OWN = {
    (hearer, topic, sender, b"own")
    for (sender, topic), hearer in itertools.product(
        (("1", "state"), ("2", "state"), ("ground-survey-1a", "command")), ("1", "2", "ground-survey-1a")
    )
    if hearer != sender
}
FORGED = (
    "state/2",
    "event/2",
    "command/ground",
    "command/ground-survey-1a",
    "command/1",
    "state/*",
    "*/2",
    "state/**",
    "**",
)


def until(condition: Callable[[], object], limit_s: float = 40.0) -> None:
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


@pytest.fixture(params=["mesh", "router", "member as router"])
def swarm_and_liar(request, fleet) -> Iterator[tuple[Swarm, zenoh.Session]]:
    """A swarm, and a session with drone 1's certificate that says what it likes."""
    opened = []
    try:
        if request.param == "router":
            place = f"tls/127.0.0.1:{free_port()}"
            opened.append(
                ZenohRouter(
                    configured(router_options((place,), ("rim", "valley"), "s", MEMBERS, fleet("router")))
                )
            )
            # Both sites: the liar is heard by nobody at its own site, which has drone 1 alone.
            swarm = Swarm(
                fleet, lambda endpoints, index: [place, *(endpoints[1:] if index else ())], "router"
            )
            opened.append(swarm)
            liar = session(fleet("drone-1", ("router",)), (), (place,), region_name="rim")
        else:
            swarm = Swarm(fleet, lambda endpoints, index: endpoints)
            opened.append(swarm)
            mode = "router" if request.param == "member as router" else "peer"
            liar = session(fleet("drone-1"), (), swarm.endpoints, mode=mode)
        opened.append(liar)
        yield swarm, liar
    finally:
        for one in reversed(opened):
            one.close()


def test_a_member_speaks_in_no_other_name_than_its_own(swarm_and_liar):
    swarm, liar = swarm_and_liar
    token = liar.liveliness().declare_token("flightstack/s/alive/9")

    def tell() -> bool:
        swarm.tick()
        for key in FORGED:
            liar.put(f"flightstack/s/{key}", b"forged")
        liar.delete("flightstack/s/state/2")
        liar.put("flightstack/s/event/1", b"the liar is heard")
        proof = {(h, "event", "1", b"the liar is heard") for h in ("2", "ground-survey-1a")}
        return swarm.heard >= proof | OWN

    until(tell)
    before = swarm.count
    until(lambda: tell() and swarm.count > before + 200)
    strange = {fact for fact in swarm.heard if fact[3] != b"own"}
    assert {(topic, sender, payload) for _, topic, sender, payload in strange} == {
        ("event", "1", b"the liar is heard")
    }
    assert swarm.nodes[1].alive() == {"1", "ground-survey-1a"}
    token.undeclare()


def test_a_certificate_that_no_file_names_neither_hears_nor_is_heard(fleet):
    swarm = Swarm(fleet, lambda endpoints, index: endpoints)
    other = session(fleet("drone-3"), (), swarm.endpoints)
    try:
        heard: list[str] = []
        subscriber = other.declare_subscriber(
            "flightstack/s/**",
            lambda sample: heard.append(str(sample.key_expr)),
            allowed_origin=zenoh.Locality.REMOTE,
        )

        def tell() -> bool:
            swarm.tick()
            other.put("flightstack/s/state/3", b"stranger")
            other.put("flightstack/s/state/1", b"stranger")
            return swarm.heard >= OWN and len(list(other.info.peers_zid())) == 3

        until(tell)
        before = swarm.count
        until(lambda: tell() and swarm.count > before + 200)
        assert swarm.heard == OWN
        assert heard == []
        subscriber.undeclare()
    finally:
        other.close()
        swarm.close()


def test_every_topic_is_somebodys_and_orders_are_the_grounds_alone():
    tls = TlsConfig(authority="a", certificate="c", private_key="k", stations=("base",))
    rules = access_rules("s", (4,), tls)
    keys = {rule["id"]: set(rule["key_exprs"]) for rule in rules["rules"]}
    ground_only = {"command", "traffic", "ground", "report"}
    assert keys["speak as drone-4"] == {f"flightstack/s/{t}/4" for t in {*TOPICS, "alive"} - ground_only}
    assert keys["speak as base"] == {"flightstack/s/*/base", "flightstack/s/*/base-$*"}
    assert rules["default_permission"] == "deny"
    assert {s["id"] for s in rules["subjects"]} == {"drone-4", "base"}


def test_common_names():
    assert (common_name(3), common_name("3"), common_name("ground")) == ("drone-3", "drone-3", "ground")


@pytest.mark.parametrize(
    ("stations", "routers", "text"),
    [
        (("a", "a"), (), "'a' stands twice"),
        (("a",), ("a",), "'a' stands twice"),
        (("drone-7",), (), "'drone-7' is a drone's name"),
        (("a",), ("drone-7",), "'drone-7' is a drone's name"),
        (("base", "base-2"), (), "'base-2' begins like the names of 'base''s commands"),
    ],
)
def test_names_by_which_one_could_speak_for_another_are_refused(stations, routers, text):
    (problem,) = name_clashes(stations, routers)
    assert problem.startswith(text)
    tls = TlsConfig(authority="a", certificate="c", private_key="k", stations=stations, routers=routers)
    site = "rim" if routers else None
    assert access_problems(SwarmConfig(name="s", members=(1,), tls=tls, site=site)) == [
        ("swarm.tls", problem)
    ]


@pytest.mark.parametrize(
    ("site", "routers", "field", "text"),
    [
        (None, ("relay",), "swarm.tls", "say at which this node is: swarm.site"),
        ("rim", (), "swarm.site", "name the router in swarm.tls.routers"),
    ],
)
def test_a_router_and_a_site_go_together(site, routers, field, text):
    tls = TlsConfig(authority="a", certificate="c", private_key="k", routers=routers)
    ((where, problem),) = access_problems(SwarmConfig(name="s", members=(1,), tls=tls, site=site))
    assert where == field
    assert text in problem


def test_names_that_are_good():
    tls = TlsConfig(authority="a", certificate="c", private_key="k", routers=("relay",))
    assert access_problems(SwarmConfig(name="s", members=(1,), tls=tls, site="rim")) == []
    assert name_clashes(("ground", "base"), ("router",)) == []
    assert access_problems(SwarmConfig(name="s", members=(1,))) == []


def test_every_name_that_may_speak_of_a_topic_has_a_ring_and_no_other():
    tls = TlsConfig(authority="a", certificate="c", private_key="k", stations=("ground", "van"))
    stations = ["ground", "ground-$*", "van", "van-$*"]
    assert speakers_of(COMMAND, (1, 2), tls) == stations
    assert speakers_of(STATE, (1, 2), tls) == ["1", "2", *stations]
    for topic in TOPICS.values():
        allowed = access_rules("crater", (1, 2), tls)["rules"]
        keys = {key for rule in allowed if rule["id"].startswith("speak as") for key in rule["key_exprs"]}
        for name in speakers_of(topic, (1, 2), tls):
            assert keys & {topic.key("crater", name), f"flightstack/crater/*/{name}"}, name
