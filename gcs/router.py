"""The router between a swarm's sites as a process: zenoh's own, from the file that `zenohd` would read."""

from __future__ import annotations

import json
import logging
import pathlib
import time
from typing import Final

import zenoh

from flightstack.config import TlsConfig
from flightstack.stop_signals import StopSignals
from flightstack.transport.certificates import check_certificates
from flightstack.transport.zenoh_router import ZenohRouter
from gcs.errors import GroundError

log = logging.getLogger("gcs.router")

_PERIOD_S: Final = 0.2


def run_router(file: pathlib.Path) -> int:
    """Relay until a signal; returns the exit code. What is wrong with the file is told in one line.

    Files that it names are beside it, as `zenohd` finds them when it is started there.
    """
    stop = StopSignals()
    stop.install()
    config = _read(file)
    router = ZenohRouter(config)
    try:
        listens = json.loads(config.get_json("listen/endpoints"))
        log.info("router ready on %s", ", ".join(listens))
        while not stop.asked:
            router.look()
            time.sleep(_PERIOD_S)
    finally:
        router.close()
    log.info("router stopped")
    return 0


def _read(file: pathlib.Path) -> zenoh.Config:
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise GroundError(f"{file}: {getattr(error, 'strerror', None) or 'is no text'}") from error
    try:
        config = zenoh.Config.from_json5(text)
        mode = json.loads(config.get_json("mode"))
        written = json.loads(config.get_json("transport/link/tls"))
    except zenoh.ZError as error:
        raise GroundError(f"{file}: is no configuration of zenoh: {' '.join(str(error).split())}") from error
    if mode != "router":
        raise GroundError(f'{file}: mode: "{mode}" is no router; gcs fleet writes a router\'s file')
    placed = {
        key: str(file.parent / value)
        for key, value in written.items()
        if value is not None and key.endswith(("certificate", "private_key"))
    }
    for key, value in placed.items():
        config.insert_json5(f"transport/link/tls/{key}", json.dumps(value))
    if "listen_certificate" in placed:
        check_certificates(
            TlsConfig(
                authority=placed.get("root_ca_certificate", ""),
                certificate=placed["listen_certificate"],
                private_key=placed.get("listen_private_key", ""),
            )
        )
    return config
