"""Records of a fitted model, besides its arrays: the header of its grid, and settings and report of its fit.

They are stored in the model's file by the names of their classes and fields
(`bspline_mdao.core.model.model_file`): to rename one is to change the format.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.grid import Block, Grid, Patch

ITERATIONS = (8, 4, 2, 0)
"""How often the quasi-interpolant is iterated, from the closest candidate to the most robust one."""

CANDIDATES = (
    "least_squares",
    *(f"quasi_interpolant_{n}" if n else "quasi_interpolant" for n in ITERATIONS),
    "coarse_grid",
)
"""Where a control point may be, the closest to the grid first, the most robust last."""


@dataclass(frozen=True, eq=False)
class GridHeader(OneLine):
    """Names, patches, source and file dialect of a grid: all but its nodes.

    Parameters
    ----------
    names : tuple of str
        Names of the blocks.
    patches : tuple of Patch
        Declared patches.
    source : str
        Where the grid came from.
    dialect : object or None
        How its file was written.
    iblanks : tuple of (ndarray or None)
        Blanking of every block.
    unit : str
        Unit of lengths; empty where nobody says it.
    """

    names: tuple[str, ...]
    patches: tuple[Patch, ...] = ()
    source: str = "grid"
    dialect: object | None = None
    iblanks: tuple[np.ndarray | None, ...] = ()
    unit: str = ""

    @property
    def length_unit(self) -> str:
        """Unit that lengths are shown in: metres where nobody says another one."""
        return self.unit or "m"

    @classmethod
    def of(cls, grid: Grid) -> GridHeader:
        """Take the header of a grid."""
        names, iblanks = tuple(b.name for b in grid.blocks), tuple(b.iblank for b in grid.blocks)
        return cls(names, grid.patches, grid.source, grid.dialect, iblanks, grid.unit)

    def grid(self, shapes, nodes: np.ndarray) -> Grid:
        """Grid with these nodes, shape (n_nodes, 3), in blocks of these shapes."""
        blocks = map(Block, BlockLayout.of(shapes).split(nodes), self.names, self.iblanks)
        return Grid(tuple(blocks), self.patches, self.source, self.dialect, unit=self.unit)


@dataclass(frozen=True)
class FitSettings(OneLine):
    """Settings of a fit, as far as its derivatives depend on them.

    Parameters
    ----------
    knots : str
        ``"curved"``, ``"constant"``, or ``"given"`` for the user's own.
    corrections : int
        Cycles of parameter correction.
    parametrization : str
        Of the nodes, before correction: one of `bspline_mdao.core.fit.options.EXPONENTS`, or ``"given"`` for the
        user's.
    method : str
        One of `bspline_mdao.core.fit.options.METHODS`; what came of it are the model's ``candidate_weights``.
    wall_layer : bool
        Whether nodes near walls follow them as a rigid body and the residual turns with its surroundings.
    """

    knots: str = "curved"
    corrections: int = 0
    parametrization: str = "chord_length"
    method: str = "valid"
    wall_layer: bool = True


@dataclass(frozen=True)
class BlockError:
    """Errors of one block.

    Parameters
    ----------
    name : str
        Name of the block.
    rms, max_error : tuple of three float
        Of x, y and z (m).
    """

    name: str
    rms: tuple[float, ...]
    max_error: tuple[float, ...]


@dataclass(frozen=True)
class WorstNode:
    """The node with the largest error.

    Parameters
    ----------
    block, i, j, k : int
        Its place, from 1.
    error : float
        Distance between the node and the fitted point (m).
    """

    block: int
    i: int
    j: int
    k: int
    error: float


@dataclass(frozen=True)
class LocalError:
    """The node with the largest error by the width of the cells there.

    Parameters
    ----------
    in_widths : float
        Distance between the node and the fitted point by the width.
    error, width : float
        The distance, and the width (m): of the shortest edge in each direction at the node the middle one, on a wall
        the shorter of those in the wall; see `bspline_mdao.core.fit.local_errors`.
    block, i, j, k : int
        Its place, from 1.
    patch : str
        The wall; empty where it was not looked for on walls.
    """

    in_widths: float
    error: float
    width: float
    block: int
    i: int
    j: int
    k: int
    patch: str = ""

    def __str__(self) -> str:
        on = f" of '{self.patch}'" if self.patch else ""
        return f"{self.in_widths:.3g} at block {self.block}, ({self.i}, {self.j}, {self.k}){on}"


@dataclass(frozen=True)
class InvalidElement:
    """A control element with a folded or flat corner.

    Parameters
    ----------
    name : str
        Name of the segment.
    i, j, k : int
        Number of the element, from 1.
    measure : float
        Smallest corner triple product of unit edges; positive in a valid element.
    folded_cell : tuple of three int, or None
        Number in its block, from 1, of a folded or flat cell of the grid that the element covers, where there is one.
    """

    name: str
    i: int
    j: int
    k: int
    measure: float
    folded_cell: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Fallback:
    """Control points of a fit that are not least squares, and the errors and invalid elements that these would have.

    Parameters
    ----------
    n_points : tuple of int
        Control points of which each of `CANDIDATES` has the largest weight.
    n_moved : int
        Control points that are not least squares alone.
    least_squares_invalid : int or None
        Invalid control elements by least squares; None, like the next two, where these were not solved.
    least_squares_rms, least_squares_max : float or None
        Root mean square and largest distance between node and fitted point by least squares (m).
    """

    n_points: tuple[int, ...]
    n_moved: int
    least_squares_invalid: int | None = None
    least_squares_rms: float | None = None
    least_squares_max: float | None = None


@dataclass(frozen=True)
class Raised:
    """What the fit would be with the numbers of control points that are chosen from the grid alone.

    Parameters
    ----------
    n_control_points : int
        Unique control points.
    in_widths : float
        Largest error by the width of the cells, see `LocalError`.
    """

    n_control_points: int
    in_widths: float


@dataclass(frozen=True)
class FitReport(OneLine):
    """Errors, invalid control elements, warnings and sizes of a fit.

    Parameters
    ----------
    rms : float
        Root mean square over all nodes of the distance between node and fitted point (m).
    relative_rms : float
        The same divided by the mean cell edge of the grid.
    mean_edge : float
        Mean length of the cell edges that have a length (m).
    max_error : tuple of three float
        Largest error in x, y and z (m).
    blocks : tuple of BlockError
        Errors of each block.
    worst : WorstNode
        Where the error is largest.
    n_nodes, n_control_points : int
        Nodes of all blocks; unique control points.
    n_invalid : int
        Number of invalid control elements.
    invalid : tuple of InvalidElement
        The worst of them.
    seconds : float
        Wall clock of the fit.
    warnings : tuple of str
        Warnings for the user, one line each.
    factor_bytes : int or None
        Predicted memory of one factor of elasticity's matrix (bytes); derivatives keep one for every increment. None
        for small control meshes, see `bspline_mdao.core.fit.control_counts.predict_factor_bytes`.
    fallback : Fallback or None
        Where the fit is not least squares; None where it is.
    worst_local, worst_on_walls : LocalError or None
        Where the error is largest by the width of the cells, anywhere and on walls; None where there are none.
    raised : Raised or None
        Where control points were added since too much was missed; None where none were.
    """

    rms: float
    relative_rms: float
    mean_edge: float
    max_error: tuple[float, ...]
    blocks: tuple[BlockError, ...]
    worst: WorstNode
    n_nodes: int
    n_control_points: int
    n_invalid: int
    invalid: tuple[InvalidElement, ...]
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    factor_bytes: int | None = None
    fallback: Fallback | None = None
    worst_local: LocalError | None = None
    worst_on_walls: LocalError | None = None
    raised: Raised | None = None
