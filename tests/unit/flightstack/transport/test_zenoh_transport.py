"""zenoh's transport by itself: what a person can get wrong, encryption, and what it does to sockets."""

from __future__ import annotations

import logging
import os
import pathlib
import socket
import struct
import time
from collections.abc import Callable

import pytest

from flightstack.config import TlsConfig
from flightstack.swarm.topics import COMMAND, EVENT, STATE, Received
from flightstack.transport import TransportError
from flightstack.transport.backlog import KEPT_PER_SENDER, trimmed
from flightstack.transport.linger import stop_lingering
from flightstack.transport.zenoh_transport import ZenohTransport
from simvehicle.survey.ports import free_port

CERTIFICATES = pathlib.Path(__file__).parents[3] / "data" / "tls"


def free_endpoint(protocol: str = "tcp") -> str:
    return f"{protocol}/127.0.0.1:{free_port()}"


def eventually(condition: Callable[[], object], limit_s: float = 20.0) -> bool:
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.01)
    return True


def tls(name: str, authority: str = "authority") -> TlsConfig:
    return TlsConfig(
        authority=str(CERTIFICATES / f"{authority}.pem"),
        certificate=str(CERTIFICATES / f"{name}.pem"),
        private_key=str(CERTIFICATES / f"{name}.key"),
    )


@pytest.mark.parametrize(
    ("listen", "connect", "encrypted", "text"),
    [
        (("rubbish",), (), False, "swarm.listen: 'rubbish' is no endpoint"),
        (("tcp/127.0.0.1",), (), False, "swarm.listen: 'tcp/127.0.0.1' is no endpoint"),
        ((), ("tcp/10.0.0.3:99999",), False, "swarm.connect: 'tcp/10.0.0.3:99999' is no endpoint"),
        ((), ("10.0.0.3:7447",), False, "is no endpoint"),
        (("tcp/192.0.2.1:7447",), (), False, "this machine does not have that address"),
        (("tls/127.0.0.1:7447",), (), False, "needs swarm.tls"),
        (("tcp/127.0.0.1:7447",), (), True, "is not encrypted although swarm.tls is set"),
    ],
)
def test_a_wrong_endpoint_is_one_clear_line(listen, connect, encrypted, text):
    with pytest.raises(TransportError) as caught:
        ZenohTransport("s", 1, listen, connect, (STATE,), tls("drone-1") if encrypted else None)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
    assert ".rs" not in str(caught.value)


def test_a_port_in_use_is_named_with_the_mend():
    endpoint = free_endpoint()
    first = ZenohTransport("s", 1, (endpoint,), (), (STATE,))
    try:
        with pytest.raises(TransportError, match=f"cannot listen on {endpoint}: the port is in use"):
            ZenohTransport("s", 2, (endpoint,), (), (STATE,))
    finally:
        first.close()


@pytest.mark.parametrize(("swarm", "node"), [("a b", 1), ("a/b", 1), ("", 1), ("s", "x/*"), ("s", "")])
def test_names_that_would_be_patterns_are_refused(swarm, node):
    with pytest.raises(TransportError, match="use letters, digits, - and _ only"):
        ZenohTransport(swarm, node, (), (), (STATE,))


def test_a_missing_certificate_is_named(tmp_path):
    config = TlsConfig(authority=str(tmp_path / "none.pem"), certificate="x", private_key="y")
    with pytest.raises(TransportError, match=r"swarm\.tls: cannot read .*none\.pem: No such file"):
        ZenohTransport("s", 1, (free_endpoint("tls"),), (), (STATE,), config)


def test_members_hear_each_other_over_tls_and_a_stranger_hears_and_says_nothing():
    endpoint = free_endpoint("tls")
    member = ZenohTransport("s", 1, (endpoint,), (), (EVENT,), tls("drone-1"), (1, 2, 3))
    other = ZenohTransport("s", 2, (), (endpoint,), (EVENT,), tls("drone-2"), (1, 2, 3))
    # A stranger who even trusts the swarm's authority, but whose own certificate somebody else signed.
    stranger = ZenohTransport("s", 3, (), (endpoint,), (EVENT,), tls("stranger", "authority"), (1, 2, 3))
    try:
        heard: list[Received] = []
        strange: list[Received] = []

        def exchange() -> bool:
            for node in (member, other, stranger):
                node.publish(EVENT, b"x")
            heard.extend(member.receive() + other.receive())
            strange.extend(stranger.receive())
            return {m.sender for m in heard} >= {"1", "2"}

        assert eventually(exchange)
        assert eventually(lambda: exchange() and len(heard) >= 100), (
            "long enough for the stranger to be heard"
        )
        assert {m.sender for m in heard} == {"1", "2"}
        assert strange == []
        assert member.alive() == {"2"}
    finally:
        for node in (member, other, stranger):
            node.close()


