"""What a fit achieved: its errors, its invalid control elements, and where it is not least squares."""

from __future__ import annotations

from dataclasses import dataclass

ITERATIONS = (8, 4, 2, 0)
"""How often the quasi-interpolant is iterated, from the closest candidate to the most robust one."""

CANDIDATES = (
    "least_squares",
    *(f"quasi_interpolant_{n}" if n else "quasi_interpolant" for n in ITERATIONS),
    "coarse_grid",
)
"""Where a control point may be, the closest to the grid first, the most robust last."""


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
    rms: tuple[float, float, float]
    max_error: tuple[float, float, float]


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
    folded_cell: tuple[int, int, int] | None = None


@dataclass(frozen=True)
class Fallback:
    """Where a fit is not least squares, and what that changes.

    Parameters
    ----------
    n_points : tuple of int
        Control points of which each of `bspline_mdao.fit.quasi_interpolant.CANDIDATES` has the largest share.
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
class FitReport:
    """What a fit achieved.

    Parameters
    ----------
    rms : float
        Root mean square over all nodes of the distance between node and fitted point (m).
    relative_rms : float
        The same by the mean cell edge of the grid.
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
        Whatever the user should know, one line each.
    factor_bytes : int or None
        Predicted memory of one factor of elasticity's matrix (bytes); derivatives keep one for every increment. None
        for small control meshes, see `bspline_mdao.fit.factor_size.predict_factor_bytes`.
    fallback : Fallback or None
        Where the fit is not least squares; None where it is.
    """

    rms: float
    relative_rms: float
    mean_edge: float
    max_error: tuple[float, float, float]
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
