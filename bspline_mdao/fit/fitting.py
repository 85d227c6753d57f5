"""Fit a multi-block grid with B-spline volumes, section II.D.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import FitWarning, InputError
from ..model.fitted_model import FittedModel
from ..model.records import FitSettings, GridHeader
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from ..topology.detection import find_topology
from ..topology.grid import Grid
from ..topology.sharing import node_sharing
from ..topology.topology import Topology, shared_ids
from .control_counts import choose_affordable_counts, predict_factor_bytes
from .correction import CYCLE_COST, correct_parameters
from .edge_knots import knots_of_segments, require_agreement
from .errors import report_errors
from .parameters import EXPONENTS, as_parameters, chord_length_parameters
from .problem import FitProblem, Progress, no_progress, part_of, problem_of_mesh, solve_fit
from .validity import make_valid


def _solve_valid(problem: FitProblem, parameters, nodes: np.ndarray, progress: Progress = no_progress):
    return make_valid(problem, parameters, nodes, solve_fit(problem, parameters, nodes, progress))


def _interpolate(problem: FitProblem, parameters, nodes: np.ndarray, progress: Progress = no_progress):
    return make_valid(problem, parameters, nodes, None)


_SOLVERS = {"valid": _solve_valid, "least_squares": solve_fit, "quasi_interpolant": _interpolate}

METHODS = tuple(_SOLVERS)
"""How control points are found, see `fit_grid`."""


def fit_grid(
    grid: Grid,
    *,
    topology: Topology | None = None,
    n_control=None,
    order=None,
    knots="curved",
    corrections: int = 0,
    keep_residual: bool = True,
    wall_layer: bool = True,
    parametrization="chord_length",
    method: str = "valid",
    progress: Progress | None = None,
) -> FittedModel:
    """Fit a grid: parameters, knots, then corners, edges, faces and interiors.

    Parameters
    ----------
    grid : Grid
        The baseline grid. Where blocks meet, all of them get the nodes of the first: what is joined over a gap, or up
        to round-off, has equal bits in every grid that is regenerated.
    topology : Topology, optional
        Its topology; found from coincident nodes by default.
    n_control : triple of int or sequence of triples, optional
        Control points per direction, of all blocks or of each; chosen from the grid by default. It does not count, nor
        does the order, where the user gives knots, which have both.
    order : int, triple or sequence of triples, optional
        Order p = degree + 1; by default 4, or 3 in short directions where the numbers of control points are chosen, see
        `bspline_mdao.fit.control_counts.choose_counts`.
    knots : str or sequence of triples of Knots
        ``"curved"`` (Eq. 5), ``"constant"``, or the user's own knots for every segment.
    corrections : int
        Cycles of parameter correction.
    keep_residual : bool
        Keep what the spline misses of the grid, so that the baseline is reproduced.
    wall_layer : bool
        Let nodes near walls follow them as a rigid body, and the residual turn with its surroundings, wherever the grid
        is regenerated, see `bspline_mdao.walls.grid_map`. Without, grids are ``A b``, Eq. (3), plus the residual.
    parametrization : str or sequence of ndarray
        Parameters of the nodes along every grid line: ``"chord_length"``; ``"centripetal"``, by square roots of chord
        lengths; ``"uniform"`` or ``"index"``, proportional to the index; or the user's own, an array of shape
        (ni, nj, nk, 3) for every block (or segment), rising from 0 to 1 along every line and equal where blocks meet.
    method : str
        One of `METHODS`: ``"valid"`` is least squares where these give a valid control mesh; where they fold, control
        points fall back on a quasi-interpolant, as far as is needed (`bspline_mdao.fit.validity`).
        ``"least_squares"`` stays with least squares, as the paper. ``"quasi_interpolant"`` solves nothing: it takes no
        more memory than the grid, and falls back likewise where the iterated quasi-interpolant folds.
    progress : callable, optional
        Called with the fraction done and a word on what is being done.

    Returns
    -------
    FittedModel

    Raises
    ------
    InputError
        If the numbers of control points do not fit the grid or each other, the user's own knots do not agree along
        an interface, or an option is unknown.

    Warns
    -----
    FitWarning
        If control elements are invalid: once, at the caller's line, with what mends it. If faces of blocks nearly meet
        and are not joined: once as well, with the worst place.
    """
    start, progress = time.perf_counter(), progress or no_progress
    _check_options(corrections, method)
    progress(0.0, "topology")
    topology = find_topology(grid) if topology is None else topology
    if topology.shapes != grid.shapes:
        raise InputError(f"{grid.source}: the topology is of other blocks, {topology.source}; find that of this grid")
    grid = _joined(grid, topology)
    nodes = grid.to_vector().reshape(-1, 3)
    parameters = segment_parameters(grid, topology, parametrization)
    problem, size_warnings, factor_bytes = _sized_problem(topology, parameters, n_control, order, knots)
    fraction = 1 / (1 + CYCLE_COST * corrections)
    solution = _SOLVERS[method](problem, parameters, nodes, part_of(progress, 0, fraction))
    if corrections:
        rest = part_of(progress, fraction, 1)
        arguments = problem, parameters, nodes, solution, corrections, rest, _SOLVERS[method]
        parameters, solution = correct_parameters(*arguments)
    names = [block.name for block in grid.blocks]
    report = report_errors(problem, names, parameters, nodes, solution)
    said = (*topology.warnings, *size_warnings, *report.warnings)
    report = replace(report, seconds=time.perf_counter() - start, warnings=said, factor_bytes=factor_bytes)
    if topology.near_misses:
        warnings.warn(f"{grid.source}: {topology.warnings[0]}", FitWarning, stacklevel=2)
    if report.n_invalid:
        warnings.warn(f"{grid.source}: {report.warnings[-1]}", FitWarning, stacklevel=2)
    progress(1.0, "done")
    return FittedModel(
        topology=topology,
        mesh=problem.mesh,
        parameters=tuple(parameters),
        control_points=solution.control_points,
        residual=nodes - solution.fitted if keep_residual else None,
        header=GridHeader.of(grid),
        report=report,
        settings=FitSettings(_kind(knots), corrections, _kind(parametrization), method, wall_layer),
        candidate_weights=solution.weights,
    )


def _joined(grid: Grid, topology: Topology) -> Grid:
    """Give nodes that are one point the place of the first of them."""
    nodes, copies = grid.to_vector().reshape(-1, 3), node_sharing(topology).copies
    if np.array_equal(nodes[copies[:, 0]], nodes[copies[:, 1]]):
        return grid
    nodes[copies[:, 0]] = nodes[copies[:, 1]]
    return grid.with_vector(nodes.ravel())


def _sized_problem(topology: Topology, parameters, n_control, order, knots):
    """Set up a fit; also what to say about its size, and the memory of a factor of its mover."""
    if isinstance(knots, str):
        counts, factor_bytes = choose_affordable_counts(topology, n_control, order)
        problem = set_up_fit(topology, parameters, counts.n_control, counts.orders, knots)
        return problem, counts.warnings, factor_bytes
    problem = set_up_fit(topology, parameters, None, None, knots)
    return problem, (), predict_factor_bytes(topology, np.array([v.n_control for v in problem.mesh.volumes]))


def _kind(choice) -> str:
    """Name of a choice; ``"given"`` where it is the user's own."""
    return choice if isinstance(choice, str) else "given"


