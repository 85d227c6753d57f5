"""Fit a multi-block grid with B-spline volumes, section II.D."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import InputError
from ..grids.multiblock import Grid
from ..grids.sharing import NodeSharing, node_sharing, shared_ids
from ..grids.topology import Topology, find_topology
from ..model import FitSettings, FittedModel, GridHeader
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from .control_counts import choose_counts
from .correction import correct_parameters
from .edge_knots import knots_of_segment
from .entities import Entity, entities_in_order
from .errors import report_errors
from .least_squares import FitOperator, build_step
from .parameters import chord_length_parameters
from .prior import edge_blends

Progress = Callable[[float, str], None]
"""Called with the fraction done and what is being done."""


@dataclass(frozen=True, eq=False)
class FitProblem:
    """A fit that is set up: everything except control points.

    Parameters
    ----------
    topology : Topology
        Segments and links.
    sharing : NodeSharing
        Rows of the nodes of every segment.
    mesh : BSplineMesh
        One volume per segment.
    entities : tuple of Entity
        In the order of section II.D.
    blends : tuple of tuples of three ndarray
        For the priors of every segment; they stay when the knots change.
    smoothing : float
        Pull of the interior control points towards the coarse grid that they mimic.
    """

    topology: Topology
    sharing: NodeSharing
    mesh: BSplineMesh
    entities: tuple[Entity, ...]
    blends: tuple[tuple[np.ndarray, ...], ...]
    smoothing: float = 0.0

    @property
    def n_nodes(self) -> int:
        """Nodes of all blocks."""
        return self.topology.n_nodes

    def steps(self, parameters: Sequence[np.ndarray]):
        """Yield the least squares of each entity, factored, for parameters of every segment."""
        names, n_nodes = self.topology.segment_names, self.n_nodes
        for entity in self.entities:
            s, name = entity.segment, f"{self.topology.source}: {entity.describe(names)}"
            segment = self.mesh.volumes[s], parameters[s], self.sharing.rows[s], self.blends[s]
            yield build_step(entity, *segment, n_nodes, name, self.smoothing)

    def operator(self, parameters: Sequence[np.ndarray]) -> FitOperator:
        """Linear map from nodes to control points for these parameters, with all factors kept."""
        with threadpool_limits(1, "blas"):
            return FitOperator(tuple(self.steps(parameters)), self.n_nodes, self.mesh.n_control_points)


@dataclass(frozen=True, eq=False)
class Solution:
    """What a pass of least squares yields.

    Parameters
    ----------
    control_points : ndarray, shape (n_control_points, 3)
        Control points (m).
    fitted : ndarray, shape (n_nodes, 3)
        Points of the spline at the nodes (m).
    warnings : tuple of str
        Entities whose data do not determine all control points.
    """

    control_points: np.ndarray
    fitted: np.ndarray
    warnings: tuple[str, ...]


def fit_grid(
    grid: Grid,
    *,
    topology: Topology | None = None,
    n_control=None,
    order=4,
    knots="curved",
    corrections: int = 0,
    keep_residual: bool = True,
    smoothing: float = 0.0,
    progress: Progress | None = None,
) -> FittedModel:
    """Fit a grid: parameters, knots, then corners, edges, faces and interiors by least squares.

    Parameters
    ----------
    grid : Grid
        The baseline grid.
    topology : Topology, optional
        Its topology; found from coincident nodes by default.
    n_control : triple of int or sequence of triples, optional
        Control points per direction, of all blocks or of each; chosen from the grid by default.
    order : int, triple or sequence of triples
        Order p = degree + 1.
    knots : str or sequence of triples of Knots
        ``"curved"`` (Eq. 5), ``"constant"``, or the user's own knots for every segment.
    corrections : int
        Cycles of parameter correction.
    keep_residual : bool
        Carry what the spline misses of the grid, so that the baseline is reproduced.
    smoothing : float
        Pull interior control points towards the coarse grid that they mimic (`bspline_mdao.fit.prior`); 0 is least
        squares. Values up to 0.1 can unfold control elements inside blocks, at some loss of accuracy. Infinity makes
        all control points that coarse grid itself, surfaces too: the control mesh is then as valid as the coarse grid,
        and the residual carries what it misses, several cells in places.
    progress : callable, optional
        Called with the fraction done and a word on what is being done.

    Returns
    -------
    FittedModel

    Raises
    ------
    InputError
        If the numbers of control points do not fit the grid or each other.
    """
    start, progress = time.perf_counter(), progress or _no_progress
    _check_options(corrections, smoothing)
    progress(0.0, "topology")
    topology = find_topology(grid) if topology is None else topology
    if topology.shapes != grid.shapes:
        raise InputError(f"{grid.source}: the topology is of other blocks, {topology.source}; find that of this grid")
    counts = choose_counts(topology, n_control, order)
    nodes = grid.to_vector().reshape(-1, 3)
    parameters = segment_parameters(grid, topology)
    problem = set_up_fit(topology, parameters, counts.n_control, counts.orders, knots, smoothing)
    solution = solve_fit(problem, parameters, nodes, progress)
    if corrections:
        parameters, solution = correct_parameters(problem, parameters, nodes, solution, corrections, progress)
    residual = nodes - solution.fitted
    names = [block.name for block in grid.blocks]
    nets = problem.mesh.nets(solution.control_points)
    warnings = counts.warnings + solution.warnings
    report = report_errors(
        topology, names, nodes, residual, nets, problem.mesh.n_control_points, time.perf_counter() - start, warnings
    )
    progress(1.0, "done")
    return FittedModel(
        topology=topology,
        mesh=problem.mesh,
        parameters=tuple(parameters),
        control_points=solution.control_points,
        residual=residual if keep_residual else None,
        header=GridHeader.of(grid),
        report=report,
        settings=FitSettings(knots if isinstance(knots, str) else "given", corrections, smoothing),
    )


def segment_parameters(grid: Grid, topology: Topology) -> list[np.ndarray]:
    """Chord-length parameters of the nodes of every segment, each of shape (L0, L1, L2, 3)."""
    return [chord_length_parameters(grid.blocks[w.block].nodes[w.slices]) for w in topology.segments]


def set_up_fit(topology: Topology, parameters, n_control, orders, knots="curved", smoothing: float = 0.0) -> FitProblem:
    """Make volumes, shared control points and entities.

    Parameters
    ----------
    topology : Topology
        Segments and links.
    parameters : sequence of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    n_control, orders : array of int, shape (n_segments, 3)
        Control points and orders; not looked at where ``knots`` carries them.
    knots, smoothing
        As for `fit_grid`.

    Returns
    -------
    FitProblem
    """
    if isinstance(knots, str):
        knots = [knots_of_segment(x, n, p, knots) for x, n, p in zip(parameters, n_control, orders)]
    if not isinstance(knots, Sequence):
        raise InputError(f'{topology.source}: knots = {knots}; use "curved", "constant" or three objects per segment')
    if len(knots) != len(topology.segments):
        raise InputError(f"{topology.source}: knots of {len(knots)} segments; give {len(topology.segments)}")
    mesh = _share_mesh(topology, [Volume(tuple(triple)) for triple in knots])
    return problem_of_mesh(topology, mesh, smoothing)


def problem_of_mesh(topology: Topology, mesh: BSplineMesh, smoothing: float = 0.0) -> FitProblem:
    """Set up the fit of a mesh that exists already, for example that of a fitted model."""
    sharing = node_sharing(topology)
    entities = tuple(entities_in_order(mesh.control_ids, sharing, mesh.n_control_points))
    blends = tuple(edge_blends(volume) for volume in mesh.volumes)
    return FitProblem(topology, sharing, mesh, entities, blends, smoothing)


def solve_fit(problem: FitProblem, parameters, nodes: np.ndarray, progress: Progress | None = None) -> Solution:
    """Solve the least squares of all entities in turn, keeping no factor.

    Parameters
    ----------
    problem : FitProblem
        The fit.
    parameters : sequence of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    progress : callable, optional
        As for `fit_grid`.

    Returns
    -------
    Solution
    """
    progress = progress or _no_progress
    control_points, fitted = np.zeros((problem.mesh.n_control_points, 3)), np.empty_like(nodes)
    singular: list[Entity] = []
    with threadpool_limits(1, "blas"):
        for number, step in enumerate(problem.steps(parameters)):
            step.solve(nodes, control_points)
            fitted[step.entity.rows] = step.evaluate(control_points)
            if step.cholesky is not None and step.cholesky.is_singular:
                singular.append(step.entity)
            progress(number / len(problem.entities), "least squares")
    copies = problem.sharing.copies
    fitted[copies[:, 0]] = fitted[copies[:, 1]]
    return Solution(control_points, fitted, _warn_of_singular(problem.topology, singular))


def _share_mesh(topology: Topology, volumes: Sequence[Volume]) -> BSplineMesh:
    shapes = [volume.n_control for volume in volumes]
    ids = shared_ids(shapes, topology.links, topology.collapses, topology.segment_names)
    return BSplineMesh(tuple(volumes), tuple(ids), 1 + max(int(a.max()) for a in ids))


def _warn_of_singular(topology: Topology, entities: Sequence[Entity]) -> tuple[str, ...]:
    """One line on the entities with too little data."""
    if not entities:
        return ()
    names = topology.segment_names
    shown = ", ".join(entity.describe(names) for entity in entities[:5]) + (", ..." if len(entities) > 5 else "")
    return (
        f"the nodes do not determine all control points of {len(entities)} parts ({shown}); these lean on the "
        f"grid's own coarse nodes; fewer control points avoid it",
    )


def _check_options(corrections: int, smoothing: float):
    if corrections < 0 or corrections != int(corrections):
        raise InputError(f"fit: {corrections} corrections; give a whole number of cycles of at least 0")
    if not smoothing >= 0.0:
        raise InputError(f"fit: smoothing = {smoothing}; give a number of at least 0, for example 0.1 or inf")


def _no_progress(fraction: float, what: str) -> None:
    pass
