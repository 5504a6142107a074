"""A router's file that cannot be used is one line; one that can relays until it is asked to stop."""

from __future__ import annotations

import logging
import os
import pathlib
import signal
import threading
import time

import pytest
from typer.testing import CliRunner

import gcs.router
from flightstack.transport import TransportError
from gcs.cli.main import app
from gcs.errors import GroundError
from simvehicle.survey.ports import free_port


@pytest.fixture
def file(tmp_path) -> pathlib.Path:
    """Of a router on this machine's loopback."""
    words = "--swarm s --drones 1 --first-address 127.0.0.2 --site rim --router relay=127.0.0.1"
    done = CliRunner().invoke(app, ["fleet", "init", str(tmp_path / "f"), *words.split()])
    assert done.exit_code == 0, done.output
    file = tmp_path / "f" / "relay" / "zenohd.json5"
    file.write_text(file.read_text().replace("tls/[::]:7448", f"tls/127.0.0.1:{free_port()}"))
    return file


def problem(file: pathlib.Path) -> str:
    with pytest.raises((GroundError, TransportError)) as caught:
        gcs.router.run_router(file)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_router_runs_until_a_signal_from_wherever_it_is_started(file, caplog):
    def stop() -> None:
        end_s = time.monotonic() + 30.0
        while "router ready on tls/127.0.0.1" not in caplog.text and time.monotonic() < end_s:
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGTERM)

    before = (
        signal.getsignal(signal.SIGTERM),
        signal.getsignal(signal.SIGINT),
        signal.getsignal(signal.SIGHUP),
    )
    stopper = threading.Thread(target=stop)
    try:
        with caplog.at_level(logging.INFO):
            # Started before the signals are caught, it waits for what is said after that.
            stopper.start()
            assert gcs.router.run_router(file) == 0
    finally:
        stopper.join()
        for number, handler in zip((signal.SIGTERM, signal.SIGINT, signal.SIGHUP), before, strict=True):
            signal.signal(number, handler)
    assert "router stopped" in caplog.text


def test_files_that_are_no_routers(file, tmp_path):
    assert "No such file" in problem(tmp_path / "none.json5")
    file.write_text("{")
    assert "is no configuration of zenoh" in problem(file)
    file.write_text('{mode: "router", lissten: {}}')
    assert "is no configuration of zenoh" in problem(file)
    file.write_text('{mode: "peer"}')
    assert 'mode: "peer" is no router' in problem(file)
    file.write_bytes(b"\xff")
    assert "is no text" in problem(file)


def test_a_routers_certificates_are_looked_at_first(file):
    key = file.parent / "relay.key"
    key.write_text("nonsense")
    assert "relay.key holds no private key" in problem(file)
    key.unlink()
    assert "cannot read" in problem(file)