def segment_parameters(grid: Grid, topology: Topology, parametrization="chord_length") -> list[np.ndarray]:
    """Parameters of the nodes of every segment, each of shape (L0, L1, L2, 3).

    Raises
    ------
    InputError
        If the parametrization is unknown, or the user's own does not fit the grid.
    """
    if not isinstance(parametrization, str):
        return as_parameters(topology, parametrization)
    if parametrization not in EXPONENTS:
        raise InputError(
            f'{grid.source}: parametrization "{parametrization}" is unknown; use one of {", ".join(EXPONENTS)}, or '
            f"give parameters for every block"
        )
    exponent = EXPONENTS[parametrization]
    return [chord_length_parameters(grid.blocks[w.block].nodes[w.slices], exponent) for w in topology.segments]


def set_up_fit(topology: Topology, parameters, n_control, orders, knots="curved") -> FitProblem:
    """Make volumes, shared control points and entities.

    Parameters
    ----------
    topology : Topology
        Segments and links.
    parameters : sequence of ndarray, each of shape (L0, L1, L2, 3)
        Parameters of the nodes of every segment.
    n_control, orders : array of int, shape (n_segments, 3)
        Control points and orders; not looked at where ``knots`` has them.
    knots
        As for `fit_grid`.

    Returns
    -------
    FitProblem

    Raises
    ------
    InputError
        If the kind of knots is unknown, or the user's own do not agree where segments meet.
    """
    is_given = not isinstance(knots, str)
    if not is_given:
        knots = knots_of_segments(topology, parameters, n_control, orders, knots)
    if not isinstance(knots, Sequence):
        raise InputError(f'{topology.source}: knots = {knots}; use "curved", "constant" or three objects per segment')
    if len(knots) != len(topology.segments):
        raise InputError(f"{topology.source}: knots of {len(knots)} segments; give {len(topology.segments)}")
    volumes = [Volume(tuple(triple)) for triple in knots]
    if is_given:
        require_agreement(topology, volumes)
    return problem_of_mesh(topology, _share_mesh(topology, volumes))


def _share_mesh(topology: Topology, volumes: Sequence[Volume]) -> BSplineMesh:
    shapes = [volume.n_control for volume in volumes]
    ids = shared_ids(shapes, topology.links, topology.collapses, topology.segment_names)
    return BSplineMesh(tuple(volumes), tuple(ids), 1 + max(int(a.max()) for a in ids))


def _check_options(corrections: int, method: str):
    if corrections < 0 or corrections != int(corrections):
        raise InputError(f"fit: {corrections} corrections; give a whole number of cycles of at least 0")
    if method not in METHODS:
        raise InputError(f'fit: method "{method}" is unknown; use one of {", ".join(METHODS)}')