def test_a_list_that_names_the_node_itself_means_the_earlier_ones():
    """The same list everywhere: each pair has one connection, from the later to the earlier."""
    endpoints = [free_endpoint() for _ in range(4)]
    nodes = [ZenohTransport("s", n, (e,), endpoints, (STATE,)) for n, e in enumerate(endpoints)]
    try:
        everybody = {str(n) for n in range(4)}
        assert eventually(lambda: all(node.alive() == everybody - {node.node} for node in nodes))
        for node in nodes:
            links = node._session.info.links()
            assert len(links) == 3
            towards = {link.dst for link in links} & set(endpoints)
            assert towards == set(endpoints[: int(node.node)])
    finally:
        for node in nodes:
            node.close()


def lingering() -> int:
    count = 0
    for name in os.listdir("/dev/fd"):
        try:
            connection = socket.socket(fileno=os.dup(int(name)))
        except OSError:
            continue
        with connection:
            if connection.family == socket.AF_INET and connection.type == socket.SOCK_STREAM:
                on, seconds = struct.unpack(
                    "ii", connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                )
                count += bool(on and seconds)
    return count


def test_no_connection_of_a_running_transport_lingers():
    """Or a peer that vanishes would stop reception from all others for ten seconds."""
    endpoint = free_endpoint()
    nodes = [
        ZenohTransport("s", 1, (endpoint,), (), (STATE,)),
        ZenohTransport("s", 2, (), (endpoint,), (STATE,)),
    ]
    try:
        assert eventually(lambda: all(node.alive() for node in nodes))
        assert eventually(lambda: [node.receive() for node in nodes] and lingering() == 0)
    finally:
        for node in nodes:
            node.close()


def test_only_the_linger_option_is_taken_off():
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()) as client,
    ):
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 10))
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        assert stop_lingering() == 1
        assert stop_lingering() == 0
        assert client.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        accepted, _ = server.accept()
        client.sendall(b"still works")
        assert accepted.recv(100) == b"still works"
        accepted.close()


def test_reliable_messages_beyond_the_outbox_are_counted_as_lost_in_the_log(caplog, monkeypatch):
    transport = ZenohTransport("s", 1, (), (), ())
    monkeypatch.setattr(transport._outbox, "_thread", object())  # as if it were stuck with a stalled peer
    with caplog.at_level(logging.ERROR):
        for _ in range(transport._outbox.CAPACITY + 1):
            transport.publish(COMMAND, b"x")
    assert [r.getMessage() for r in caplog.records] == [
        "a message on flightstack/s/command/1 is lost: 1000 wait unsent"
    ]
    monkeypatch.setattr(transport._outbox, "_thread", None)
    transport.close()


def test_a_network_that_fails_is_told_once_and_raises_nothing(caplog):
    transport = ZenohTransport("s", 1, (), (), ())
    transport.publish(STATE, b"x")
    transport._session.close()  # as if zenoh had given up
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            transport.publish(STATE, b"x")
    assert [r.getMessage().startswith("state messages cannot be sent: ") for r in caplog.records] == [True]
    transport.close()


def test_trimming_keeps_order_all_reliable_and_the_newest_of_the_rest():
    messages = [Received(STATE, "1", b"%d" % n) for n in range(10)]
    messages.insert(0, Received(EVENT, "1", b"first"))
    messages.insert(3, Received(STATE, "2", b"other"))
    kept = trimmed(messages)
    assert [m.payload for m in kept] == [
        b"first",
        b"other",
        *(b"%d" % n for n in range(10 - KEPT_PER_SENDER, 10)),
    ]
