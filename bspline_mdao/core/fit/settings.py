"""Settings of the fit that no option of its users asks for, each with the case behind its default.

What a setting brings is measured by ``benchmarks/core/sweep_settings.py``. What users choose, and a model records,
is `bspline_mdao.core.model.records.FitSettings`.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FITTING", "FittingSettings"]


@dataclass(frozen=True)
class FittingSettings:
    """How numbers of control points are chosen, control meshes kept valid, and parameters corrected."""

    cells_per_span: float = 4
    """Cells along a knot span where the number of control points is chosen from the grid."""

    short_order: int = 3
    """Order of short directions."""

    long_order: int = 4
    """Order of long ones."""

    long: int = 13
    """Nodes from which on a direction is long; shorter ones fold at order 4."""

    few_planes: int = 6
    """A direction with no more nodes than this keeps one control point per node, where its order is asked for."""

    largest_choice: int = 2**29
    """Bytes of the largest Gram matrix that chosen numbers lead to; it takes some seconds to factorize."""

    largest_factor: int = 2**30
    """Bytes of one factor of the mover that numbers chosen from the grid lead to; five increments keep five."""

    small_mesh: int = 10_000
    """Control points below which a factor is not predicted: it takes less than 0.2 GB."""

    factor_growth: float = 4.2
    """Power of the spans per direction with which a factor grows, about."""

    most_cells_per_span: float = 64
    """Most cells along a span; numbers do not fall any further."""

    largest_miss: float = 4.0
    """Residual, by the width of the cells, beyond which numbers are raised: on the grids about the M6 with first cells
    1e-5 high, elasticity folds 685 cells in twelve moves where it is 7.3, and 4 where it is 3.9."""

    layer: float = 1e-3
    """Height of the flattest cell, by its width, of grids whose numbers may be raised: those with boundary layers.
    Generated grids for inviscid flow have cells of 1.2e-3, those with first cells 1e-3 high of 5e-4."""

    largest_line_miss: float = 1.0
    """Up to how much, by the width of the cells, a raised direction may miss its lines. With 3 too little is gained."""

    most_per_node: tuple[float, ...] = (0.5, 0.75, 1.0)
    """Most control points by the nodes of a raised direction: each is tried where those before do not do."""

    points_per_rise: int = 12
    """A number rises by one for each so many control points, and by one at least, from trial to trial. With twice as
    many no grid changes, and there are more trials; with half as many there are 7 % more control points than needed."""

    margin: float = 0.3
    """A control element moves to its base where its smallest corner triple product is below this part of that there.
    With half of it the worst element of MACH-Aero's grid is 43 % worse, with twice as much CFL3D's S-duct is missed by
    53 % more."""

    least_margin: float = 1e-3
    """The same where the base is the coarse grid, which is far from the grid itself: with 0.3 CFL3D's S-duct is missed
    by 41 % more."""

    largest_margin: float = 0.85
    """The same where least squares move: next to their folds they are uneven, which a mover turns into flat cells.
    With half of it the worst element of MACH-Aero's grid is 62 % worse."""

    retreat: float = 0.25
    """Part of the way to the base by which the points of such an element move in one round. With half of it the worst
    element about the NACA 0012 of MACH-Aero is 39 % worse, with twice as much CFL3D's S-duct is missed by 44 % more."""

    fade: float = 0.25
    """How much less far their neighbours move. With half of it MACH-Aero's grid is missed by 47 % more, with twice as
    much its worst element is 23 % worse."""

    largest_step: float = 0.45
    """Largest step of a parameter relative to the distances of its neighbours: the order along grid lines is kept. With
    half of it CFL3D's S-duct is missed by 31 % more after a cycle."""

    close: float = 1e-3
    """A node closer than this part of the initial RMS distance of its section is left alone: a fit of the M6 with two
    cycles takes 12 to 20 % less time, and its errors are the same to 1e-5."""

    correction_steps: int = 3
    """Gauss-Newton steps in each cycle. With one CFL3D's S-duct is missed by 32 % more after a cycle."""


FITTING = FittingSettings()
"""The defaults."""
