"""Memory that this machine has left."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["available_bytes"]

MEMINFO = Path("/proc/meminfo")
GROUP = Path("/sys/fs/cgroup")
"""Where Linux tells of the machine's memory, and of that of a container or job (version 2 of its groups)."""


def available_bytes() -> int:
    """Memory that can be had without swapping (bytes): of the machine, or less where a job or container is limited."""
    # Where the system does not tell what is free it is all that there is.
    if MEMINFO.exists():
        lines = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines() if ":" in line)
        free = 1024 * int(lines["MemAvailable"].split()[0])
    else:
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return min(free, _left_of_group(free))


def _left_of_group(free: int) -> int:
    """What the group of this process may still take; ``free`` where it has no limit."""
    try:
        limit, used = ((GROUP / name).read_text().strip() for name in ("memory.max", "memory.current"))
    except OSError:
        return free
    return free if limit == "max" else max(int(limit) - int(used), 0)
