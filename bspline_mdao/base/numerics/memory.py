"""Available memory of this machine."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["available_bytes"]

MEMINFO = Path("/proc/meminfo")
GROUP = Path("/sys/fs/cgroup")
"""Where Linux reports the memory of the machine, and of a container or job (cgroups version 2)."""


def available_bytes() -> int:
    """Memory available without swapping (bytes): of the machine, or less if a job or container is limited."""
    # If the system does not report free memory, the total is used.
    if MEMINFO.exists():
        lines = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines() if ":" in line)
        free = 1024 * int(lines["MemAvailable"].split()[0])
    else:
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return min(free, _left_of_group(free))


def _left_of_group(free: int) -> int:
    """Memory the group of this process may still use; ``free`` if it has no limit."""
    try:
        limit, used = ((GROUP / name).read_text().strip() for name in ("memory.max", "memory.current"))
    except OSError:
        return free
    return free if limit == "max" else max(int(limit) - int(used), 0)
