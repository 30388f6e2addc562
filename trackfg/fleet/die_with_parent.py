"""Start a command that ends when its parent does, however that ends: a script of its own, run before the command.

    python -I -S die_with_parent.py PARENT COMMAND [ARGUMENT...]

PARENT is the id of the parent's process. Linux alone can promise this (prctl(2), PR_SET_PDEATHSIG); elsewhere the
command just runs.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1
"""Send a signal to this process when its parent ends; kept over execve (Linux, prctl.h)."""


def die_with(parent: int) -> None:
    """End this process when its parent, which has this id, does."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            sys.exit("the parent has ended")


if __name__ == "__main__":
    die_with(int(sys.argv[1]))
    os.execvp(sys.argv[2], sys.argv[2:])
