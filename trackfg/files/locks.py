"""Locks that the kernel releases when their process ends, however it ends."""

from __future__ import annotations

import errno
import os
from pathlib import Path

CANNOT_LOCK = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
"""Errors of a file system, or a platform, that has no locks."""


def lock_file(descriptor: int, *, wait: bool) -> None:
    """Lock an open file or folder for this process alone.

    Raises ``BlockingIOError`` where another has locked it and we do not ``wait``, and ``OSError`` with one of
    :data:`CANNOT_LOCK` where there are no locks.
    """
    try:
        import fcntl
    except ImportError as error:
        raise OSError(errno.ENOLCK, "this platform has no fcntl") from error
    fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def locked_file(path: Path, *, wait: bool) -> int | None:
    """Open a file, which is made where there is none, lock it and return its descriptor, which holds the lock.

    The result is None where another process has locked it and we do not ``wait``, or has removed it meanwhile. On a
    file system without locks no process is excluded: with ``wait`` the descriptor is returned at once, without it None.
    Raises ``OSError`` where the file cannot be made or is a link.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        lock_file(descriptor, wait=wait)
        if os.path.samestat(os.fstat(descriptor), path.stat()):
            return descriptor
    except (BlockingIOError, FileNotFoundError):
        pass
    except OSError as error:
        if error.errno in CANNOT_LOCK and wait:
            return descriptor
        if error.errno not in CANNOT_LOCK:
            os.close(descriptor)
            raise
    os.close(descriptor)
    return None
