"""Sites that a router joins: everything is heard once, within a site without the router, and its loss is told."""

from __future__ import annotations

import collections
import contextlib
import json
import logging
import pathlib
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh

from flightstack.swarm.topics import EVENT, STATE
from flightstack.transport import TransportError
from flightstack.transport.router_watch import RouterWatch
from flightstack.transport.zenoh_options import as_document, router_options
from flightstack.transport.zenoh_router import ZenohRouter
from flightstack.transport.zenoh_session import configured
from flightstack.transport.zenoh_transport import ZenohTransport
from simvehicle.survey.ports import free_port

SITES = {"1": "rim", "2": "rim", "3": "valley", "ground": "valley"}
LIMIT_S = 90.0


def eventually(condition: Callable[[], object], what: str) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {LIMIT_S} s: {what}"
        time.sleep(0.02)


class Sites:
    """Two sites of two nodes each, each with the whole list of its site, and a router that may be away."""

    def __init__(self) -> None:
        self.place = f"tcp/127.0.0.1:{free_port()}"
        endpoints = {name: f"tcp/127.0.0.1:{free_port()}" for name in SITES}
        self.router: ZenohRouter | None = None
        self.nodes = {
            name: ZenohTransport(
                "s",
                name,
                (endpoints[name],),
                [self.place, *(endpoints[other] for other in SITES if SITES[other] == site)],
                (STATE, EVENT),
                site=site,
            )
            for name, site in SITES.items()
        }
        self.sent = 0

    def start_router(self) -> None:
        self.router = ZenohRouter(configured(router_options((self.place,), ("rim", "valley"), "s")))

    def stop_router(self) -> None:
        if self.router is not None:
            self.router.close()
        self.router = None

    def hear(self) -> dict[str, set[str]]:
        """Say something everywhere; whom each node hears in this turn."""
        for node in self.nodes.values():
            node.publish(EVENT, b"still here")
        return {name: {m.sender for m in node.receive()} for name, node in self.nodes.items()}

    def everybody_hears(self, whom: Callable[[str], set[str]]) -> bool:
        heard = self.hear()
        return all(heard[name] == whom(name) for name in SITES) and all(
            node.alive() == whom(name) for name, node in self.nodes.items()
        )


def all_others(name: str) -> set[str]:
    return {*SITES} - {name}


def own_site(name: str) -> set[str]:
    return {other for other in SITES if SITES[other] == SITES[name]} - {name}


@pytest.fixture
def sites() -> Iterator[Sites]:
    joined = Sites()
    with contextlib.ExitStack() as stack:
        for node in joined.nodes.values():
            stack.callback(node.close)
        stack.callback(joined.stop_router)
        yield joined


def test_every_message_is_heard_once_by_everybody(sites):
    sites.start_router()
    eventually(lambda: sites.everybody_hears(all_others), "all hear all")
    heard: collections.Counter[tuple[str, str, bytes]] = collections.Counter()
    for number in range(50):
        for node in sites.nodes.values():
            node.publish(EVENT, b"%d" % number)
    for node in sites.nodes.values():
        node.publish(EVENT, b"end")
    ends = 3 * len(SITES)

    def listen() -> bool:
        for name, node in sites.nodes.items():
            heard.update((name, m.sender, m.payload) for m in node.receive() if m.payload != b"still here")
        return sum(count for (*_, payload), count in heard.items() if payload == b"end") >= ends

    eventually(listen, "the last messages")
    listen()
    assert len(heard) == ends * 51
    assert set(heard.values()) == {1}


