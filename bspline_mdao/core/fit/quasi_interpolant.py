"""Control points without a solve: the variation-diminishing quasi-interpolant of a grid, and its iteration.

Schoenberg's operator Q makes every control point the value of the data at its Greville parameters. It reproduces data
that are linear in the parameters, preserves monotone data, is local and linear in the data, and needs no solve. Here
the data are the grid between its nodes, trilinear in its cells. A control point is at the *place* (three real node
numbers) where the interpolated parameters equal its Greville parameters.

With A the spline at the nodes, ``b <- b + Q (x - A b)`` approaches the accuracy of least squares.

Theory: ``docs/theory/fit.rst``.

References
----------
I. J. Schoenberg, "On spline functions", in: Inequalities, O. Shisha (ed.), Academic Press, 1967.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from ...base.display import OneLine
from ...base.numerics.processes import summed
from ...grids.topology.block_layout import BlockLayout
from ..evaluation.evaluator import Evaluator
from ..model.records import ITERATIONS
from ..splines.greville import greville_abscissae
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from .fit_nodes import FitNodes

CONVERGED = 1e-10
"""Largest change, in cells, of a place in its last round."""

MOST_ROUNDS = 100
"""Rounds after which a place is accepted: any place in the grid gives a control point."""


@dataclass(frozen=True, eq=False)
class QuasiInterpolant:
    """Linear maps from the nodes of a grid to control points, for given parameters and knots."""

    # There is one map for each of `bspline_mdao.core.model.records.CANDIDATES` except the first: Q with 8, 4, 2 and no
    # iterations, and the grid at its Greville nodes.

    sampling: csr_array  # (n_control_points, n_sampled), Q, as weights of the nodes that it needs
    sampled: np.ndarray  # int (n_sampled,), numbers of these nodes
    coarse: csr_array  # (n_control_points, n_nodes), weights of the nodes next to the Greville nodes
    evaluator: Evaluator  # A of the nodes of this process that any process samples
    # real node numbers, from 0, of the Greville parameters of the control points of every segment of this process; of
    # shape (0, 0, 0, 3) for others
    places: tuple[np.ndarray, ...]  # each (N0, N1, N2, 3)
    sharing: FitNodes  # the nodes; with several processes, each has the rows of the maps from its own segments
    evaluated: np.ndarray  # int, numbers of the nodes that the evaluator evaluates

    @classmethod
    def of(
        cls,
        mesh: BSplineMesh,  # knots, and the control points that volumes share
        sharing: FitNodes,  # the nodes of this process
        parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    ) -> QuasiInterpolant:
        """Find the places of all control points."""
        greville, nodal = ([np.empty((0, 0, 0, 3))] * len(mesh.volumes) for _ in range(2))
        for s in sharing.here:
            greville[s] = parametric_places(mesh.volumes[s], parameters[s])
            nodal[s] = nodal_places(mesh.volumes[s], parameters[s].shape[:3])
        weights = sampling_matrix(mesh, sharing, greville)
        sampled, columns = np.unique(weights.indices, return_inverse=True)
        sampling = csr_array((weights.data, columns, weights.indptr), shape=(weights.shape[0], len(sampled)))
        is_sampled = np.zeros(sharing.n_rows, dtype=bool)
        is_sampled[sampled] = True
        sharing.put(is_sampled, is_sampled.copy())
        evaluated = np.flatnonzero(is_sampled[: sharing.n_owned])
        number = np.full(sharing.n_rows, -1)
        number[evaluated] = np.arange(len(evaluated))
        is_local = [local & (number[rows] >= 0) for local, rows in zip(sharing.is_evaluated, sharing.rows)]
        local_parameters = [x[local] for x, local in zip(parameters, is_local)]
        local_numbers = [number[rows[local]] for rows, local in zip(sharing.rows, is_local)]
        evaluator = Evaluator.build(mesh, local_parameters, local_numbers, len(evaluated))
        coarse = sampling_matrix(mesh, sharing, nodal)
        return cls(sampling, sampled, coarse, evaluator, tuple(greville), sharing, evaluated)

    def forward(
        self,
        nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
        # weight of each of `bspline_mdao.core.model.records.CANDIDATES` in each control point; the weight of least
        # squares is ignored
        weights: np.ndarray,  # (n_control_points, 6)
    ) -> np.ndarray:  # (n_control_points, 3)
        """Control points that mix the candidates."""
        result = weights[:, -1:] * self._joined(self.coarse @ nodes)
        samples = points = self._joined(self.sampling @ nodes[self.sampled])
        for number in range(ITERATIONS[0] + 1):
            if number in ITERATIONS:
                result += weights[:, 1 + ITERATIONS.index(number), None] * points
            points = points + samples - self._resampled(points)
        return result

    def _joined(self, points: np.ndarray) -> np.ndarray:
        """Control points of all processes, each of which computes those that its segments are the first to have."""
        return summed(self.sharing.comm, points)

    def _resampled(self, points: np.ndarray) -> np.ndarray:
        """Apply Q A to control points."""
        values = self.evaluator.forward(points)
        if self.sharing.comm.size > 1:
            at_nodes = np.zeros((self.sharing.n_rows, 3), values.dtype)
            at_nodes[self.evaluated] = values
            values = self.sharing.fetch(at_nodes)[self.sampled]
        return self._joined(self.sampling @ values)

    def _resampled_transpose(self, bar: np.ndarray) -> np.ndarray:
        """Apply the transpose of Q A."""
        values = self.sampling.T @ bar
        if self.sharing.comm.size > 1:
            at_nodes = np.zeros((self.sharing.n_rows, 3), values.dtype)
            at_nodes[self.sampled] = values
            values = self.sharing.add_back(at_nodes)[self.evaluated]
        return self._joined(self.evaluator.adjoint(values))

    def adjoint(self, bar: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Transpose of `forward`: cotangent of the nodes, shape (n_nodes, 3), from the control points'."""
        nodes_bar = self.coarse.T @ (weights[:, -1:] * bar)
        points_bar, samples_bar = np.zeros_like(bar), np.zeros_like(bar)
        for number in range(ITERATIONS[0], -1, -1):
            if number < ITERATIONS[0]:
                samples_bar = samples_bar + points_bar
                points_bar = points_bar - self._resampled_transpose(points_bar)
            if number in ITERATIONS:
                points_bar = points_bar + weights[:, 1 + ITERATIONS.index(number), None] * bar
        nodes_bar[self.sampled] += self.sampling.T @ (samples_bar + points_bar)
        return nodes_bar

    def candidates(self, nodes: np.ndarray) -> np.ndarray:
        """All candidates except least squares, shape (5, n_control_points, 3), for a grid (m)."""
        samples = points = self._joined(self.sampling @ nodes[self.sampled])
        iterated = [points]
        for _ in range(ITERATIONS[0]):
            points = points + samples - self._resampled(points)
            iterated.append(points)
        return np.stack([*(iterated[number] for number in ITERATIONS), self._joined(self.coarse @ nodes)])


