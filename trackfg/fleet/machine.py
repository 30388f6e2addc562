"""A machine smooths as many runs at a time as it has cores, and memory for."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_MEMORY_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
"""What a container may take: cgroup version 2 and version 1."""


def processes(memory_bytes: int) -> int:
    """Return how many processes of that memory each can run here, at least one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    available = _available_bytes()
    return cores if available is None else max(1, min(cores, available // memory_bytes))


def _available_bytes() -> int | None:
    """Return the memory that is free or can be freed; None where the system does not say."""
    figures = []
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text().splitlines()
        figures += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    for limit in _MEMORY_LIMITS:
        with suppress(OSError, ValueError):
            figures.append(int(Path(limit).read_text()))
    return min(figures, default=None)
