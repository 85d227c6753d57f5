"""Settings of the layer that follows walls, each with the case behind its default.

The effect of each setting is measured by ``benchmarks/core/sweep_settings.py``.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["LAYER", "MESH_LAYER", "LayerSettings"]


@dataclass(frozen=True)
class LayerSettings:
    """How far a layer reaches, and how it turns."""

    first_heights: float = 20.0
    """A wall's reach is the width of its quads, but at least this many first heights or `widths`, whichever is less."""

    widths: float = 3.0
    """The same in widths of quads. With half as many the smallest Q about pyHyp's M6 is 2 % less; without reach beyond
    the width of quads heights about the rotor and stator of CFL3D change by 112 %."""

    inviscid: float = 24.0
    """Widths of quads divided by first heights, exceeded at a quarter of the nodes, up to which a grid is inviscid and
    its wall has no layer. Such grids have 1 to 24."""

    viscous: float = 36.0
    """The same ratio from which on a wall has its whole reach. Grids with boundary layers have 36 to 16,000."""

    smoothings: int = 3
    """Number of times that the reach of a wall is averaged with its neighbours' reach: it then varies over several
    quads, and the layer ends smoothly. Without averaging, 13 cells of the H-H wing as wedges are inverted by a bend of
    60 degrees; grids of blocks hardly need it."""

    farthest: float = 5.0
    """A local minimum of the distance this many times as far as the nearest one has no weight, which bounds the search.
    With 2 six more cells are inverted about the rotor and stator of CFL3D, with 100 nothing changes by 0.01 %."""

    rotation_weight: float = 0.01
    """E of `.frames`: weight of the rotations relative to the normals' weight of 1. Small, to keep heights to about one
    per cent of the bending, by 1.7 % less with 0.1; not zero, since the normals do not determine the matrices."""

    folded: float = -0.5
    """Cosine of the angle between the normals of two quads of a face at a point below which the face is folded upon
    itself there: quads at a convex edge of up to 120 degrees are one side. With -0.8 heights at the sharp trailing edge
    of MACH-Aero's grid change by 12 %."""


LAYER = LayerSettings()
"""The defaults, for grids of blocks."""

MESH_LAYER = replace(LAYER, widths=6.0)
"""Settings for unstructured meshes: the lattice that moves these strains the layer more than volumes that are
fitted to the wall do. Faces of the blunt trailing edge of pyHyp's M6 are as wide as first cells are high there; 3
widths leave up to 0.24 of the map's effect on these cells. Bent by 60 degrees, heights are 0.992 at 1 %, and 0.999 with
6. With 8, a winglet inverts 109 cells above edges of the H-H wing, 78 with 6."""
