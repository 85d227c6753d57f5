"""Built-in grids by name: the place of their generators, and their sizes.

Help and studies name them, and should not wait for NumPy: generators are imported only when a grid is made.
"""

from __future__ import annotations

import math
import re

from ...errors import InputError

__all__ = ["BUILT_IN", "generator_of"]

BUILT_IN = {
    "onera_m6": ("bspline_mdao.core.generators.canonical.onera_m6_grid", (23, 33, 17)),
    "flat_plate": ("bspline_mdao.core.generators.canonical.flat_plate_grid", (23, 23, 23)),
}
"""Place of the generator, and nodes per block, of each built-in grid, half of the paper's."""

MOST_NODES = 2_000_000
"""Nodes per block of a built-in grid that certainly fit into memory."""


def generator_of(grid_name: str) -> tuple[str, tuple[int, int, int]]:
    """Find the generator of a built-in grid: its place, and the nodes per block."""
    match = re.fullmatch(r"@(\w+)(?::(\d{1,7})x(\d{1,7})x(\d{1,7}))?", grid_name, re.ASCII)
    if not match or match[1] not in BUILT_IN:
        names = ", ".join(f"@{name}" for name in BUILT_IN)
        raise InputError(f"{grid_name}: is no built-in grid; write one of {names}, or @NAME:IxJxK with nodes per block")
    generator, shape = BUILT_IN[match[1]]
    shape = (int(match[2]), int(match[3]), int(match[4])) if match[2] else shape
    if math.prod(shape) > MOST_NODES:
        raise InputError(f"{grid_name}: has {math.prod(shape):,} nodes per block, more than {MOST_NODES:,}; lower them")
    return generator, shape
