"""H-H grids one cell deep about a section: a wing of infinite span, flow in a plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..topology.index_space import Window
from ..topology.multiblock import Block, Grid
from .hh_sheets import FarField, Spacing
from .hh_wing import hh_wing_grid
from .planform import Planform
from .section import Section
from .wing_surface import Wing

__all__ = ["infinite_wing_grid"]

_INBOARD = 6
"""Blocks of the wing's grid inboard of the tip."""


def infinite_wing_grid(
    section: Section, shape=(33, 25), spacing: Spacing | None = None, far_field: FarField | None = None
) -> Grid:
    """Make the grid at the root of a rectangular wing of unit chord, between two planes of symmetry.

    Parameters
    ----------
    section : Section
        Section of the wing.
    shape : tuple
        Nodes per block along the stream and away from the wing, as in `hh_wing_grid`.
    spacing : Spacing, optional
        Intervals next to the wing; those along the span do not matter.
    far_field : FarField, optional
        Outer boundary.

    Returns
    -------
    Grid
        Six blocks from z = 0 to z = 1 with the patches of `hh_wing_grid`. Coefficients of the section are those by a
        reference area of 1.

    Raises
    ------
    InputError
        If the counts are too small or the spacings do not fit them.
    """
    wing = Wing(Planform(root_chord=1.0, semi_span=3.0), section)
    whole = hh_wing_grid(wing, (*shape, 9), spacing, far_field)
    blocks = tuple(Block(_between_planes(block.nodes[:, :, 0]), block.name) for block in whole.blocks[:_INBOARD])
    patches = tuple(replace(patch, windows=_one_deep(patch.windows, patch.kind)) for patch in whole.patches)
    return Grid(blocks, patches, source="H-H grid of a section")


def _between_planes(nodes: np.ndarray) -> np.ndarray:
    """Nodes of one cell along the span, shape (ni, nj, 2, 3), from those at the root."""
    return np.stack([nodes * [1.0, 1.0, 0.0] + [0.0, 0.0, z] for z in (0.0, 1.0)], axis=2)


def _one_deep(windows, kind: str) -> tuple[Window, ...]:
    """Faces of the inboard blocks; of symmetry planes both."""
    ends = ((0, 0), (1, 1)) if kind == "symmetry" else ((0, 1),)
    return tuple(
        Window(window.block, (*window.lo[:2], low), (*window.hi[:2], high))
        for window in windows
        if window.block < _INBOARD
        for low, high in ends
    )
