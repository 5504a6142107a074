"""The log of a process: one line an entry."""

from __future__ import annotations

import io
import logging

from flightstack.process_log import OneLine


def test_an_entry_is_one_line_whatever_is_in_it_and_a_traceback_stays_whole() -> None:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(OneLine("%(levelname)s: %(message)s"))
    log = logging.Logger("test")
    log.addHandler(handler)
    log.warning("drone %d: %s", 3, "\x1b[31mred\x1b[0m\n2026-01-01 ERROR forged")
    try:
        raise ValueError("in two\nlines")
    except ValueError:
        log.exception("failed")
    first, second, *trace = stream.getvalue().splitlines()
    assert first == r"WARNING: drone 3: \x1b[31mred\x1b[0m\n2026-01-01 ERROR forged"
    assert second == "ERROR: failed"
    assert trace[0].startswith("Traceback")
    assert trace[-2:] == ["ValueError: in two", "lines"]
