"""Locks that the kernel releases when their process ends, however it ends."""

from __future__ import annotations

import errno

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
