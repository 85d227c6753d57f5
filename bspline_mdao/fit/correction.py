"""Parameter correction: alternate between least squares and moving the parameters of the nodes, section II.D.

References
----------
J. Hoschek, "Intrinsic parametrization for approximation", Computer Aided Geometric Design 5, 1988.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from ..topology.index_space import Orientation, Section, inner_slices, sections_of, whole_slices
from .entities import Entity
from .problem import FitProblem, FitSolution, Progress, part_of, solve_fit
from .projection import project

STEPS = 3
"""Gauss-Newton steps in each cycle."""

CYCLE_COST = 6
"""Time of a cycle by that of the least squares alone, about; most of it goes into the steps."""


@dataclass(frozen=True, eq=False)
class _Follower:
    """A section of a segment that is the same as an entity of another and takes over its parameters."""

    entity: Entity
    segment: int
    section: Section
    orientation: Orientation


def correct_parameters(
    problem: FitProblem,
    parameters: Sequence[np.ndarray],
    nodes: np.ndarray,
    solution: FitSolution,
    cycles: int,
    progress: Progress,
    solve: Callable[..., FitSolution] = solve_fit,
) -> tuple[list[np.ndarray], FitSolution]:
    """Correct the parameters of a fit; knots stay as they are.

    Each cycle moves the parameters of edges, faces and interiors towards the closest points and solves the fit anew; a
    cycle that does not lower the RMS error is dropped and ends the correction. The last word is a fit, so that the
    control points are those that the nodes have for the corrected parameters. A node that segments share is moved by
    the one that fits it; the others take over its parameters.

    Parameters
    ----------
    problem : FitProblem
        The fit.
    parameters : sequence of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    solution : FitSolution
        The fit for these parameters.
    cycles : int
        Number of cycles, at least 1.
    progress : callable
        See `bspline_mdao.fit.fitting.fit_grid`.
    solve : callable
        Fit for given parameters: called with the problem, parameters and nodes.

    Returns
    -------
    parameters : list of ndarray
        The new parameters.
    solution : FitSolution
        The fit for them.
    """
    followers = _find_followers(problem)
    for cycle in range(cycles):
        moving = part_of(progress, cycle / cycles, (cycle + 1) / cycles)
        moved = _move(problem, followers, parameters, nodes, solution.control_points, moving)
        refitted = solve(problem, moved, nodes)
        if not _square(nodes, refitted) < _square(nodes, solution):
            break
        parameters, solution = moved, refitted
    return list(parameters), solution


def _square(nodes: np.ndarray, solution: FitSolution) -> float:
    return float(((nodes - solution.fitted) ** 2).sum())


def _move(problem: FitProblem, followers, parameters, nodes, control_points, progress) -> list[np.ndarray]:
    """Move the parameters of all entities for fixed control points."""
    n_done, n_nodes = 0, problem.n_nodes
    parameters, nets = [array.copy() for array in parameters], problem.mesh.nets(control_points)
    for entity in problem.entities:
        if any(entity.is_free):
            section, s = parameters[entity.segment][whole_slices(entity.section)], entity.segment
            volume, inner_nodes = problem.mesh.volumes[s], nodes[entity.rows]
            section[...], _ = project(volume, nets[s], section, entity.is_free, inner_nodes, STEPS)
            n_done += len(inner_nodes)
            progress(n_done / n_nodes, "parameter correction")
    for follower in followers:
        _take_over(follower, parameters)
    return parameters


def _take_over(follower: _Follower, parameters) -> None:
    """Give a follower the parameters of its entity, turned to its own directions."""
    entity, orientation = follower.entity, follower.orientation
    source = parameters[entity.segment][entity.inner]
    target = orientation.apply(parameters[follower.segment][inner_slices(follower.section)])
    for d in np.flatnonzero(entity.is_free):
        values = source[..., d]
        target[..., orientation.perm[d]] = 1 - values if orientation.flip[d] else values


def _find_followers(problem: FitProblem) -> list[_Follower]:
    """All edges and faces that coincide with an entity of their kind elsewhere."""
    source = problem.sharing.source_rows()
    rows = [source[r] for r in problem.sharing.rows]
    owners = {int(e.rows.min()): e for e in problem.entities if 1 <= sum(e.is_free) <= 2 and e.rows.size}
    followers = []
    for segment, n_free in product(range(len(rows)), (1, 2)):
        for section in sections_of(rows[segment].shape, n_free):
            inner = rows[segment][inner_slices(section)]
            owner = owners.get(int(inner.min())) if inner.size else None
            if owner is None or (owner.segment, owner.section) == (segment, section):
                continue
            whole = rows[owner.segment][whole_slices(owner.section)]
            orientation = _orientation(whole, rows[segment][whole_slices(section)])
            if orientation is not None:
                followers.append(_Follower(owner, segment, section, orientation))
    return followers


def _orientation(first: np.ndarray, second: np.ndarray) -> Orientation | None:
    """Orientation that makes two arrays of node numbers equal."""
    for perm in permutations(range(3)):
        for flip in product((False, True), repeat=3):
            orientation = Orientation(perm, flip)
            if np.array_equal(orientation.apply(second), first):
                return orientation
    return None
