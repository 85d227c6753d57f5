"""Valid control meshes: where least squares fold, control points fall back on the quasi-interpolant, smoothly.

The candidates of `bspline_mdao.core.model.records.CANDIDATES` form a ladder: each is less close to the grid than the
one before, and folds less. It is climbed from its foot. The control mesh found on one rung is the *base* of the next,
whose points are moved to it where elements are invalid, or much worse than in the base. The move fades out over the
neighbours. A mesh that has moved to its base everywhere is as valid as its base, so this terminates. The *weights* of
the candidates in each control point are then part of the model, like its topology: for given parameters the fit remains
a linear map of the nodes.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter

from ...grids.cells.hexahedron import cell_quality
from ...grids.topology.periodic_ties import Ties
from ..evaluation.evaluator import Evaluator
from ..model.records import CANDIDATES
from ..splines.mesh import BSplineMesh
from .problem import FitProblem, FitSolution
from .quasi_interpolant import Mixture, QuasiInterpolant
from .settings import FITTING, FittingSettings

FLAT = 1e-9
"""A cell of the grid with a corner triple product up to this is flat: the sign is round-off."""


def corner_measures(
    nets: Sequence[np.ndarray],  # each (N0, N1, N2, 3), control meshes, or blocks (m)
) -> list[np.ndarray]:
    """Smallest corner triple product of unit edges of every element, or cell."""
    # returns each (max(N0 - 1, 1), max(N1 - 1, 1), max(N2 - 1, 1)), positive in valid elements; 1 everywhere if fewer
    # than two directions extend
    measures = []
    for net in nets:
        is_line = sum(n > 1 for n in net.shape[:3]) < 2
        measures.append(np.ones([max(n - 1, 1) for n in net.shape[:3]]) if is_line else cell_quality(net).min_corner)
    return measures


def make_valid(
    problem: FitProblem,
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    least_squares: FitSolution | None,  # the fit by least squares; None leaves it out
    settings: FittingSettings = FITTING,
) -> FitSolution:  # the least squares themselves if they are valid
    """Keep least squares where their control mesh is valid, and mix candidates where it is not."""
    if least_squares is not None and is_valid(problem.mesh.nets(least_squares.control_points)):
        return least_squares
    points, said = (None, ()) if least_squares is None else (least_squares.control_points, least_squares.warnings)
    quasi = QuasiInterpolant.of(problem.mesh, problem.sharing, parameters)
    weights = choose_weights(problem, quasi, nodes, points, settings)
    mixed = Mixture(weights, quasi).forward(np.zeros((len(weights), 3)) if points is None else points, nodes)
    return FitSolution(mixed, _evaluated(problem, parameters, mixed), said, weights, least_squares)


def _evaluated(problem: FitProblem, parameters: Sequence[np.ndarray], control_points: np.ndarray) -> np.ndarray:
    """Points of the spline at the nodes of this process, shape (n_rows, 3)."""
    sharing = problem.sharing
    local_parameters = [x[evaluated] for x, evaluated in zip(parameters, sharing.is_evaluated)]
    local_rows = [rows[evaluated] for rows, evaluated in zip(sharing.rows, sharing.is_evaluated)]
    evaluator = Evaluator.build(problem.mesh, local_parameters, local_rows, sharing.n_rows)
    return sharing.copy_shared(evaluator.forward(control_points))


def with_sides_alike(
    problem: FitProblem, parameters: Sequence[np.ndarray], solution: FitSolution
) -> FitSolution:  # unchanged if no sides are tied
    """Map the control points of periodic sides exactly onto each other: they differ by the digits of the nodes."""
    ties = problem.ties
    if ties is None:
        return solution
    points = ties.lay(solution.control_points.copy())
    return replace(solution, control_points=points, fitted=_evaluated(problem, parameters, points))


def is_valid(nets: Sequence[np.ndarray]) -> bool:
    """Whether every corner of every element has a positive triple product."""
    return all((measure > 0.0).all() for measure in corner_measures(nets))


def choose_weights(
    problem: FitProblem,
    quasi: QuasiInterpolant,  # the candidates
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    # control points by least squares (m); None leaves them out
    least_squares: np.ndarray | None,  # (n_control_points, 3), or None
    settings: FittingSettings = FITTING,
) -> np.ndarray:  # (n_control_points, 6), weights of `CANDIDATES` in each control point; their sum is 1
    """Mix candidates to make the control mesh valid wherever the grid is."""
    # 1. Start from the most robust candidate, the coarse grid, as the base.
    # 2. Take the next closer candidate, and the least allowed measure of each of its elements from the measure in the
    # base. 3. Where the grid itself is folded, require nothing: no coarse grid mends that. 4. Move its points to the
    # base until all elements have their least measure (`_retreat`). 5. The result is the base of the next candidate;
    # continue with step 2.
    mesh = problem.mesh
    candidates = [least_squares, *quasi.candidates(nodes)]
    # step 1
    base, weights = candidates[-1], np.zeros((mesh.n_control_points, len(CANDIDATES)))
    weights[:, -1] = 1.0
    for number in range(len(CANDIDATES) - 2, -1 if least_squares is not None else 0, -1):
        # step 2
        margin = settings.margin if number else settings.largest_margin
        if number == len(CANDIDATES) - 2:
            margin = settings.least_margin
        least = [np.where(m > 0.0, margin * m, m - settings.margin) for m in corner_measures(mesh.nets(base))]
        if number == len(CANDIDATES) - 2:  # step 3
            folded = folded_cells(problem, nodes)
            covered = elements_with([quasi.places[s] for s in problem.sharing.here], folded)
            for bound, is_folded in zip(least, problem.sharing.of_all_segments(covered)):
                bound[is_folded] = -np.inf
        # step 4
        towards = _retreat(mesh, candidates[number], base, least, settings, problem.ties)
        # step 5
        base = _mixed(candidates[number], base, towards)
        weights *= towards[:, None]
        weights[:, number] = 1.0 - towards
    return weights


def folded_cells(problem: FitProblem, nodes: np.ndarray) -> list[np.ndarray]:
    """Mark the folded and flat cells of a grid, shape (n_rows, 3), in every segment of this process."""
    here = [problem.sharing.rows[s] for s in problem.sharing.here]
    return [measure <= FLAT for measure in corner_measures([nodes[rows] for rows in here])]


def elements_with(
    places: Sequence[np.ndarray],  # each (N0, N1, N2, 3), real node numbers of the control points
    is_marked: Sequence[np.ndarray],  # of the cells of every segment
) -> list[np.ndarray]:
    """Mark the elements that cover a marked cell."""
    return [_covers_any(*segment) for segment in zip(places, is_marked)]


def _covers_any(places: np.ndarray, is_marked: np.ndarray) -> np.ndarray:
    """Whether the box of node numbers of each element contains a marked cell, from running sums."""
    shape = [max(n - 1, 1) for n in places.shape[:3]]
    corners = list(np.ndindex(*(min(n, 2) for n in places.shape[:3])))
    ends = np.stack([places[tuple(slice(c, c + n) for c, n in zip(corner, shape))] for corner in corners])
    low, high = _box(ends, is_marked.shape)
    sums = np.pad(is_marked.astype(np.int64), ((1, 0), (1, 0), (1, 0))).cumsum(0).cumsum(1).cumsum(2)
    count = np.zeros(shape, dtype=np.int64)
    for corner in np.ndindex(2, 2, 2):
        i, j, k = np.moveaxis(np.where(corner, high, low), -1, 0)
        count += (-1) ** (3 - sum(corner)) * sums[i, j, k]
    return count > 0


def first_marked(
    # real node numbers of the corners of the element; one only across a direction without extent
    corners: np.ndarray,  # (2, 2, 2, 3)
    is_marked: np.ndarray,  # bool, of the cells of the segment
) -> tuple[int, ...] | None:
    """First marked cell that an element covers, from 0, or None."""
    low, high = _box(corners.reshape(-1, 3), is_marked.shape)
    found = np.argwhere(is_marked[tuple(map(slice, low, high))])
    return tuple(int(n) for n in found[0] + low) if len(found) else None


def _box(corners: np.ndarray, shape: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """First cell, and the one after the last, that places along the first axis enclose, in each direction."""
    low = np.floor(corners.min(axis=0)).astype(int).clip(max=np.array(shape) - 1)
    return low, np.ceil(corners.max(axis=0)).astype(int).clip(min=low + 1)


def _retreat(
    mesh: BSplineMesh,
    candidate: np.ndarray,
    base: np.ndarray,
    least: Sequence[np.ndarray],
    settings: FittingSettings,
    ties: Ties | None,
) -> np.ndarray:
    """Weight of the base in each control point that makes its elements good enough, shape (n_control_points,)."""
    towards = np.zeros(mesh.n_control_points)
    while True:
        measures = corner_measures(mesh.nets(_mixed(candidate, base, towards)))
        is_bad = [measure < bound for measure, bound in zip(measures, least)]
        moving = _points_of(mesh, is_bad) & (towards < 1.0)
        if not moving.any():
            return towards
        towards[moving] = np.minimum(towards[moving] + settings.retreat, 1.0)
        towards = _fade(mesh, towards, settings.fade, ties)


def _mixed(candidate: np.ndarray, base: np.ndarray, towards: np.ndarray) -> np.ndarray:
    weight = towards[:, None]
    return (1.0 - weight) * candidate + weight * base


def _points_of(mesh: BSplineMesh, is_marked: Sequence[np.ndarray]) -> np.ndarray:
    """Mark the control points of marked elements, shape (n_control_points,)."""
    result = np.zeros(mesh.n_control_points, dtype=bool)
    for ids, marked in zip(mesh.control_ids, is_marked):
        for corner in np.ndindex(*(min(n, 2) for n in ids.shape)):
            result[ids[tuple(slice(c, c + n) for c, n in zip(corner, marked.shape))][marked]] = True
    return result


def _fade(mesh: BSplineMesh, towards: np.ndarray, fade: float, ties: Ties | None = None) -> np.ndarray:
    """Raise each value to its neighbours' in any element, less a difference."""
    while True:
        raised = towards.copy()
        for ids in mesh.control_ids:
            np.maximum.at(raised, ids.ravel(), maximum_filter(towards[ids], 3, mode="nearest").ravel() - fade)
        if ties is not None:
            ties.raise_alike(raised)
        if np.array_equal(raised, towards):
            return towards
        towards = raised