def test_a_router_that_dies_parts_the_sites_and_nobody_else_and_heals_them_when_it_is_back(sites, caplog):
    eventually(lambda: sites.everybody_hears(own_site), "a site needs no router")
    sites.start_router()
    eventually(lambda: sites.everybody_hears(all_others), "the router joins the sites")
    steady_s = time.monotonic() + 3.0
    eventually(lambda: sites.hear() and time.monotonic() > steady_s, "and has done so for a while")
    caplog.clear()
    sites.stop_router()
    eventually(lambda: sites.everybody_hears(own_site), "the sites are parted")
    eventually(lambda: sites.hear() and caplog.text.count("no router since") >= len(SITES), "it is told")
    sites.start_router()
    eventually(lambda: sites.everybody_hears(all_others), "the sites are joined again")
    eventually(lambda: sites.hear() and caplog.text.count("the router is there") >= len(SITES), "that, too")


def test_a_node_of_a_site_that_the_router_does_not_know_is_told_that_it_has_no_router(sites, caplog):
    sites.start_router()
    eventually(lambda: sites.everybody_hears(all_others), "all hear all")
    stranger = ZenohTransport("s", 9, (), (sites.place,), (EVENT,), site="summit")
    try:
        eventually(
            lambda: stranger.receive() or "site summit and the others do not hear each other" in caplog.text,
            "it is told",
        )
        assert stranger.alive() == set()
    finally:
        stranger.close()


def test_a_router_says_who_came_and_who_went(sites, caplog):
    sites.start_router()
    assert sites.router is not None
    router = sites.router
    with caplog.at_level(logging.INFO, "flightstack.transport.zenoh_router"):
        eventually(lambda: router.look() or caplog.text.count("is connected") == len(SITES), "all came")
        sites.nodes["1"].close()
        eventually(lambda: router.look() or "is gone" in caplog.text, "one went")


def test_a_router_that_cannot_listen_is_one_line(sites):
    sites.start_router()
    with pytest.raises(TransportError, match=f"cannot listen on {sites.place}: the port is in use"):
        ZenohRouter(configured(router_options((sites.place,), ("rim",), "s")))
    with pytest.raises(TransportError, match=r"swarm\.listen: 'x' is no endpoint"):
        router_options(("x",), ("rim",), "s")


def test_options_are_a_file_that_zenoh_reads(tmp_path):
    options = router_options(("tcp/127.0.0.1:7448",), ("rim", "valley"), "s")
    file = pathlib.Path(tmp_path / "zenohd.json5")
    file.write_text(json.dumps(as_document(options)))
    config = zenoh.Config.from_file(str(file))
    for path, value in options.items():
        read = json.loads(config.get_json(path))
        assert isinstance(value, dict) or read == value
    assert json.loads(config.get_json("transport/link/tx/lease")) == 1000


def test_the_documented_file_of_a_router_is_one_that_joins_the_sites():
    text = (pathlib.Path(__file__).parents[4] / "docs" / "sites.md").read_text()
    document = text.partition("```json5\n")[2].partition("```")[0]
    config = zenoh.Config.from_json5(document)
    options = router_options(("tcp/[::]:7448",), ("rim", "valley"), "s")
    for path in (
        "mode",
        "listen/endpoints",
        "gateway",
        "scouting/multicast/enabled",
        "transport/link/tx/lease",
    ):
        assert config.get_json(path) == configured(options).get_json(path)


def test_a_router_that_is_gone_for_a_moment_is_not_told(caplog):
    connected = False
    watch = RouterWatch(lambda: connected, "rim")

    def hold(state: bool, begin_s: float, end_s: float) -> None:
        nonlocal connected
        connected = state
        for tenth in range(round(10 * begin_s), round(10 * end_s)):
            watch.look(tenth / 10)

    hold(False, 0.0, 3.0)
    hold(True, 3.0, 30.0)
    hold(False, 30.0, 32.0)
    hold(True, 32.0, 40.0)
    assert caplog.text == ""
    hold(False, 40.0, 60.0)
    assert caplog.text.count("no router since 5 s: site rim") == 1
    for second in range(60, 70):
        hold(second % 2 == 0, second, second + 1.0)
    assert "the router is there" not in caplog.text
    hold(True, 70.0, 80.0)
    assert caplog.text.count("the router is there") == 1
    assert caplog.text.count("no router since") == 1
