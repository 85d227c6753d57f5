"""Surface control points of a fitted model for given surface nodes, where the nodes are those of no spline as well.

With ``x(s)`` the nodes of surface control points s (`bspline_mdao.mesh.surface_map`) and w the given nodes, both ways
here are steps

    s <- s + L (w - x(s))

and differ in the linear map L from nodes to control points:

- `fit_surface` takes one step from the baseline, with the L of the fit itself (section II.D: corners, edges and faces
  in turn, the model's own candidates). It keeps control points whose nodes have not moved, and follows motions and
  stretches of the whole surface exactly. It is what sets up the moves of section IV.
- `SurfaceLeastSquares` repeats steps with the pseudo-inverse of dx/ds until the difference is orthogonal to all that
  control points can do: the surface nearest to the nodes, with its exact derivative.

Theory: ``docs/theory/fit.rst``.

References
----------
A. Bjorck, "Numerical Methods for Least Squares Problems", SIAM, 1996: normal equations, their iterative refinement, and
Gauss-Newton steps.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import SuperLU, splu

from ..errors import InputError, MovementError
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface_map import SurfaceMap, SurfaceState
from ..model.fitted_model import FittedModel
from ..shown import OneLine
from ..topology.index_space import Window, block_rows
from ..topology.topology import Topology
from .problem import problem_of_mesh

LOGGER = logging.getLogger(__name__)
"""Logs how far each surface misses its target: a warning beyond `NOTABLE_MISS`."""

NOTABLE_MISS = 1e-3
"""A surface that misses its target by more than this fraction of its size is a warning in the log."""


_SMALLEST_PIVOT = 1e-13
"""Pivot, relative to the largest, below which nodes do not determine the control points."""

_MOST_STEPS = 60
"""Steps after which nodes count as such that no control points are nearest to."""

_ROUND_OFF = 1e-15
"""A step is the last one where it is shorter than this part of what it changes."""


@dataclass(frozen=True)
class SurfaceMiss(OneLine):
    """Distance of the nodes of a surface from those that its control points were fitted to.

    Parameters
    ----------
    largest, rms : float
        Largest distance, and the root mean square over all nodes (m).
    size : float
        Diagonal of the target's box (m).
    n_nodes : int
        Nodes of the surface, each counted once.
    patch, block : str
        Patch and block of the node that is farthest off; empty where no patch is declared there.
    node : tuple of three int
        Its place in the block, from 1.
    """

    largest: float
    rms: float
    size: float
    n_nodes: int
    patch: str
    block: str
    node: tuple[int, int, int]

    @classmethod
    def of(
        cls, topology: Topology, source: np.ndarray, rows: np.ndarray, nodes: np.ndarray, target: np.ndarray
    ) -> SurfaceMiss:
        """Compare nodes of a surface with their target.

        Parameters
        ----------
        topology : Topology
            Topology of the grid.
        source : ndarray of int, shape (n_nodes,)
            Row that stands for each row of the grid vector, see
        `bspline_mdao.topology.sharing.NodeSharing.source_rows`.
        rows : ndarray of int, shape (n,)
            Row of each node in the grid vector.
        nodes, target : ndarray, shape (n, 3)
            Where the nodes are, and where they were to be (m).
        """
        distances = np.linalg.norm(nodes - target, axis=1)
        worst = int(np.argmax(distances))
        place = _place_on_patch(topology, source, source[rows[worst]])
        rms, size = np.sqrt(np.mean(distances**2)), np.linalg.norm(np.ptp(target, axis=0))
        return cls(float(distances[worst]), float(rms), float(size), len(rows), *place)

    def __str__(self) -> str:
        size = f" ({self.largest / self.size:.2g} of its size)" if self.size else ""
        patch = f", patch {self.patch}" if self.patch else ""
        return (
            f"the surface misses its target by {self.largest:.3g} m at most{size}, {self.rms:.3g} m RMS; the worst is "
            f"node {self.node} of {self.block}{patch}"
        )

    def log(self, prefix: str = "") -> None:
        """Log it: as a warning if it is notable, and as information if not."""
        is_notable = self.largest > NOTABLE_MISS * self.size
        LOGGER.log(logging.WARNING if is_notable else logging.INFO, "%s%s", prefix, self)


@dataclass(frozen=True, eq=False)
class SurfaceFit(OneLine):
    """Surface control points for another surface, and how far that is missed.

    Parameters
    ----------
    control_points : ndarray, shape (n_surface, 3)
        The surface control points (m).
    miss : SurfaceMiss
        Distance of the regenerated surface nodes to those that were asked for.
    """

    control_points: np.ndarray
    miss: SurfaceMiss


def fit_surface(model: FittedModel, surface_ids: np.ndarray, nodes: np.ndarray) -> SurfaceFit:
    """Fit the surface control points of a model to moved surface nodes, section II.D.

    What the nodes have moved is fitted as the grid was, corners, edges and faces in turn, with the model's own
    parameters, knots and fallback, and added to the control points: those of nodes which have not moved stay, and those
    of a surface that is turned or stretched as a whole follow it.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    surface_ids : ndarray of int, shape (n_surface,)
        Numbers of the surface control points: those of whole faces, such as ``surface_ids`` of a moving mesh.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m) with its surface nodes moved, wherever a block holds them (`replace_nodes`). Others do not count.

    Returns
    -------
    SurfaceFit
        Surface control points, in the order of ``surface_ids``, and how far the surface misses the nodes: control
        points have fewer degrees of freedom than nodes. That is logged, too, see `LOGGER`.

    Raises
    ------
    InputError
        If the nodes do not fit the model, or the control points are not those of whole faces.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import brick_grid, fit_grid, fit_surface, moving_mesh
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> mesh, nodes = moving_mesh(model), model.regenerate().to_vector().reshape(-1, 3)
    >>> found = fit_surface(model, mesh.surface_ids, nodes * [1.0, 1.1, 1.0])  # 10 % thicker
    >>> bool(np.allclose(found.control_points, mesh.points[mesh.surface_ids] * [1.0, 1.1, 1.0]))
    True
    """
    if nodes.shape != (model.n_nodes, 3):
        raise InputError(f"{model.header.source}: nodes of shape {nodes.shape}; give shape ({model.n_nodes}, 3)")
    problem = problem_of_mesh(model.topology, model.mesh)
    is_surface = np.zeros(model.mesh.n_control_points, dtype=bool)
    is_surface[surface_ids] = True
    entities = [entity for entity in problem.entities if is_surface[entity.control_ids].all()]
    is_surface[[i for entity in entities for i in entity.unknown_ids]] = False
    if is_surface.any():
        missing = surface_ids[np.argmax(is_surface[surface_ids])]
        raise InputError(
            f"{model.header.source}: control point {missing + 1} belongs to no face of the surface; give whole faces"
        )
    operator = problem.operator(model.parameters, model.candidate_weights, entities)
    moves = nodes - model.regenerate().to_vector().reshape(-1, 3)
    control_points = model.control_points[surface_ids] + operator.forward(moves)[surface_ids]
    rows = np.unique(np.concatenate([entity.rows for entity in entities]))
    fitted = SurfaceMap.of_rows(model, surface_ids, rows).apply(control_points)
    miss = SurfaceMiss.of(model.topology, problem.sharing.source_rows(), rows, fitted, nodes[rows])
    miss.log(f"{model.header.source}: ")
    return SurfaceFit(control_points, miss)


@dataclass(frozen=True, eq=False)
class SurfaceLeastSquares:
    """Least squares for control points s, whose nodes ``x(s) = A s + T(s) r + c`` shall be closest to given ones, w.

    With ``A+`` the pseudo-inverse of A, by its normal equations, the steps ``s <- s + P A+ (w - x(s))`` end where
    the difference is orthogonal to all that control points can do. Where no residual turns the second one is a step of
    refinement. P keeps control points in planes of symmetry, which least squares alone would leave where the nodes
    are those of no spline. Nodes of a spline surface give back its control points to round-off.

    Parameters
    ----------
    surface_map : SurfaceMap
        From control points to nodes.
    numbers : ndarray of int, shape (n,)
        Which of the nodes are given, in which order.
    mesh : MovingMesh
        Its surface points are those that are looked for.
    matrix : csr_array, shape (n, n_surface)
        A.
    factor : SuperLU
        Of the transpose of A times A.
    """

    surface_map: SurfaceMap
    numbers: np.ndarray
    mesh: MovingMesh
    matrix: csr_array
    factor: SuperLU

    def __reduce__(self):
        """Take the factor along as what it is made of: SuperLU cannot be pickled."""
        return SurfaceLeastSquares.of, (self.surface_map, self.mesh, self.numbers)

    @classmethod
    def of(cls, surface_map: SurfaceMap, mesh: MovingMesh, numbers: np.ndarray | None = None) -> SurfaceLeastSquares:
        """Invert the map of a surface.

        Parameters
        ----------
        surface_map : SurfaceMap
            From control points to nodes.
        mesh : MovingMesh
            The mesh that it was made for.
        numbers : ndarray of int, shape (n,), optional
            Which nodes are given, in which order; all of the surface in its own by default.

        Raises
        ------
        InputError
            If the nodes do not determine all surface control points.
        """
        numbers = np.arange(surface_map.matrix.shape[0]) if numbers is None else numbers
        matrix = csr_array(surface_map.matrix[numbers])
        return cls(surface_map, numbers, mesh, matrix, _factor(matrix))

    def at(self, nodes: np.ndarray) -> FittedSurface:
        """Control points and their derivative at nodes, shape (n, 3), in metres.

        Raises
        ------
        MovementError
            If the steps do not end.
        """
        initial = self.mesh.points[self.mesh.surface_ids]

        def step(control_points: np.ndarray) -> np.ndarray:
            state = self.surface_map.at(control_points)
            return self._slide(self._fit(nodes - state.nodes[self.numbers]))

        control_points = _refined(step, initial.copy())
        return FittedSurface(self, control_points, self.surface_map.at(control_points))

    def _fit(self, change: np.ndarray) -> np.ndarray:
        """A+ times a change of nodes."""
        return self.factor.solve(self.matrix.T @ change)

    def _fit_transpose(self, bar: np.ndarray) -> np.ndarray:
        return self.matrix @ self.factor.solve(bar, "T")

    def _slide(self, change: np.ndarray) -> np.ndarray:
        """Take what would leave planes of symmetry off a change of control points; its own transpose."""
        rows, normals, slid = self.mesh.in_plane_rows, self.mesh.in_plane_normals, change.copy()
        np.subtract.at(slid, rows, np.sum(change[rows] * normals, axis=1)[:, None] * normals)
        return slid


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """Control points that were fitted to nodes, and their derivative.

    Parameters
    ----------
    of : SurfaceLeastSquares
        What fitted them.
    control_points : ndarray, shape (n_surface, 3)
        The surface control points (m).
    state : SurfaceState
        The nodes of these control points.
    """

    of: SurfaceLeastSquares
    control_points: np.ndarray
    state: SurfaceState

    @property
    def nodes(self) -> np.ndarray:
        """Nodes of these control points, those that were given, shape (n, 3), in metres."""
        return self.state.nodes[self.of.numbers]

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the control points, shape (n_surface, 3), with that of the nodes, shape (n, 3)."""
        of = self.of

        def step(found: np.ndarray) -> np.ndarray:
            return of._slide(of._fit(change - self.state.jvp(found)[of.numbers]))

        return _refined(step, np.zeros_like(self.control_points))

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`, shape (n, 3), of ``bar``, shape (n_surface, 3)."""
        of, slid = self.of, self.of._slide(bar)

        def step(found: np.ndarray) -> np.ndarray:
            nodes_bar = np.zeros_like(self.state.nodes)
            np.add.at(nodes_bar, of.numbers, of._fit_transpose(found))
            return of._slide(slid - self.state.vjp(nodes_bar))

        return of._fit_transpose(_refined(step, np.zeros_like(slid)))


def _refined(step: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
    """Add steps to values until these stay as they are, or round-off alone keeps the steps from getting shorter.

    Raises
    ------
    MovementError
        If they do not.
    """
    before = np.inf
    for number in range(_MOST_STEPS):
        change = step(values)
        values = values + change
        size, length = np.abs(values).max(), np.abs(change).max()
        # steps shrink by a large factor each; one of 1e-12 that does not even halve the one before is made of round-off
        if length <= _ROUND_OFF * size or (number > 1 and before <= 1e-12 * size and length > 0.5 * before):
            return values
        before = length
    raise MovementError(
        f"surface: no control points are found for these nodes in {_MOST_STEPS} steps, the last of {length:.3g} m; "
        f"take a smaller deformation"
    )


def _factor(matrix: csr_array) -> SuperLU:
    """Factor of the normal equations."""
    undetermined = InputError(
        f"surface: its {matrix.shape[0]} nodes do not determine the {matrix.shape[1]} control points of the design "
        f"surface; give the nodes of all its patches"
    )
    try:
        factor = splu((matrix.T @ matrix).tocsc())
    except RuntimeError as error:  # SuperLU met a zero pivot
        raise undetermined from error
    pivots = np.abs(factor.U.diagonal())
    if pivots.min() < _SMALLEST_PIVOT * pivots.max():
        raise undetermined
    return factor


def replace_nodes(topology: Topology, nodes: np.ndarray, pieces: Sequence[tuple[Window, np.ndarray]]) -> np.ndarray:
    """Replace nodes of some windows, wherever a block holds them.

    Parameters
    ----------
    topology : Topology
        Topology of the grid.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    pieces : sequence of (Window, ndarray of the window's shape and 3)
        New nodes (m). Where windows share nodes the last one counts.

    Returns
    -------
    ndarray, shape (n_nodes, 3)
        The grid with the new nodes, and everything else as it was.
    """
    rows, ids = block_rows(topology.shapes), np.empty(topology.n_nodes, dtype=np.int64)
    for segment, segment_ids in zip(topology.segments, topology.node_ids()):
        ids[rows[segment.block][segment.slices]] = segment_ids
    values, is_new = np.empty((ids.max() + 1, 3)), np.zeros(ids.max() + 1, dtype=bool)
    for window, points in pieces:
        there = ids[rows[window.block][window.slices]]
        values[there], is_new[there] = points, True
    return np.where(is_new[ids][:, None], values[ids], nodes)


def _place_on_patch(topology: Topology, source: np.ndarray, row: int) -> tuple[str, str, tuple[int, int, int]]:
    """Patch, block and place in it, from 1, of a node by its row: on a declared patch if one holds it."""
    blocks = block_rows(topology.shapes)
    faces = [(face.window, face.patch) for face in topology.boundary if face.patch is not None]
    whole = [(Window.whole(number, shape), "") for number, shape in enumerate(topology.shapes)]
    for window, patch in (*faces, *whole):
        found = np.argwhere(source[blocks[window.block][window.slices]] == row)
        if len(found):
            i, j, k = (int(n) + 1 for n in found[0] + window.lo)
            return patch, f"block {window.block + 1}", (i, j, k)
    raise IndexError(row)
