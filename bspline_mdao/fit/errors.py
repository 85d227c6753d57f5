"""How well a fit reproduces its grid, and whether its control mesh is valid."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from ..grids.hexahedron import cell_quality
from ..splines.volume import Volume
from .control_counts import LONG, sound_order
from .prior import greville_samples
from .problem import FitProblem, Solution

MOST_NAMED = 50
"""Invalid control elements that a report names, the worst first."""


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
    """

    name: str
    i: int
    j: int
    k: int
    measure: float


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


def report_errors(
    problem: FitProblem,
    block_names: Sequence[str],
    nodes: np.ndarray,
    solution: Solution,
    seconds: float = 0.0,
    warnings: Sequence[str] = (),
    factor_bytes: int | None = None,
) -> FitReport:
    """Measure a fit.

    Parameters
    ----------
    problem : FitProblem
        What was fitted with what.
    block_names : sequence of str
        Name of every block.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    solution : Solution
        The fit.
    seconds, warnings
        Taken over; the warnings of the solution are added, and one, the last, where the control mesh is invalid.
    factor_bytes : int, optional
        Taken over.

    Returns
    -------
    FitReport
    """
    topology, residual = problem.topology, nodes - solution.fitted
    squares = residual**2
    distances = squares.sum(axis=1)
    starts = np.concatenate([[0], np.cumsum([np.prod(shape) for shape in topology.shapes])])
    blocks = []
    for name, start, stop in zip(block_names, starts, starts[1:]):
        rms, largest = np.sqrt(squares[start:stop].mean(axis=0)), np.abs(residual[start:stop]).max(axis=0)
        blocks.append(BlockError(name, tuple(rms.tolist()), tuple(largest.tolist())))
    rms, edge = float(np.sqrt(distances.mean())), mean_edge(topology.shapes, nodes)
    n_invalid, invalid = _find_invalid(topology.segment_names, problem.mesh.nets(solution.control_points))
    return FitReport(
        rms=rms,
        relative_rms=rms / edge if edge else 0.0,
        mean_edge=edge,
        max_error=tuple(np.max([block.max_error for block in blocks], axis=0).tolist()),
        blocks=tuple(blocks),
        worst=_worst_node(topology.shapes, starts, distances),
        n_nodes=len(nodes),
        n_control_points=len(solution.control_points),
        n_invalid=n_invalid,
        invalid=invalid,
        seconds=seconds,
        warnings=(*warnings, *solution.warnings, *_warn_of_invalid(problem, nodes, n_invalid, invalid)),
        factor_bytes=factor_bytes,
    )


def mean_edge(shapes, nodes: np.ndarray) -> float:
    """Mean length of the cell edges of a grid that have a length.

    Parameters
    ----------
    shapes : sequence of (ni, nj, nk)
        Shapes of the blocks.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes of all blocks (m).

    Returns
    -------
    float
        0 where no edge has a length.
    """
    total, count, start = 0.0, 0, 0
    for shape in shapes:
        size = int(np.prod(shape))
        length, n_edges = _edge_sum(nodes[start : start + size].reshape(*shape, 3))
        total, count, start = total + length, count + n_edges, start + size
    return total / count if count else 0.0


@njit(cache=True)
def _edge_sum(nodes):
    """Total length and number of the edges of a block that have a length."""
    n_0, n_1, n_2 = nodes.shape[:3]
    total, count = 0.0, 0
    for i in range(n_0):
        for j in range(n_1):
            for k in range(n_2):
                here = nodes[i, j, k]
                for d in range(3):
                    a, b, c = i + (d == 0), j + (d == 1), k + (d == 2)
                    if a < n_0 and b < n_1 and c < n_2:
                        there = nodes[a, b, c]
                        square = (there[0] - here[0]) ** 2 + (there[1] - here[1]) ** 2 + (there[2] - here[2]) ** 2
                        total += np.sqrt(square)
                        count += square > 0.0
    return total, count


def _worst_node(shapes, starts, distances: np.ndarray) -> WorstNode:
    row = int(np.argmax(distances))
    block = int(np.searchsorted(starts, row, side="right")) - 1
    i, j, k = (int(n) + 1 for n in np.unravel_index(row - starts[block], shapes[block]))
    return WorstNode(block + 1, i, j, k, float(np.sqrt(distances[row])))


def _find_invalid(names: Sequence[str], nets: Sequence[np.ndarray]) -> tuple[int, tuple[InvalidElement, ...]]:
    """Count the invalid elements of all control meshes and name the worst."""
    found, count = [], 0
    for name, net in zip(names, nets):
        if sum(n > 1 for n in net.shape[:3]) < 2:
            continue
        quality = cell_quality(net)
        places = np.argwhere(~quality.is_valid)
        measures = quality.min_corner[~quality.is_valid]
        count += len(places)
        for m in np.argsort(measures, kind="stable")[:MOST_NAMED]:
            found.append(InvalidElement(name, *(int(n) + 1 for n in places[m]), float(measures[m])))
    return count, tuple(sorted(found, key=lambda element: element.measure)[:MOST_NAMED])


def _warn_of_invalid(problem: FitProblem, nodes, n_invalid: int, invalid: Sequence[InvalidElement]) -> Iterator[str]:
    """Say where the control mesh is invalid, and what mends it."""
    if n_invalid:
        worst, n_elements = invalid[0], sum(_n_elements(volume.n_control) for volume in problem.mesh.volumes)
        yield (
            f"{n_invalid} of {n_elements:,} control elements are invalid, the worst is element ({worst.i}, {worst.j}, "
            f"{worst.k}) of {worst.name} with corner triple product {worst.measure:.2g}; "
            f"{_advise(problem, nodes)}"
        )


def _n_elements(n_control: Sequence[int]) -> int:
    return math.prod(max(n - 1, 1) for n in n_control)


def _advise(problem: FitProblem, nodes: np.ndarray) -> str:
    """Say what mends the control mesh of this fit; what a coarse copy of the grid leaves is known without solving."""
    topology, segments = problem.topology, list(zip(problem.topology.segments, problem.mesh.volumes))
    n_cells = _count_invalid_cells(topology.shapes, nodes)
    reason = f"the grid has {n_cells:,} invalid cells itself; " if n_cells else ""
    if problem.smoothing == np.inf:
        return f"{reason}fewer control points leave fewer of them"
    if all(_is_high(window.shape, volume) for window, volume in segments):
        return f"{reason}leave the order and the number of control points out: both are chosen lower for so few nodes"
    nets = [
        greville_samples(nodes[rows], v.n_control, v.orders) for rows, (_, v) in zip(problem.sharing.rows, segments)
    ]
    n_left, _ = _find_invalid(topology.segment_names, nets)
    return (
        f"{reason}smoothing = inf (--smoothing inf) leaves {n_left or 'none'}: the control mesh is then a coarse copy "
        f"of the grid, and the residual carries what that misses"
    )


def _is_high(shape: Sequence[int], volume: Volume) -> bool:
    """Whether an order is higher than what short directions take without folds."""
    return any(order > sound_order(n_nodes) for n_nodes, order in zip(shape, volume.orders) if n_nodes < LONG)


def _count_invalid_cells(shapes, nodes: np.ndarray) -> int:
    """Count the folded and flat cells of a grid."""
    blocks = np.split(nodes, np.cumsum([np.prod(shape) for shape in shapes])[:-1])
    solid = [(block, shape) for block, shape in zip(blocks, shapes) if sum(n > 1 for n in shape) > 1]
    return sum(int((~cell_quality(block.reshape(*shape, 3)).is_valid).sum()) for block, shape in solid)
