"""The paper's examples (section IV): grids about the ONERA M6 wing and a flat plate, and what the M6 becomes."""

from __future__ import annotations

import numpy as np

from ..topology.multiblock import Grid
from .hh_wing import FarField, Spacing, hh_wing_grid
from .onera_m6 import onera_d_section, onera_m6_planform
from .planform import Planform
from .section import flat_section, naca_section
from .wing_surface import Wing

__all__ = ["flat_plate_grid", "onera_m6_grid", "rectangular_wing"]


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


def rectangular_wing() -> Wing:
    """Make the wing that the ONERA M6 becomes in section IV.A, in root chords of the M6.

    Returns
    -------
    Wing
        Rectangular, of NACA 0012 sections and chord 0.49664, the leading edge at x = 0. The span stays that of the M6,
        which makes the semi-span 2.989 chords: the move is one of sweep, scale and section.
    """
    return Wing(Planform(root_chord=0.49664, semi_span=onera_m6_planform().semi_span), naca_section(0.12))


def _coarsened(spacing, shape, paper_shape):
    """Widen the paper's spacings in proportion where there are fewer nodes than in the paper."""
    stream, normal, span = (max((m - 1) / max(np.min(n) - 1, 1), 1.0) for n, m in zip(shape, paper_shape))
    return Spacing(spacing.off_wall * normal, spacing.leading * stream, spacing.trailing * stream, spacing.tip * span)
