"""Settings of the fit without an option for users, each with the case behind its default.

The effect of each setting is measured by ``benchmarks/core/sweep_settings.py``. Settings that users choose, and a model
records, are in `bspline_mdao.core.model.records.FitSettings`.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FITTING", "FittingSettings"]


@dataclass(frozen=True)
class FittingSettings:
    """Choice of numbers of control points, validity of control meshes, and correction of parameters."""

    cells_per_span: float = 4
    """Cells along a knot span if the number of control points is chosen from the grid."""

    short_order: int = 3
    """Order of short directions."""

    long_order: int = 4
    """Order of long directions."""

    long: int = 13
    """Nodes from which on a direction is long; shorter ones fold at order 4."""

    few_planes: int = 6
    """A direction with at most this many nodes keeps one control point per node if its order is requested."""

    largest_choice: int = 2**29
    """Bytes of the largest Gram matrix with chosen numbers; it takes some seconds to factorize."""

    largest_factor: int = 2**30
    """Bytes of one factor of the mover with numbers chosen from the grid; five increments keep five."""

    small_mesh: int = 10_000
    """Control points below which a factor is not predicted: it takes less than 0.2 GB."""

    factor_growth: float = 4.2
    """Approximate power of the spans per direction with which a factor grows."""

    most_cells_per_span: float = 64
    """Most cells along a span; numbers do not become smaller."""

    largest_miss: float = 4.0
    """Residual, relative to the width of the cells, beyond which numbers are raised: on the grids about the M6 with
    first cells 1e-5 high, elasticity folds 685 cells in twelve moves with a residual of 7.3, and 4 with 3.9."""

    layer: float = 1e-3
    """Height of the flattest cell, relative to its width, of grids whose numbers may be raised: grids with boundary
    layers. Generated grids for inviscid flow have cells of 1.2e-3, with first cells 1e-3 high of 5e-4."""

    largest_line_miss: float = 1.0
    """Largest error of a raised direction on its lines, in widths of the cells. With 3 too little is gained."""

    most_per_node: tuple[float, ...] = (0.5, 0.75, 1.0)
    """Most control points per node of a raised direction: each is tried if the previous ones do not suffice."""

    points_per_rise: int = 12
    """From trial to trial a number rises by one for each this many control points, and by at least one. With twice as
    many no grid changes, and there are more trials; with half as many there are 7 % more control points than needed."""

    margin: float = 0.3
    """A control element moves to its base if its smallest corner triple product is below this fraction of the base's.
    With half of it the worst element of MACH-Aero's grid is 43 % worse, with twice as much CFL3D's S-duct is missed by
    53 % more."""

    least_margin: float = 1e-3
    """The same if the base is the coarse grid, which is far from the grid itself: with 0.3 CFL3D's S-duct is missed by
    41 % more."""

    largest_margin: float = 0.85
    """The same if least squares move: next to their folds they are uneven, which a mover turns into flat cells. With
    half of it the worst element of MACH-Aero's grid is 62 % worse."""

    retreat: float = 0.25
    """Fraction of the distance to the base by which the points of such an element move in one round. With half of it
    the worst element about the NACA 0012 of MACH-Aero is 39 % worse, with twice as much CFL3D's S-duct is missed by 44
    % more."""

    fade: float = 0.25
    """Difference by which their neighbours move less. With half of it MACH-Aero's grid is missed by 47 % more, with
    twice as much its worst element is 23 % worse."""

    largest_step: float = 0.45
    """Largest step of a parameter relative to the distances of its neighbours, which keeps the order along grid lines.
    With half of it CFL3D's S-duct is missed by 31 % more after a cycle."""

    close: float = 1e-3
    """A node closer than this fraction of the initial RMS distance of its section is not moved: a fit of the M6 with
    two cycles takes 12 to 20 % less time, with errors that are the same to 1e-5."""

    correction_steps: int = 3
    """Gauss-Newton steps in each cycle. With one CFL3D's S-duct is missed by 32 % more after a cycle."""


FITTING = FittingSettings()
"""The defaults."""