@dataclass(frozen=True, eq=False)
class SurfaceQuasiInterpolant(OneLine):
    """Q with some iterations for the control points of a surface, which depend only on the surface's nodes."""

    sampling: csr_array  # (n_surface, n), Q
    resampling: csr_array  # (n_surface, n_surface), Q A
    n_iterations: int

    @classmethod
    def of(
        cls, quasi: QuasiInterpolant, surface_ids: np.ndarray, numbers: np.ndarray, n_iterations: int
    ) -> SurfaceQuasiInterpolant:
        """Take the control points of a surface, shape (n_surface,), from the whole grid on one process."""
        # ``numbers`` gives, for each row of the grid vector, its node of the surface, or -1.
        sampling = csr_array(quasi.sampling[surface_ids])
        used = np.unique(sampling.indices)
        used = used[numbers[quasi.sampled[used]] >= 0]
        sampling = csr_array(sampling[:, used])
        resampling = csr_array(sampling @ quasi.evaluator.matrix()[used][:, surface_ids])
        entries = sampling.data, numbers[quasi.sampled[used]][sampling.indices], sampling.indptr
        return cls(csr_array(entries, shape=(len(surface_ids), numbers.max() + 1)), resampling, n_iterations)

    def forward(self, nodes: np.ndarray) -> np.ndarray:
        """Control points, shape (n_surface, 3), from nodes of the surface, shape (n, 3)."""
        samples = points = self.sampling @ nodes
        for _ in range(self.n_iterations):
            points = points + samples - self.resampling @ points
        return points

    def adjoint(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`."""
        samples_bar, points_bar = np.zeros_like(bar), bar
        for _ in range(self.n_iterations):
            samples_bar = samples_bar + points_bar
            points_bar = points_bar - self.resampling.T @ points_bar
        return self.sampling.T @ (samples_bar + points_bar)


@dataclass(frozen=True, eq=False)
class Mixture:
    """Control points that mix least squares and the other candidates; by default only least squares."""

    # weight of each of `bspline_mdao.core.model.records.CANDIDATES` in each control point
    weights: np.ndarray | None = None  # (n_control_points, 6)
    quasi: QuasiInterpolant | None = None  # the candidates; needed if there are weights

    @classmethod
    def of(
        cls, weights: np.ndarray | None, mesh: BSplineMesh, sharing: FitNodes, parameters: Sequence[np.ndarray]
    ) -> Mixture:
        """Set up the candidates if there are weights; other arguments as for `QuasiInterpolant.of`."""
        return cls() if weights is None else cls(weights, QuasiInterpolant.of(mesh, sharing, parameters))

    @property
    def has_least_squares(self) -> bool:
        """Whether least squares have a weight in any control point."""
        return self.weights is None or bool(self.weights[:, 0].any())

    def forward(self, least_squares: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Control points from least-squares ones, shape (n_control_points, 3), and the nodes, shape (n_nodes, 3)."""
        if self.weights is None or self.quasi is None:
            return least_squares
        return self.weights[:, :1] * least_squares + self.quasi.forward(nodes, self.weights)

    def adjoint(self, control_bar: np.ndarray, n_nodes: int) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `forward`: new arrays, the cotangents of the least squares and of the nodes."""
        if self.weights is None or self.quasi is None:
            return control_bar.copy(), np.zeros((n_nodes, 3))
        return self.weights[:, :1] * control_bar, self.quasi.adjoint(control_bar, self.weights)


LEAST_SQUARES = Mixture()
"""Only least squares."""


def parametric_places(
    volume: Volume,  # orders and knots
    parameters: np.ndarray,  # (L0, L1, L2, 3), parameters of the nodes
) -> np.ndarray:
    """Real node numbers, from 0, at which a grid has the Greville parameters of each control point."""
    # returns (N0, N1, N2, 3); between the nodes the parameters are trilinear. Ends are exact: a control point of a face
    # is on this face
    places = nodal_places(volume, parameters.shape[:3])
    _find_places(parameters, greville_abscissae(volume).reshape(-1, 3), places.reshape(-1, 3))
    return places


def greville_places(n_nodes: int, n_control: int, order: int) -> np.ndarray:
    """Real node numbers, from 0, of the Greville nodes of an edge: means of the node numbers of p - 1 inner knots.

    Examples
    --------
    >>> greville_places(n_nodes=9, n_control=6, order=3)
    array([0., 1., 3., 5., 7., 8.])
    """
    # The edge-knot formula of section II.D fixes them before any parameter.
    breaks = np.linspace(0, n_nodes - 1, n_control + 2 - order)
    knots = np.concatenate([np.repeat(breaks[0], order - 1), breaks, np.repeat(breaks[-1], order - 1)])
    return greville_means(knots, n_control, order)


def greville_means(knots: np.ndarray, n_control: int, order: int) -> np.ndarray:
    """Means of p - 1 consecutive inner knots, shape (n_control,); 0 for a single control point."""
    if n_control == 1:
        return np.zeros(1)
    return np.lib.stride_tricks.sliding_window_view(knots[1:-1], order - 1).mean(axis=1)


def nodal_places(volume: Volume, shape: Sequence[int]) -> np.ndarray:
    """Real node numbers of the Greville nodes of each control point, shape (N0, N1, N2, 3)."""
    axes = [greville_places(*line) for line in zip(shape, volume.n_control, volume.orders)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def sampling_matrix(
    mesh: BSplineMesh,  # a control point that segments share is sampled in the first of them
    sharing: FitNodes,  # a node with several rows is taken from the first of them
    # real node numbers, from 0, of the control points of every segment of this process
    places: Sequence[np.ndarray],  # each (N0, N1, N2, 3)
) -> csr_array:
    """Trilinear interpolation of the grid at one place for each control point."""
    # returns (n_control_points, n_rows); rows of control points that first belong to other processes are zero
    source = sharing.source_rows()
    layout = BlockLayout.of(map(np.shape, mesh.control_ids))
    ids, starts = layout.join(mesh.control_ids), layout.starts
    _, first = np.unique(ids, return_index=True)
    columns, values, numbers = [], [], []
    for s in sharing.here:
        rows, place, start, end = sharing.rows[s], places[s], starts[s], starts[s + 1]
        local = first[(first >= start) & (first < end)]
        last = np.array(rows.shape) - 1
        place = place.reshape(-1, 3)[local - start]
        low = np.minimum(place.astype(int), np.maximum(last - 1, 0))
        fraction = place - low
        for corner in np.ndindex(2, 2, 2):
            i, j, k = np.minimum(low + corner, last).T
            columns.append(source[rows[i, j, k]])
            values.append(np.prod(np.where(corner, fraction, 1 - fraction), axis=1))
            numbers.append(ids[local])
    all_values = np.concatenate([np.zeros(0), *values])
    is_used, none = all_values != 0, np.zeros(0, dtype=np.int64)
    places_used = (np.concatenate([none, *parts])[is_used] for parts in (numbers, columns))
    entries = all_values[is_used], tuple(places_used)
    return csr_array(entries, shape=(mesh.n_control_points, len(source)))


@njit(cache=True, nogil=True, error_model="numpy")
def _find_places(parameters, wanted, places):
    """Move each place along the three lines through it in turn until its parameters are the wanted ones."""
    cell, fraction, is_end = np.zeros(3, dtype=np.int64), np.zeros(3), np.zeros(3, dtype=np.bool_)
    for q in range(len(wanted)):
        place = places[q]
        for d in range(3):
            last = parameters.shape[d] - 1
            is_end[d] = place[d] <= 0.0 or place[d] >= last  # a point of a face needs only the nodes of this face
            cell[d] = min(int(place[d]), max(last - 1, 0))
            fraction[d] = place[d] - cell[d]
        for _ in range(MOST_ROUNDS):
            change = 0.0
            for d in range(3):
                if not is_end[d]:
                    before = place[d]
                    _place_on_line(parameters, d, wanted[q, d], cell, fraction)
                    place[d] = cell[d] + fraction[d]
                    change = max(change, abs(place[d] - before))
            if change <= CONVERGED:
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _place_on_line(parameters, d, wanted, cell, fraction):
    """Find the cell along direction d, and the place in it, at which the line through a place has a parameter."""
    low, high = 0, parameters.shape[d] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if _parameter(parameters, d, middle, cell, fraction) <= wanted:
            low = middle
        else:
            high = middle
    start, end = _parameter(parameters, d, low, cell, fraction), _parameter(parameters, d, high, cell, fraction)
    part = (wanted - start) / (end - start) if end > start else 0.0
    cell[d], fraction[d] = low, min(max(part, 0.0), 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _parameter(parameters, d, number, cell, fraction):
    """Parameter d at a node number of the line along d through a place, bilinear between four grid lines."""
    e, f = (d + 1) % 3, (d + 2) % 3
    total = 0.0
    for a in range(2):
        for b in range(2):
            weight = (fraction[e] if a else 1.0 - fraction[e]) * (fraction[f] if b else 1.0 - fraction[f])
            if weight != 0.0:
                i = number if d == 0 else cell[0] + (a if e == 0 else b)
                j = number if d == 1 else cell[1] + (a if e == 1 else b)
                k = number if d == 2 else cell[2] + (a if e == 2 else b)
                total += weight * parameters[i, j, k, d]
    return total
