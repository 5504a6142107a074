"""The same conditions on every machine.

Property tests take the same examples everywhere; HYPOTHESIS_PROFILE=explore looks for new ones. Ctrl-C works in the
processes that tests start, also where the tests themselves run in the background of a shell, which ignores it.
"""

from __future__ import annotations

import os
import signal

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # children would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)
