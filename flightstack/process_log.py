"""The log of a process on its standard error: one line an entry, whatever is in it."""

from __future__ import annotations

import logging
import sys

from mission.documents.printable import printable


class OneLine(logging.Formatter):
    """Control characters in an entry are written out: what vehicles, peers and files say must not forge lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 (logging's own name)
        record.message = printable(record.message)
        return super().formatMessage(record)


def log_to_stderr() -> None:
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(OneLine("%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
