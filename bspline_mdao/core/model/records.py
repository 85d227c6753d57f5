"""Records of a fitted model besides its arrays: the header of its grid, and the settings and report of its fit.

They are stored in the model's file by the names of their classes and fields
(`bspline_mdao.core.model.model_file`): renaming one changes the format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.grid import Block, Grid, Patch

ITERATIONS = (8, 4, 2, 0)
"""Numbers of iterations of the quasi-interpolant, from the closest candidate to the most robust one."""

CANDIDATES = (
    "least_squares",
    *(f"quasi_interpolant_{n}" if n else "quasi_interpolant" for n in ITERATIONS),
    "coarse_grid",
)
"""Candidates for the place of a control point, the closest to the grid first, the most robust last."""


@dataclass(frozen=True, eq=False)
class GridHeader(OneLine):
    """Names, patches, source and file dialect of a grid: everything but its nodes."""

    names: tuple[str, ...]  # names of the blocks
    patches: tuple[Patch, ...] = ()  # declared patches
    source: str = "grid"  # where the grid came from
    dialect: object | None = None  # how its file was written
    iblanks: tuple[np.ndarray | None, ...] = ()  # blanking of every block
    unit: str = ""  # unit of lengths; empty if unknown

    @property
    def length_unit(self) -> str:
        """Unit in which lengths are shown: metres if no other is known."""
        return self.unit or "m"

    @classmethod
    def of(cls, grid: Grid) -> GridHeader:
        """Take the header of a grid."""
        names, iblanks = tuple(b.name for b in grid.blocks), tuple(b.iblank for b in grid.blocks)
        return cls(names, grid.patches, grid.source, grid.dialect, iblanks, grid.unit)

    def grid(self, shapes: Sequence[tuple[int, ...]], nodes: np.ndarray) -> Grid:
        """Grid with these nodes, shape (n_nodes, 3), in blocks of these shapes."""
        blocks = map(Block, BlockLayout.of(shapes).split(nodes), self.names, self.iblanks)
        return Grid(tuple(blocks), self.patches, self.source, self.dialect, unit=self.unit)


@dataclass(frozen=True)
class FitSettings(OneLine):
    """Settings of a fit that its derivatives depend on."""

    knots: str = "curved"  # ``"curved"``, ``"constant"``, or ``"given"`` for the user's own
    corrections: int = 0  # cycles of parameter correction
    # of the nodes, before correction: one of `bspline_mdao.core.fit.options.EXPONENTS`, or ``"given"`` for the user's
    parametrization: str = "chord_length"
    # one of `bspline_mdao.core.fit.options.METHODS`; the resulting weights are the model's ``candidate_weights``
    method: str = "valid"
    # whether nodes near walls follow them as a rigid body and the residual turns with its neighbourhood
    wall_layer: bool = True


@dataclass(frozen=True)
class BlockError:
    """Errors of one block."""

    name: str  # name of the block
    # rms, max_error: of x, y and z (m)
    rms: tuple[float, ...]
    max_error: tuple[float, ...]


@dataclass(frozen=True)
class WorstNode:
    """The node with the largest error."""

    # block, i, j, k: its place, from 1
    block: int
    i: int
    j: int
    k: int
    error: float  # distance between the node and the fitted point (m)


@dataclass(frozen=True)
class LocalError:
    """The node with the largest error relative to the width of the cells there."""

    in_widths: float  # distance between the node and the fitted point divided by the width
    # error, width: the distance and the width (m). The width is the middle one of the shortest edges in each direction
    # at the node, on a wall the shorter of the two in the wall; see `bspline_mdao.core.fit.local_errors`
    error: float
    width: float
    # block, i, j, k: its place, from 1
    block: int
    i: int
    j: int
    k: int
    patch: str = ""  # the wall; empty if walls were not searched

    def __str__(self) -> str:
        on = f" of '{self.patch}'" if self.patch else ""
        return f"{self.in_widths:.3g} at block {self.block}, ({self.i}, {self.j}, {self.k}){on}"


@dataclass(frozen=True)
class InvalidElement:
    """A control element with a folded or flat corner."""

    name: str  # name of the segment
    # i, j, k: number of the element, from 1
    i: int
    j: int
    k: int
    measure: float  # smallest corner triple product of unit edges; positive in a valid element
    # number in its block, from 1, of a folded or flat cell of the grid that the element covers, if there is one
    folded_cell: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Fallback:
    """Control points of a fit that are not least squares; errors and invalid elements with least squares."""

    n_points: tuple[int, ...]  # control points of which each of `CANDIDATES` has the largest weight
    n_moved: int  # control points that are not purely least squares
    # invalid control elements by least squares; None, like the next two, if these were not solved
    least_squares_invalid: int | None = None
    # least_squares_rms, least_squares_max: root mean square and largest distance between node and fitted point by least
    # squares (m)
    least_squares_rms: float | None = None
    least_squares_max: float | None = None


@dataclass(frozen=True)
class Raised:
    """The fit with the numbers of control points that are chosen from the grid alone."""

    n_control_points: int  # unique control points
    in_widths: float  # largest error relative to the width of the cells, see `LocalError`


@dataclass(frozen=True)
class FitReport(OneLine):
    """Errors, invalid control elements, warnings and sizes of a fit."""

    rms: float  # root mean square over all nodes of the distance between node and fitted point (m)
    relative_rms: float  # the same divided by the mean cell edge of the grid
    mean_edge: float  # mean length of the cell edges of non-zero length (m)
    max_error: tuple[float, ...]  # largest error in x, y and z (m)
    blocks: tuple[BlockError, ...]  # errors of each block
    worst: WorstNode  # where the error is largest
    # n_nodes, n_control_points: nodes of all blocks; unique control points
    n_nodes: int
    n_control_points: int
    n_invalid: int  # number of invalid control elements
    invalid: tuple[InvalidElement, ...]  # the worst of them
    seconds: float = 0.0  # wall clock of the fit
    warnings: tuple[str, ...] = ()  # warnings for the user, one line each
    # predicted memory of one factor of elasticity's matrix (bytes); derivatives keep one for every increment. None for
    # small control meshes, see `bspline_mdao.core.fit.control_counts.predict_factor_bytes`.
    factor_bytes: int | None = None
    fallback: Fallback | None = None  # if the fit is not least squares everywhere; else None
    # worst_local, worst_on_walls: where the error is largest relative to the width of the cells, anywhere and on walls;
    # None if there are none
    worst_local: LocalError | None = None
    worst_on_walls: LocalError | None = None
    raised: Raised | None = None  # if control points were added because errors were too large; else None
