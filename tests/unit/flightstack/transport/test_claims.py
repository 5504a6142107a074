"""One device or port that two are to have is found, however it is spelled."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator

import pytest

from flightstack.transport.claims import Claim, clashes, endpoint_claim, link_claim, port_claim

KINDS = {"link": link_claim, "port": port_claim, "listen": endpoint_claim}


def claims(*texts: str) -> Iterator[Claim]:
    """Each text begins with what it is: a link, an instrument's port, an endpoint that is listened on."""
    for index, text in enumerate(texts):
        kind, _, written = text.partition(" ")
        yield from KINDS[kind](f"field{index}", written)


@pytest.mark.parametrize(
    "texts",
    [
        ("link /dev/ttyUSB0,57600", "port /dev/ttyUSB0"),
        ("link /dev/ttyUSB0,57600", "port /dev/../dev/ttyUSB0"),
        ("port /dev//ttyUSB0", "port /dev/./ttyUSB0"),
        ("link COM3,57600", "port com3"),
        ("port spy:///dev/ttyUSB0?file=log", "port /dev/ttyUSB0"),
        ("port socket://10.0.0.5:9001", "port socket://10.0.0.5:9001"),
        ("port socket://localhost:9001", "port socket://127.0.0.1:09001"),
        ("link tcp:10.0.0.5:5760", "port socket://10.0.0.5:5760"),
        ("link udpin:0.0.0.0:14550", "link udpin:127.0.0.1:14550"),
        ("link udpin:127.0.0.1:7447", "listen udp/0.0.0.0:7447"),
        ("link tcpin:0.0.0.0:7447", "listen tcp/192.168.2.11:7447"),
        ("listen tcp/127.0.0.1:7447", "listen tls/127.0.0.1:7447"),
        ("listen tcp/[::]:7447", "listen tcp/10.0.0.1:7447"),
    ],
)
def test_one_thing_under_two_names(texts: tuple[str, str]) -> None:
    ((field, problem),) = clashes(claims(*texts))
    assert field == "field1"
    assert "field0" in problem
    assert "give each its own" in problem


@pytest.mark.parametrize(
    "texts",
    [
        ("link /dev/ttyUSB0,57600", "port /dev/ttyUSB1"),
        ("port socket://10.0.0.5:9001", "port socket://10.0.0.5:9002"),
        ("port socket://10.0.0.5:9001", "port socket://10.0.0.6:9001"),
        ("link udpin:127.0.0.1:14550", "link udpin:127.0.0.2:14550"),
        ("link udpin:127.0.0.1:14550", "listen tcp/127.0.0.1:14550"),
        ("port socket://127.0.0.1:0", "port socket://127.0.0.1:0"),
        ("port loop://", "port loop://"),
        ("port mavlink", "port mavlink"),
        ("link udpout:10.0.0.1:14550", "link udpin:0.0.0.0:14550"),
    ],
)
def test_two_things_are_two(texts: tuple[str, str]) -> None:
    assert list(clashes(claims(*texts))) == []


def test_a_symbolic_link_is_its_device(tmp_path: pathlib.Path) -> None:
    device = tmp_path / "ttyACM0"
    device.touch()
    (tmp_path / "by-id").symlink_to(device)
    ((_, problem),) = clashes(claims(f"link {device},115200", f"port {tmp_path / 'by-id'}"))
    assert "is the same device" in problem
