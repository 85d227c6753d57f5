"""Nodes that cannot be ones."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..topology.grid import Block

__all__ = ["MAX_COORDINATE", "find_fault"]

MAX_COORDINATE = 1e15
"""Metres; a larger coordinate is a damaged number, and its powers would overflow further on."""

MAX_IBLANK = 1_000_000
"""IBLANK is 0, 1 or the negative of a block number."""


def find_fault(blocks: Iterable[Block]) -> str | None:
    """Name the first node that is not finite, far beyond any grid, or has an IBLANK that is none.

    Parameters
    ----------
    blocks : iterable of Block
        The blocks of a grid.

    Returns
    -------
    str or None
        Block, indices (from 1) and value; None where all nodes are sound.
    """
    for number, block in enumerate(blocks, 1):
        name = f"block {number}" + (f" '{block.name}'" if block.name != f"block {number}" else "")
        is_sound = np.abs(block.nodes) <= MAX_COORDINATE
        if not is_sound.all():
            *index, axis = np.argwhere(~is_sound)[0].tolist()
            return f"{name}: node {_shown(index)} has {'xyz'[axis]} = {block.nodes[(*index, axis)]:.6g}"
        if block.iblank is not None:
            is_sound = np.abs(block.iblank.astype(np.int64)) <= MAX_IBLANK
            if not is_sound.all():
                return (
                    f"{name}: node {_shown(np.argwhere(~is_sound)[0].tolist())} has an IBLANK that is no block number"
                )
    return None


def _shown(index: list[int]) -> str:
    return "(" + ", ".join(str(i + 1) for i in index) + ")"
