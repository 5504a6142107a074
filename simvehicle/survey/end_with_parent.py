"""Start a command that dies with its parent: `python end_with_parent.py PARENT_PID COMMAND…`.

A launcher that is killed with SIGKILL cannot end its children. On Linux the kernel does it (prctl
PR_SET_PDEATHSIG, kept across exec); elsewhere the command is just started. It is a script of its own because
code between fork and exec (`preexec_fn`) is unsafe in a process that has threads.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main() -> None:
    parent, command = int(sys.argv[1]), sys.argv[2:]
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
            raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
        if os.getppid() != parent:  # it died before we were tied to it
            sys.exit(1)
    os.execv(command[0], command)  # noqa: S606 (the launcher's own command line)


if __name__ == "__main__":
    main()
