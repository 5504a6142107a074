"""Opening and closing a zenoh session, with zenoh's errors in one line and no wait for who is gone."""

from __future__ import annotations

import json
import logging
import re
import threading
from collections.abc import Sequence
from typing import Any, Final

import zenoh

from flightstack.transport import TransportError

log = logging.getLogger(__name__)

CLOSE_WITHIN_S: Final = 2.0


def configured(options: dict[str, Any]) -> zenoh.Config:
    """zenoh's defaults with `options`, as of `zenoh_options`, in their place."""
    config = zenoh.Config()
    for path, value in options.items():
        config.insert_json5(path, json.dumps(value))
    return config


def open_session(config: zenoh.Config, listen: Sequence[str]) -> zenoh.Session:
    """A session that listens on `listen`. `TransportError` says in one line why it cannot be opened."""
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        place = f"cannot listen on {', '.join(listen)}" if listen else "cannot join the swarm's network"
        raise TransportError(f"{place}: {zenoh_reason(error)}") from error


def zenoh_reason(error: Exception) -> str:
    """zenoh's message in one line, without the places in its sources, and with the mend for the usual case."""
    text = re.sub(r" at /\S+?\.rs:\d+\.?", "", " ".join(str(error).split()))
    if "Address already in use" in text:
        return "the port is in use; end the other process or choose another port"
    if "Cannot assign requested address" in text:
        return "this machine does not have that address; use one of its own"
    return text


def close_session(session: zenoh.Session, what: str) -> None:
    """Close, but wait no longer than `CLOSE_WITHIN_S` for it: zenoh may wait for a peer that is gone."""

    def run() -> None:
        try:
            session.close()  # type: ignore[no-untyped-call]  # of zenoh's stub
        except zenoh.ZError as error:
            log.warning("%s: %s", what, zenoh_reason(error))

    thread = threading.Thread(target=run, name="zenoh-close", daemon=True)
    thread.start()
    thread.join(CLOSE_WITHIN_S)
    if thread.is_alive():
        log.warning("%s takes longer than %g s; going on without", what, CLOSE_WITHIN_S)
