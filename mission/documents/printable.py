"""Words that come from elsewhere, made safe to show.

A vehicle's text, a peer's reason or a file's name may hold control characters: an escape sequence clears a terminal
or recolours it, a line break forges a line of a log, a text direction turns what a person reads around.
"""

from __future__ import annotations


def printable(text: str) -> str:
    r"""`text` with everything that is no visible character written out as Python would: "\x1b[31m", "\n", "\u202e".

    Doing it twice changes nothing more.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
