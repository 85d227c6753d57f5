"""Names of all variables that cross a component boundary.

Each but the last is a flat vector of length ``3 n`` in metres, x, y and z interleaved, as in MPhys, ADflow and DAFoam.
"""

GRID_INITIAL = "grid_initial"
"""Nodes of the baseline grid: blocks in file order, each in C order of ``(i, j, k)``."""

GRID = "grid"
"""Nodes of the regenerated grid, in the order of `GRID_INITIAL`."""

CONTROL_POINTS_INITIAL = "control_points_initial"
"""Control points fitted to the baseline grid, each shared one once."""

CONTROL_POINTS = "control_points"
"""Control points after movement, in the order of `CONTROL_POINTS_INITIAL`."""

SURFACE_CONTROL_POINTS = "surface_control_points"
"""The control points on the design surface."""

SURFACE = "surface"
"""Nodes of the regenerated surface, each once, in the order of a `bspline_mdao.measures.SurfaceGrid`."""

CONTROL_CORNER_KS = "control_corner_ks"
"""Smooth lower bound of the corner triple products of the control mesh after movement, a number."""

ALL_NAMES = (
    GRID_INITIAL,
    GRID,
    CONTROL_POINTS_INITIAL,
    CONTROL_POINTS,
    SURFACE_CONTROL_POINTS,
    SURFACE,
    CONTROL_CORNER_KS,
)
"""All names above; design variables and measures have names of their own."""
