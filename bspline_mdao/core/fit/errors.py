"""Errors of a fit: how well it reproduces its grid, and whether its control mesh is valid.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
from numba import njit

from ...base.numerics.processes import ONE, summed
from ...grids.topology.block_layout import BlockLayout
from ..model.records import CANDIDATES, BlockError, Fallback, FitReport, InvalidElement, WorstNode
from ..splines.volume import Volume
from .control_counts import sound_order
from .fit_nodes import FitNodes
from .local_errors import worst_local_errors
from .problem import FitProblem, FitSolution
from .quasi_interpolant import parametric_places
from .settings import FITTING
from .validity import corner_measures, first_marked, folded_cells

FEWER = "fewer control points leave fewer of them (n_control, --n-control)"
"""Advice if the grid is not folded and control points have already fallen back."""

MOST_NAMED = 50
"""Most invalid control elements that a report names, the worst first."""


def report_errors(
    problem: FitProblem,  # the fit
    block_names: Sequence[str],  # name of every block
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    nodes: np.ndarray,  # (n_rows, 3), the nodes of this process (m); the report covers the nodes of all
    solution: FitSolution,
) -> FitReport:  # with the solution's warnings, and a last one if the control mesh is invalid
    """Report errors, invalid control elements and the fallback of a fit."""
    topology, sharing = problem.topology, problem.sharing
    nodes, fitted = nodes[: sharing.n_owned], solution.fitted[: sharing.n_owned]
    residual = nodes - fitted
    squares = residual**2
    distances = squares.sum(axis=1)
    layout, found = sharing.layout, []
    for block, part in zip(sharing.blocks, layout.slices):
        rms, largest = np.sqrt(squares[part].mean(axis=0)), np.abs(residual[part]).max(axis=0)
        found.append((block, BlockError(block_names[block], tuple(rms.tolist()), tuple(largest.tolist()))))
    blocks = [error for _, error in sorted(_gathered(sharing.comm, found), key=itemgetter(0))]
    rms = float(np.sqrt(_mean(sharing.comm, distances)))
    edge = mean_edge(layout.shapes, nodes, sharing.comm)
    n_invalid, invalid = _find_invalid(problem, parameters, nodes, solution.control_points)
    worst_local, worst_on_walls = worst_local_errors(sharing, nodes, residual)
    return FitReport(
        rms=rms,
        relative_rms=rms / edge if edge else 0.0,
        mean_edge=edge,
        max_error=tuple(np.max([block.max_error for block in blocks], axis=0).tolist()),
        blocks=tuple(blocks),
        worst=_worst_node(sharing, distances),
        n_nodes=topology.n_nodes,
        n_control_points=len(solution.control_points),
        n_invalid=n_invalid,
        invalid=invalid,
        warnings=(*solution.warnings, *_warn_of_invalid(problem, solution, n_invalid, invalid)),
        fallback=_compare(problem, nodes, solution.weights, solution.least_squares),
        worst_local=worst_local,
        worst_on_walls=worst_on_walls,
    )


def _compare(
    problem: FitProblem, nodes: np.ndarray, weights: np.ndarray | None, least_squares: FitSolution | None
) -> Fallback | None:
    """Count candidates in use, and measure the least squares that they replace; None if all are least squares."""
    if weights is None:
        return None
    n_points = np.bincount(weights.argmax(axis=1), minlength=len(CANDIDATES)).tolist()
    n_moved = int((weights[:, 0] < 1.0).sum())
    if least_squares is None:
        return Fallback(tuple(n_points), n_moved)
    comm = problem.sharing.comm
    squares = ((nodes - least_squares.fitted[: len(nodes)]) ** 2).sum(axis=1)
    measures = corner_measures(problem.mesh.nets(least_squares.control_points))
    n_invalid = sum(int((measure <= 0.0).sum()) for measure in measures)
    largest = max(_gathered(comm, [squares.max(initial=0.0)]))
    return Fallback(tuple(n_points), n_moved, n_invalid, float(np.sqrt(_mean(comm, squares))), float(np.sqrt(largest)))


def _gathered(comm: Any, items: list) -> list:
    """Items of all processes, in the order of processes."""
    return items if comm.size == 1 else [*chain.from_iterable(comm.allgather(items))]


def _mean(comm: Any, values: np.ndarray) -> float:
    """Mean of the values of all processes."""
    if comm.size == 1:
        return float(values.mean())
    total, count = summed(comm, np.array([values.sum(), len(values)], dtype=float))
    return float(total / count)


def mean_edge(
    shapes: Sequence[tuple[int, ...]],  # shapes of the blocks
    nodes: np.ndarray,  # (n_nodes, 3), nodes of all blocks (m)
    comm: Any = ONE,  # communicator, processes that have some blocks each
) -> float:  # 0 if no edge has a length
    """Mean length of the cell edges of a grid with non-zero length."""
    total, count = 0.0, 0
    for block in BlockLayout.of(shapes).split(nodes):
        length, n_edges = _edge_sum(block)
        total, count = total + length, count + n_edges
    total, count = summed(comm, np.array([total, count], dtype=float)).tolist()
    return total / count if count else 0.0


@njit(cache=True)
def _edge_sum(nodes):
    """Total length and number of the edges of a block with non-zero length."""
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


def _worst_node(sharing: FitNodes, distances: np.ndarray) -> WorstNode:
    """Find the node with the largest error, the first one of equally bad nodes."""
    worst = []
    if len(distances):
        row = int(np.argmax(distances))
        (place,), (index,) = sharing.layout.unravel(np.array([row]))
        worst.append((-distances[row], sharing.blocks[place], *index.tolist()))
    square, block, i, j, k = min(_gathered(sharing.comm, worst))
    return WorstNode(block + 1, i + 1, j + 1, k + 1, float(np.sqrt(-square)))


def count_invalid(problem: FitProblem, solution: FitSolution) -> int:
    """Count the invalid elements of the control mesh of a fit."""
    measures = corner_measures(problem.mesh.nets(solution.control_points))
    return sum(int((~(measure > 0.0)).sum()) for measure in measures)


def _find_invalid(
    problem: FitProblem, parameters: Sequence[np.ndarray], nodes: np.ndarray, control_points: np.ndarray
) -> tuple[int, tuple[InvalidElement, ...]]:
    """Count the invalid elements of all control meshes; name the worst, and folded cells of the grid in them."""
    measures = corner_measures(problem.mesh.nets(control_points))
    count = sum(int((~(measure > 0.0)).sum()) for measure in measures)
    if not count:
        return 0, ()
    sharing = problem.sharing
    found = []
    for s, cells in zip(sharing.here, folded_cells(problem, nodes)):
        measure, places = measures[s], parametric_places(problem.mesh.volumes[s], parameters[s])
        numbers = np.argwhere(~(measure > 0.0))
        numbers = numbers[np.argsort(measure[tuple(numbers.T)], kind="stable")[:MOST_NAMED]]
        window = problem.topology.segments[s]
        for number in numbers:
            box = tuple(slice(n, n + 2) for n in number)
            marked = first_marked(places[box], cells)
            cell = None if marked is None else tuple(n + lo + 1 for n, lo in zip(marked, window.lo))
            i, j, k = (int(n) + 1 for n in number)
            name = problem.topology.segment_names[s]
            found.append((s, InvalidElement(name, i, j, k, float(measure[tuple(number)]), cell)))
    in_order = sorted(_gathered(sharing.comm, found), key=itemgetter(0))
    return count, tuple(sorted((element for _, element in in_order), key=attrgetter("measure"))[:MOST_NAMED])


def _warn_of_invalid(
    problem: FitProblem, solution: FitSolution, n_invalid: int, invalid: Sequence[InvalidElement]
) -> Iterator[str]:
    """Warning about where the control mesh is invalid, with the remedy."""
    if n_invalid:
        worst, n_elements = invalid[0], sum(_n_elements(volume.n_control) for volume in problem.mesh.volumes)
        yield (
            f"{n_invalid:,} of {n_elements:,} elements of the control mesh invalid, the worst is element ({worst.i}, "
            f"{worst.j}, {worst.k}) of {worst.name} with corner triple product {worst.measure:.2g}; "
            f"{_advise(problem, solution, invalid)}"
        )


def _n_elements(n_control: Sequence[int]) -> int:
    return math.prod(max(n - 1, 1) for n in n_control)


def _advise(problem: FitProblem, solution: FitSolution, invalid: Sequence[InvalidElement]) -> str:
    """Remedy for the control mesh of this fit."""
    folded = next(((element.folded_cell, element.name) for element in invalid if element.folded_cell), None)
    reason = ""
    if folded:
        (i, j, k), name = folded
        reason = f"the grid itself is folded or flat there, at cell ({i}, {j}, {k}) of {name}; "
    if solution.weights is not None:
        return f"{reason}{'mend it, or live with it' if folded else FEWER}"
    segments = zip(problem.topology.segments, problem.mesh.volumes)
    if all(_is_high(window.shape, volume) for window, volume in segments):
        return f"{reason}leave the order and the number of control points out: both are chosen lower for so few nodes"
    return f'{reason}the method "valid" (--method valid) mends what the grid allows'


def _is_high(shape: Sequence[int], volume: Volume) -> bool:
    """Whether an order is higher than short directions allow without folds."""
    return any(order > sound_order(n_nodes) for n_nodes, order in zip(shape, volume.orders) if n_nodes < FITTING.long)
