"""The two grids of the paper's examples (section IV): about the ONERA M6 wing and about a flat plate."""

from __future__ import annotations

import numpy as np

from ..grids.multiblock import Grid
from .hh_wing import FarField, Spacing, hh_wing_grid
from .onera_m6 import onera_d_section, onera_m6_planform
from .planform import Planform
from .section import flat_section
from .wing_surface import Wing

__all__ = ["flat_plate_grid", "onera_m6_grid"]


def onera_m6_grid(shape=(45, 65, 33), spacing: Spacing | None = None, far_field: FarField | None = None) -> Grid:
    """Make the H-H grid of section IV.A about the ONERA M6 wing of unit root chord.

    Parameters
    ----------
    shape : tuple
        Nodes per block along the stream, away from the wing and along the span; see `hh_wing_grid`.
    spacing : Spacing, optional
        The paper's by default (0.001 off the wall, at the leading edge, the trailing edge and the tip), wider in
        proportion on coarser grids.
    far_field : FarField, optional
        Outer boundary, 10 root chords away by default.

    Returns
    -------
    Grid
        Twelve blocks.
    """
    wing = Wing(onera_m6_planform(), onera_d_section())
    return hh_wing_grid(wing, shape, spacing or _coarsened(Spacing(), shape, (45, 65, 33)), far_field or FarField())


def flat_plate_grid(shape=(45, 45, 45), spacing: Spacing | None = None, far_field: FarField | None = None) -> Grid:
    """Make the H-H grid of section IV.B about a flat plate of unit chord and semi-span 2.

    Parameters
    ----------
    shape : tuple
        Nodes per block along the stream, away from the wing and along the span; see `hh_wing_grid`.
    spacing : Spacing, optional
        The paper's by default (0.001 off the wall, 0.005 at the leading edge, the trailing edge and the tip), wider in
        proportion on coarser grids.
    far_field : FarField, optional
        Outer boundary, 10 chords away by default.

    Returns
    -------
    Grid
        Twelve blocks. The two sides of the plate coincide and are declared as walls.
    """
    wing = Wing(Planform(root_chord=1.0, semi_span=2.0), flat_section())
    paper = Spacing(off_wall=1e-3, leading=5e-3, trailing=5e-3, tip=5e-3)
    return hh_wing_grid(wing, shape, spacing or _coarsened(paper, shape, (45, 45, 45)), far_field or FarField())


def _coarsened(spacing, shape, paper_shape):
    """Widen the paper's spacings in proportion where there are fewer nodes than in the paper."""
    stream, normal, span = (max((m - 1) / max(np.min(n) - 1, 1), 1.0) for n, m in zip(shape, paper_shape))
    return Spacing(spacing.off_wall * normal, spacing.leading * stream, spacing.trailing * stream, spacing.tip * span)
