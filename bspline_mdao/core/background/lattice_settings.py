"""Settings of the lattice around a mesh."""

from __future__ import annotations

from dataclasses import dataclass

from ...base.display import OneLine

__all__ = ["DEFAULTS", "LatticeSettings"]


@dataclass(frozen=True)
class LatticeSettings(OneLine):
    """Settings of a lattice.

    For a mesh of the RAE 2822 with bumps on both sides within one span of each other, 799 cells are inverted with a
    stiffness of 1e6, and none with 1e2 or 1e4. For a wing bent by 60 degrees, 35 are inverted with 1e2, and none with
    1e4 or 1e6. For pyHyp's M6 bent by 60 degrees, the smallest volume relative to the baseline is 0.20, 0.33, 0.38 and
    0.10 with 6, 8, 10 and 13 spans: 10 is best.

    Parameters
    ----------
    spacing : float, optional
        Width of the spans around all walls (m); by default each body has its own width.
    spans : float
        Number of spans along the longest side of each body's box; a body is a connected set of wall faces.
    padding : float
        Distance beyond the box of a body to which spans are even, relative to its longest side.
    growth : float
        Ratio of the widths of neighbouring spans beyond that.
    stiffness : float
        Weight of the walls relative to the energy, for each lattice element that they cross.
    refined : tuple of tuple
        Where spans are narrower: direction of the lattice (0, 1 or 2), both ends of an interval in it, and the width of
        spans there (m). `MeshModel.refined_for` finds the refinement needed by moves.

    Examples
    --------
    >>> from bspline_mdao.meshes import LatticeSettings
    >>> LatticeSettings(spacing=0.05, refined=((0, 9.5, 10.5, 0.02),)).growth
    1.8
    """

    spacing: float | None = None
    spans: float = 10.0
    padding: float = 0.1
    growth: float = 1.8
    stiffness: float = 1e4
    refined: tuple[tuple[int, float, float, float], ...] = ()


DEFAULTS = LatticeSettings()
