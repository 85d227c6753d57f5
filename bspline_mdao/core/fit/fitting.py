"""Fit a multi-block grid with B-spline volumes, section II.D.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...base.numerics.processes import ONE, together
from ...base.numerics.progress import Progress, no_progress, progress_bar
from ...base.numerics.stopwatch import working_seconds
from ...errors import FitWarning, InputError
from ...grids.topology.detection import find_topology
from ...grids.topology.grid import Block, Grid
from ...grids.topology.stored_grid import StoredGrid
from ...grids.topology.topology import Topology, shared_ids
from ..model.fitted_blocks import FittedBlocks
from ..model.fitted_model import FittedModel
from ..model.records import FitSettings, GridHeader, Raised
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from .closer_counts import closer_counts, warn_of_misses
from .control_counts import ControlCounts, choose_affordable_counts, predict_factor_bytes
from .correction import CYCLE_COST, correct_parameters
from .edge_knots import knots_of_segments, require_agreement
from .errors import count_invalid, report_errors
from .fit_nodes import FitNodes
from .local_errors import flattest_cell, worst_local_errors
from .options import EXPONENTS, METHODS
from .parameters import as_parameters, chord_length_parameters
from .problem import FitProblem, FitSolution, part_of, problem_of_mesh, solve_fit
from .requested_counts import RequestedCounts
from .settings import FITTING, FittingSettings
from .validity import make_valid, with_sides_alike


def _solve_valid(
    settings: FittingSettings,
    problem: FitProblem,
    parameters: Sequence[np.ndarray],
    nodes: np.ndarray,
    progress: Progress = no_progress,
) -> FitSolution:
    return make_valid(problem, parameters, nodes, solve_fit(problem, parameters, nodes, progress), settings)


def _solve_least_squares(settings: FittingSettings, *arguments: Any) -> FitSolution:
    return solve_fit(*arguments)


def _interpolate(
    settings: FittingSettings,
    problem: FitProblem,
    parameters: Sequence[np.ndarray],
    nodes: np.ndarray,
    progress: Progress = no_progress,
) -> FitSolution:
    return make_valid(problem, parameters, nodes, None, settings)


_SOLVERS = dict(zip(METHODS, (_solve_valid, _solve_least_squares, _interpolate), strict=True))


def fit_grid(
    grid: Grid | StoredGrid,
    *,
    topology: Topology | None = None,
    n_control: int | Sequence | Mapping | None = None,
    order: int | Sequence | None = None,
    knots: str | Sequence = "curved",
    corrections: int = 0,
    keep_residual: bool = True,
    wall_layer: bool = True,
    parametrization: str | Sequence[np.ndarray] = "chord_length",
    method: str = "valid",
    progress: Progress | bool | None = None,
) -> FittedModel:
    """Fit a grid: parameters, knots, then corners, edges, faces and interiors.

    Parameters
    ----------
    grid : Grid or StoredGrid
        The baseline grid. Where blocks meet, all of them get the nodes of the first, so faces joined over a gap or up
        to round-off have equal bits in every regenerated grid.
    topology : Topology, optional
        Its topology; found from coincident nodes by default.
    n_control : int, triple of int, sequence of (triple or None), or mapping, optional
        Control points per direction, for all blocks or for each; or for some, by number from 1 or by name, with the key
        None for all others. Other blocks follow those that they are joined to, and the rest is chosen from the grid, as
        all are by default. A block gets at most as many as it has nodes. Ignored, like ``order``, if knots are given,
        which determine both.
    order : int, triple or sequence of triples, optional
        Order p = degree + 1; by default 4, or 3 in short directions where the numbers of control points are chosen, see
        `bspline_mdao.core.fit.control_counts.choose_counts`.
    knots : str or sequence of triples of Knots
        ``"curved"`` (Eq. 5), ``"constant"``, or the user's own knots for every segment.
    corrections : int
        Cycles of parameter correction.
    keep_residual : bool
        Keep the difference between grid and splines, so that the baseline is reproduced.
    wall_layer : bool
        Let nodes near walls follow them as a rigid body, and let the residual rotate with its surroundings, when the
        grid is regenerated, see `bspline_mdao.core.walls.grid_map`. Otherwise grids are ``A b``, Eq. (3), plus the
        residual.
    parametrization : str or sequence of ndarray
        Parameters of the nodes along every grid line: ``"chord_length"``; ``"centripetal"``, by square roots of chord
        lengths; ``"uniform"``, proportional to the index; or the user's own, an array of shape
        (ni, nj, nk, 3) for every block (or segment), rising from 0 to 1 along every line and equal where blocks meet.
    method : str
        One of `bspline_mdao.core.fit.options.METHODS`: ``"valid"`` is least squares if they give a valid control mesh;
        where they fold, control points fall back on a quasi-interpolant as far as needed
        (`bspline_mdao.core.fit.validity`). ``"least_squares"`` is least squares only, as in the paper.
        ``"quasi_interpolant"`` solves no system: it takes no more memory than the grid, and also falls back where the
        iterated quasi-interpolant folds.
    progress : callable or bool, optional
        Called with the fraction done and a word on what is being done. By default a bar shows it where there is a
        terminal; False turns that off, see `bspline_mdao.base.numerics.progress`.

    Returns
    -------
    FittedModel

    Raises
    ------
    InputError
        If a block is given twice, the numbers of control points do not fit the grid or each other, the user's own knots
        do not agree along an interface, or an option is unknown.

    Warns
    -----
    FitWarning
        If control elements are invalid: once, at the caller's line, with the remedy. Also if faces of blocks nearly
        meet and are not joined: once, with the worst place.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((9, 9, 9, 9)), n_control=5)
    >>> model.mesh.n_control_points, model.regenerate().n_nodes
    (490, 4374)
    >>> other = fit_grid(brick_grid((9, 9, 9, 9)), n_control={None: 5, 2: (7, 5, 6)})  # of block 2, and of the others
    >>> [volume.n_control for volume in other.mesh.volumes[:3]]
    [(5, 7, 6), (7, 5, 6), (7, 5, 6)]
    """
    options: dict[str, Any] = {
        "n_control": n_control,
        "order": order,
        "knots": knots,
        "corrections": corrections,
        "method": method,
    }
    options |= {"wall_layer": wall_layer, "parametrization": parametrization}
    with progress_bar("fitting", progress) as report_progress:
        _, parameters, residual, whole = _fit(grid, ONE, topology, **options, progress=report_progress)
    _warn(grid, whole)
    return FittedModel(parameters=tuple(parameters), residual=residual if keep_residual else None, **whole)


def fit_blocks(grid: Grid | StoredGrid, comm: Any = ONE, *, keep_residual: bool = True, **options: Any) -> FittedBlocks:
    """Fit a grid on several processes, all of which call this; each reads and fits whole blocks.

    A corner, edge or face that blocks share is fitted by one process, and its control points are sent to all. The
    control points equal those of `fit_grid`: to the last bit with least squares, and up to the order of sums (1e-15 of
    the grid's size) where they fall back on a quasi-interpolant. If the grid is stored in a file, no process has the
    nodes of all blocks: the topology is found from their faces, and parameters and residual stay where they are
    computed.

    Parameters
    ----------
    grid : Grid or StoredGrid
        The baseline grid, see `bspline_mdao.open_grid`.
    comm : communicator
        The processes, such as ``mpi4py.MPI.COMM_WORLD``.
    keep_residual : bool
        Keep the difference between grid and splines, so that the baseline is reproduced.
    **options
        As for `fit_grid`, without parameter correction and user-defined parameters if there are several processes. Also
        ``settings``, numbers without an option of their own:
        `bspline_mdao.core.fit.settings.FittingSettings`.

    Returns
    -------
    FittedBlocks
        The model, of which this process has some blocks. It can be saved from there, and each process gets its
        `bspline_mdao.core.model.local_model.LocalModel`.

    Raises
    ------
    InputError
        As for `fit_grid`, on all processes.

    Warns
    -----
    FitWarning
        As for `fit_grid`, from the first process.

    Examples
    --------
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import fit_blocks
    >>> blocks = fit_blocks(brick_grid((5, 5, 5, 5)), n_control=4)  # on one process; else fit_blocks(grid, comm)
    >>> blocks.control_points.shape
    (224, 3)
    """
    with progress_bar("fitting", options.pop("progress", None)) as report_progress:
        sharing, parameters, residual, whole = _fit(grid, comm, **options, progress=report_progress)
    if comm.rank == 0:
        _warn(grid, whole)
    return FittedBlocks(
        comm=comm,
        homes=sharing.homes,
        parameters={s: parameters[s] for s in sharing.here},
        residual=sharing.by_blocks(residual) if keep_residual else None,
        **whole,
    )


def _warn(grid: Grid | StoredGrid, whole: dict[str, Any]) -> None:
    """Warn of invalid control elements and of faces that nearly meet, at the line of the caller's caller."""
    topology, report = whole["topology"], whole["report"]
    if topology.near_misses:
        warnings.warn(f"{grid.source}: {topology.warnings[0]}", FitWarning, stacklevel=3)
    if report.n_invalid:
        warnings.warn(f"{grid.source}: {report.warnings[-1]}", FitWarning, stacklevel=3)


def _fit(
    grid: Grid | StoredGrid,
    comm: Any,
    topology: Topology | None = None,
    n_control: int | Sequence | Mapping | None = None,
    order: int | Sequence | None = None,
    knots: str | Sequence = "curved",
    corrections: int = 0,
    wall_layer: bool = True,
    parametrization: str | Sequence[np.ndarray] = "chord_length",
    method: str = "valid",
    *,
    progress: Progress,
    settings: FittingSettings = FITTING,
) -> tuple[FitNodes, list[np.ndarray], np.ndarray, dict[str, Any]]:
    """Fit a grid: the nodes of this process, their parameters and residual, and the rest of the model."""
    start = working_seconds()
    _check_options(corrections, method)
    if comm.size > 1 and (corrections or not isinstance(parametrization, str)):
        what = "parameter correction" if corrections else "parameters of your own"
        raise InputError(f"{grid.source}: a fit on {comm.size} processes has no {what}; fit without, or on one process")
    progress(0.0, "topology")
    if topology is None:
        topology = find_topology(grid, comm)
    if topology.shapes != grid.shapes:
        raise InputError(f"{grid.source}: the topology is of other blocks, {topology.source}; find this grid's")
    for first, again in topology.repeated:
        raise InputError(f"{grid.source}: block {again + 1} repeats block {first + 1}; leave one of them out")
    sharing = FitNodes.of(topology, comm)
    with together(comm):
        blocks = {number: _block(grid, number) for number in sharing.blocks}
    iblanks = tuple(blocks[n].iblank if n in blocks else None for n in range(len(topology.shapes)))
    nodes = _joined([block.nodes for block in blocks.values()], sharing)
    del blocks
    with together(comm):
        parameters = _parameters_here(sharing, nodes, parametrization)
    names = tuple(block.name for block in grid.blocks)
    requested = RequestedCounts.of(n_control, topology, names)
    fraction = 1 / (1 + CYCLE_COST * corrections)

    solver = partial(_SOLVERS[method], settings)

    def solve(problem: FitProblem) -> FitSolution:
        return solver(problem, parameters, nodes, part_of(progress, 0, fraction))

    sized = _size(topology, parameters, requested, order, knots, sharing, settings)
    solution, raised = solve(sized.problem), None
    if sized.counts is not None:
        sized, solution, raised = _come_closer(sized, solution, solve, requested, knots, parameters, nodes, settings)
    problem = sized.problem
    if corrections:
        rest = part_of(progress, fraction, 1)
        arguments = problem, parameters, nodes, solution, corrections, rest, solver, settings
        parameters, solution = correct_parameters(*arguments)
    solution = with_sides_alike(problem, parameters, solution)
    report = report_errors(problem, names, parameters, nodes, solution)
    said, seconds = (*topology.warnings, *sized.warnings, *report.warnings), working_seconds() - start
    report = replace(report, seconds=seconds, warnings=said, factor_bytes=sized.factor_bytes, raised=raised)
    progress(1.0, "done")
    whole = {
        "topology": topology,
        "mesh": problem.mesh,
        "control_points": solution.control_points,
        "header": GridHeader(names, grid.patches, grid.source, grid.dialect, iblanks, grid.unit),
        "report": report,
        "settings": FitSettings(_kind(knots), corrections, _kind(parametrization), method, wall_layer),
        "candidate_weights": solution.weights,
    }
    return sharing, parameters, nodes - solution.fitted, whole


def _block(grid: Grid | StoredGrid, number: int) -> Block:
    """Take a block of a grid, or read it."""
    return grid.blocks[number].read(None) if isinstance(grid, StoredGrid) else grid.blocks[number]


def _joined(blocks: Sequence[np.ndarray], sharing: FitNodes) -> np.ndarray:
    """Nodes of blocks, shape (n_rows, 3), with coincident nodes at the place of the first of them."""
    local = [np.zeros((0, 3)), *(block.reshape(-1, 3) for block in blocks)]
    return sharing.copy_shared(sharing.with_places(np.concatenate(local)))


def _parameters_here(sharing: FitNodes, nodes: np.ndarray, parametrization: Any) -> list[np.ndarray]:
    """Parameters of the nodes of every segment of this process; none for the others."""
    shapes = sharing.topology.shapes
    blocks = {number: part.reshape(*shapes[number], 3) for number, part in sharing.by_blocks(nodes).items()}
    return _parameters_of_blocks(blocks, sharing.topology, parametrization)


@dataclass(frozen=True, eq=False)
class _Sized:
    """A fit that is set up, its counts if they may be raised, warnings about them, and the factor of its mover."""

    problem: FitProblem
    counts: ControlCounts | None
    warnings: tuple[str, ...]
    factor_bytes: int | None


def _size(
    topology: Topology,
    parameters: Sequence[np.ndarray],
    requested: RequestedCounts,
    order: Any,
    knots: Any,
    sharing: FitNodes,
    settings: FittingSettings,
) -> _Sized:
    """Set up a fit with requested numbers of control points, or numbers chosen from the grid alone."""
    if isinstance(knots, str):
        counts, factor_bytes = choose_affordable_counts(topology, requested, order, settings)
        problem = set_up_fit(topology, parameters, counts.n_control, counts.orders, knots, sharing)
        return _Sized(problem, None if requested.is_complete else counts, counts.warnings, factor_bytes)
    problem = set_up_fit(topology, parameters, None, None, knots, sharing)
    n_control = np.array([volume.n_control for volume in problem.mesh.volumes])
    factor_bytes = predict_factor_bytes(topology, n_control, settings)
    return _Sized(problem, None, (), factor_bytes)


def _come_closer(
    sized: _Sized,
    solution: FitSolution,
    solve: Callable,
    requested: RequestedCounts,
    knots: Any,
    parameters: Sequence[np.ndarray],
    nodes: np.ndarray,
    settings: FittingSettings,
) -> tuple[_Sized, FitSolution, Raised | None]:
    """Fit again with more control points while cells are missed by several of their widths; keep the best fit."""
    if sized.counts is None:
        return sized, solution, None
    counts, sharing, topology = sized.counts, sized.problem.sharing, sized.problem.topology
    n_first, n_last = 2 * (sized.problem.mesh.n_control_points,)
    at_first = missed = _missed(sharing, nodes, solution)
    most = settings.largest_miss
    if missed <= most or flattest_cell(sharing, nodes[: sharing.n_owned]) > settings.layer:
        return sized, solution, None
    n_invalid, too_many, raised = count_invalid(sized.problem, solution), None, None
    for most_per_node in settings.most_per_node:
        if missed <= most:
            break
        found = closer_counts(topology, requested, counts, sharing, nodes, parameters, most_per_node, settings)
        if not found.is_affordable(settings):
            too_many = found
            break
        problem = set_up_fit(topology, parameters, found.counts.n_control, found.counts.orders, knots, sharing)
        if problem.mesh.n_control_points > n_last:
            n_last, other = problem.mesh.n_control_points, solve(problem)
            less = _missed(sharing, nodes, other)
            if less < missed and count_invalid(problem, other) <= n_invalid:
                sized = _Sized(problem, found.counts, sized.warnings, found.factor_bytes)
                solution, missed, raised = other, less, Raised(n_first, at_first)
    if missed > most and (n_last > n_first or too_many):
        said = warn_of_misses(topology, counts, too_many, missed)
        sized = replace(sized, warnings=(*sized.warnings, said))
    return sized, solution, raised


def _missed(sharing: FitNodes, nodes: np.ndarray, solution: FitSolution) -> float:
    """Largest error relative to the width of the cells."""
    local = slice(sharing.n_owned)
    worst = worst_local_errors(sharing, nodes[local], nodes[local] - solution.fitted[local])[0]
    return worst.in_widths if worst else 0.0


def _kind(choice: Any) -> str:
    """Name of a choice; ``"given"`` if it is the user's own."""
    return choice if isinstance(choice, str) else "given"


def _parameters_of_blocks(
    blocks: Mapping[int, np.ndarray], topology: Topology, parametrization: Any
) -> list[np.ndarray]:
    """Parameters of the nodes of every segment of some blocks; none, shape (0, 0, 0, 3), for the others."""
    if not isinstance(parametrization, str):
        return as_parameters(topology, parametrization)
    if parametrization not in EXPONENTS:
        raise InputError(
            f'{topology.source}: parametrization "{parametrization}" is unknown; use one of {", ".join(EXPONENTS)}, or '
            f"give parameters for every block"
        )
    exponent, nothing = EXPONENTS[parametrization], np.empty((0, 0, 0, 3))
    return [
        chord_length_parameters(blocks[w.block][w.slices], exponent) if w.block in blocks else nothing
        for w in topology.segments
    ]


def set_up_fit(
    topology: Topology,  # segments and links
    parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
    # control points and orders; ignored if ``knots`` has them
    n_control: Any,  # int (n_segments, 3)
    orders: Any,  # int (n_segments, 3)
    knots: Any = "curved",
    sharing: FitNodes | None = None,  # nodes of this process; all by default
) -> FitProblem:
    """Make volumes, shared control points and entities."""
    # knots: as for `fit_grid`
    is_given = not isinstance(knots, str)
    if not is_given:
        knots = knots_of_segments(topology, parameters, n_control, orders, knots, sharing)
    if not isinstance(knots, Sequence):
        raise InputError(f'{topology.source}: knots = {knots}; use "curved", "constant" or three objects per segment')
    if len(knots) != len(topology.segments):
        raise InputError(f"{topology.source}: knots of {len(knots)} segments; give {len(topology.segments)}")
    volumes = [Volume(tuple(triple)) for triple in knots]
    if is_given:
        require_agreement(topology, volumes)
    return problem_of_mesh(topology, _joined_mesh(topology, volumes), sharing)


def _joined_mesh(topology: Topology, volumes: Sequence[Volume]) -> BSplineMesh:
    shapes = [volume.n_control for volume in volumes]
    ids = shared_ids(shapes, topology.links, topology.collapses, topology.segment_names)
    return BSplineMesh(tuple(volumes), tuple(ids), 1 + max(int(a.max()) for a in ids))


def _check_options(corrections: int, method: str) -> None:
    if corrections < 0 or corrections != int(corrections):
        raise InputError(f"fit: {corrections} corrections; give a whole number of cycles of at least 0")
    if method not in METHODS:
        raise InputError(f'fit: method "{method}" is unknown; use one of {", ".join(METHODS)}')
