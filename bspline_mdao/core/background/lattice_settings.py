"""What the lattice around a mesh is like."""

from __future__ import annotations

from dataclasses import dataclass

from ...base.display import OneLine

__all__ = ["DEFAULTS", "LatticeSettings"]


@dataclass(frozen=True)
class LatticeSettings(OneLine):
    """Settings of a lattice.

    A mesh of the RAE 2822 whose two sides get bumps within one span of each other inverts 799 cells with a stiffness of
    1e6, and none with 1e2 or 1e4; with 1e2 a wing bent by 60 degrees inverts 35, and none with 1e4 or 1e6. Of 6, 8, 10
    and 13 spans, 10 leave the largest smallest volume of pyHyp's M6 bent by 60 degrees, by that before: 0.20, 0.33,
    0.38 and 0.10.

    Parameters
    ----------
    spacing : float, optional
        Width of the spans around all walls (m); by default each body has its own.
    spans : float
        Spans along the longest side of the box of each body, which is what faces of walls join.
    padding : float
        How far beyond the box of a body spans are even, by its longest side.
    growth : float
        Ratio of the widths of neighbouring spans from there on.
    stiffness : float
        Weight of the walls against the energy, for each element of the lattice that they cross.
    refined : tuple of tuple
        Where spans are narrower: direction of the lattice (0, 1 or 2), both ends of an interval in it, and the width of
        spans there (m). `MeshModel.refined_for` finds what moves ask for.

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
