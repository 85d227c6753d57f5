"""Parameter correction (Hoschek): alternate between least squares and moving the parameters of the nodes, section II.D.

Theory: ``docs/theory/fit.rst``.

References
----------
J. Hoschek, "Intrinsic parametrization for approximation", Computer Aided Geometric Design 5, 1988.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numba import njit

from ...grids.topology.index_space import Orientation, Section, inner_slices, sections_of, whole_slices
from ..splines.volume import Volume, point_and_gradient, volume_basis_gradients
from .entities import Entity
from .problem import FitProblem, FitSolution, Progress, part_of, solve_fit
from .settings import FITTING, FittingSettings

_CHUNK = 2048
"""Points at a time: their basis functions stay in the cache."""

_DAMPING = 1e-12
"""Damping of the scaled normal equations for directions in which the mapping is constant, far below their entries."""

CYCLE_COST = 6
"""Approximate time of a cycle relative to the least squares; most of it goes into the steps."""


def correct_parameters(
    problem: FitProblem,
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    solution: FitSolution,  # the fit for these parameters
    cycles: int,  # number of cycles, at least 1
    progress: Progress,  # see `bspline_mdao.core.fit.fitting.fit_grid`
    # fit for given parameters: called with the problem, parameters and nodes
    solve: Callable[..., FitSolution] = solve_fit,
    settings: FittingSettings = FITTING,
) -> tuple[list[np.ndarray], FitSolution]:  # parameters: the new parameters; solution: the fit for them
    """Correct the parameters of a fit; knots stay unchanged."""
    # A cycle, after Hoschek:
    # 1. Move the parameters of edges, faces and interiors towards the closest points of the spline, control points
    #    fixed.
    # 2. A node that segments share is moved by the segment that fits it; the others take over its parameters.
    # 3. Solve the least squares again: control points fit the nodes for these parameters.
    # 4. Drop a cycle that does not lower the RMS error, and stop.
    followers = _find_followers(problem)
    for cycle in range(cycles):
        moving = part_of(progress, cycle / cycles, (cycle + 1) / cycles)
        # steps 1 and 2
        moved = _move(problem, followers, parameters, nodes, solution.control_points, moving, settings)
        # step 3
        refitted = solve(problem, moved, nodes)
        # step 4
        if not _square(nodes, refitted) < _square(nodes, solution):
            break
        parameters, solution = moved, refitted
    return list(parameters), solution


def _square(nodes: np.ndarray, solution: FitSolution) -> float:
    return float(((nodes - solution.fitted) ** 2).sum())


def _move(
    problem: FitProblem,
    followers: Sequence[_Follower],
    parameters: Sequence[np.ndarray],
    nodes: np.ndarray,
    control_points: np.ndarray,
    progress: Progress,
    settings: FittingSettings,
) -> list[np.ndarray]:
    """Move the parameters of all entities for fixed control points."""
    n_done, n_nodes = 0, problem.topology.n_nodes
    parameters, nets = [array.copy() for array in parameters], problem.mesh.nets(control_points)
    for entity in problem.entities:
        if any(entity.is_free):
            section, s = parameters[entity.segment][whole_slices(entity.section)], entity.segment
            volume, inner_nodes = problem.mesh.volumes[s], nodes[entity.rows]
            section[...], _ = project(volume, nets[s], section, entity.is_free, inner_nodes, settings)
            n_done += len(inner_nodes)
            progress(n_done / n_nodes, "parameter correction")
    for follower in followers:
        _take_over(follower, parameters)
    return parameters


def project(
    volume: Volume,  # orders and knots
    control_points: np.ndarray,  # (N0, N1, N2, 3), control points (m)
    # parameters of the nodes of a whole section, including its boundary, which stays
    parameters: np.ndarray,  # (m0, m1, m2, 3)
    is_free: Sequence[bool],  # directions in which the section extends
    nodes: np.ndarray,  # (n, 3), inner nodes of the section, in C order (m)
    settings: FittingSettings = FITTING,
) -> tuple[np.ndarray, np.ndarray]:
    """Move parameters so that the mapping comes closer to the nodes, by damped Gauss-Newton steps."""
    # A node of an edge has one parameter to move, a node of a face two, of an interior three. One round:
    # 1. Shorten the steps to keep parameters strictly increasing along grid lines.
    # 2. Try them where nodes are not yet close enough.
    # 3. Accept those that reduce the distance, and compute the next steps there.
    # 4. Halve the others for the next round, so no distance ever grows.
    # returns parameters (m0, m1, m2, 3): new parameters
    # returns points (n, 3): the mapping at the inner parameters (m)
    inner = tuple(slice(1, -1) if free else slice(None) for free in is_free)
    parameters, free = parameters.copy(), np.flatnonzero(is_free)
    current = parameters[inner].reshape(-1, 3).copy()
    points, steps = _gauss_newton(volume, control_points, current, free, nodes)
    distances = ((nodes - points) ** 2).sum(axis=1)
    enough = settings.close**2 * distances.mean()
    for _ in range(settings.correction_steps):
        # step 1
        steps *= _step_limits(parameters, inner, free, steps, settings.largest_step)
        # step 2
        far = np.flatnonzero(distances > enough)
        trial = current[far] + steps[far]
        trial_points, trial_steps = _gauss_newton(volume, control_points, trial, free, nodes[far])
        trial_distances = ((nodes[far] - trial_points) ** 2).sum(axis=1)
        # step 3
        is_better = trial_distances < distances[far]
        better = far[is_better]
        current[better], points[better] = trial[is_better], trial_points[is_better]
        distances[better], steps[better] = trial_distances[is_better], trial_steps[is_better]
        # step 4
        steps[far[~is_better]] *= 0.5
        parameters[inner] = current.reshape(parameters[inner].shape)
    return parameters, points


def _step_limits(
    parameters: np.ndarray,
    inner: tuple[slice, ...],
    free: np.ndarray,
    steps: np.ndarray,
    largest: float,
) -> np.ndarray:
    """Fraction of each step that keeps the order of the parameters, shape (n, 1)."""
    limits = np.ones(len(steps))
    for d in free:
        lines = parameters[inner[:d] + (slice(None),) + inner[d + 1 :]][..., d]
        room = np.moveaxis(np.diff(lines, axis=d), d, 0)
        allowed = largest * np.moveaxis(np.minimum(room[:-1], room[1:]), 0, d).ravel().clip(min=0.0)
        size = np.abs(steps[:, d])
        is_long = size > allowed
        limits[is_long] = np.minimum(limits[is_long], allowed[is_long] / size[is_long])
    return limits[:, None]


def _gauss_newton(
    volume: Volume, control_points: np.ndarray, parameters: np.ndarray, free: np.ndarray, nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the mapping and Gauss-Newton steps of the free parameters, both of shape (n, 3)."""
    points, steps = np.empty_like(nodes), np.zeros_like(nodes)
    is_free = np.isin(np.arange(3), free)
    for start in range(0, len(nodes), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        firsts, gradients = volume_basis_gradients(volume, parameters[chunk])
        arguments = control_points, volume.orders, firsts, gradients, is_free, nodes[chunk]
        _gauss_newton_chunk(*arguments, points[chunk], steps[chunk])
    return points, steps


@njit(cache=True, error_model="numpy")
def _gauss_newton_chunk(B, orders, firsts, gradients, is_free, nodes, points, steps):
    sums, jacobian = np.empty((gradients.shape[1], 3)), np.empty((3, 3))
    normal, scale, right = np.empty((3, 3)), np.empty(3), np.empty(3)
    for q in range(len(nodes)):
        point_and_gradient(B, firsts[q], orders, gradients[q], sums, points[q], jacobian)
        _solve_step(jacobian, is_free, nodes[q], points[q], steps[q], scale, normal, right)


@njit(cache=True, error_model="numpy")
def _solve_step(jacobian, is_free, node, point, step, scale, normal, right):
    """Least-squares step of the free parameters, with columns scaled to unit length."""
    for m in range(3):
        scale[m], right[m] = 1.0, 0.0
        for n in range(3):
            normal[m, n] = 1.0 if m == n else 0.0
        if is_free[m]:
            length = np.sqrt(jacobian[0, m] ** 2 + jacobian[1, m] ** 2 + jacobian[2, m] ** 2)
            scale[m] = 1.0 / length if length > 0.0 else 0.0
    for m in range(3):
        if is_free[m]:
            for c in range(3):
                right[m] += scale[m] * jacobian[c, m] * (node[c] - point[c])
            for n in range(m):
                if is_free[n]:
                    product = 0.0
                    for c in range(3):
                        product += jacobian[c, m] * jacobian[c, n]
                    normal[m, n] = normal[n, m] = product * scale[m] * scale[n]
            normal[m, m] += _DAMPING
    _cramer(normal, right, step)
    for m in range(3):
        step[m] *= scale[m] * is_free[m]


@njit(cache=True, error_model="numpy")
def _cramer(A, r, out):
    """Solution of a symmetric 3 x 3 system."""
    c0, c1, c2 = (
        A[1, 1] * A[2, 2] - A[1, 2] ** 2,
        A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2],
        A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1],
    )
    determinant = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    inverse = 1.0 / determinant if determinant > 0.0 else 0.0
    c11, c12, c22 = (
        A[0, 0] * A[2, 2] - A[0, 2] ** 2,
        A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2],
        A[0, 0] * A[1, 1] - A[0, 1] ** 2,
    )
    out[0] = inverse * (c0 * r[0] + c1 * r[1] + c2 * r[2])
    out[1] = inverse * (c1 * r[0] + c11 * r[1] + c12 * r[2])
    out[2] = inverse * (c2 * r[0] + c12 * r[1] + c22 * r[2])


@dataclass(frozen=True, eq=False)
class _Follower:
    """A section of a segment that equals an entity of another and takes over its parameters."""

    entity: Entity
    segment: int
    section: Section
    orientation: Orientation


def _take_over(follower: _Follower, parameters: Sequence[np.ndarray]) -> None:
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
