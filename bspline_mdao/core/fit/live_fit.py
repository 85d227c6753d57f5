"""The fit and the grid as functions of the baseline grid, including chord-length parameters and knots ("live").

With b the control points, A the matrix of an entity and r = x - A b its residual, the unknown part of b satisfies
``A_u^T r = shift (b_u - b_reference)``. Differentiated,

    (A_u^T A_u + shift I) db_u = A_u^T (dx - dA b - A_k db_k) + dA_u^T r + shift db_reference,

where u are the unknown and k the known control points (`LiveFit`). A depends on the parameters of the entity's nodes
and on the knots on the edges of its block, and both depend on the nodes of the baseline (`LiveMapping`). Spans are
fixed. The reverse mode goes through the same steps backwards.

Where control points fall back on a quasi-interpolant, its maps, the A of its iteration and the weights of the
candidates are the model's own: the fallback is a linear map of the nodes, since the choice behind it is made once.

The whole map to the grid (`LiveGrid`) has the residual and the wall layer of the baseline x0,

    y = A(x0) b + T(b, b0) r,    r = x0 - A(x0) b0,         x = layer(y; x0)

with the control points b0 fitted to it; see `bspline_mdao.core.walls.grid_map`. Without a residual r is zero, and the
layer belongs to A(x0) b0. Control points of tied periodic sides are mapped onto each other after the fit, and nodes
move alike from the baseline. Nodes that slide on fixed surfaces keep their heights above them in x0, and the
displacement this takes fades over the blocks before the layer follows (`bspline_mdao.core.walls.sliding_correction`).
Which nodes are near which wall, how much they follow, and their places in their spans, stay the model's.

Theory: ``docs/theory/fit.rst``, ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.numerics.threads import one_blas_thread
from ...errors import InputError
from ...names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, GRID_INITIAL
from ..evaluation.node_map import require_inputs
from ..model.fitted_model import FittedModel
from ..sliding.sliding_nodes import SlidNodes
from ..splines.volume import Volume
from ..walls.grid_map import GridMap
from ..walls.layer import Followed
from ..walls.node_vectors import Vectors
from ..walls.rotation_map import RotationState
from ..walls.sliding_correction import SlidingCorrection
from .design_matrix import DesignMatrix, LiveMatrix, build_design_matrix
from .edge_knots import joined_corners, knots_of_segment_jvp, knots_of_segment_vjp, knots_of_segments
from .entities import Entity
from .least_squares import FitStep
from .options import EXPONENTS
from .parameters import chord_length_parameters, chord_length_parameters_jvp, chord_length_parameters_vjp
from .problem import FitProblem, problem_of_mesh
from .quasi_interpolant import Mixture


def live_fit(
    # source of topology, numbers of control points, orders, kind of knots, and the fallback of control points
    model: FittedModel,
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
) -> LiveFit:
    """Fit another baseline grid exactly as a model was fitted, with its own parameters, knots and derivatives."""
    # `InputError` if the model has corrected parameters, or the user's own parameters or knots, which are not functions
    # of the grid
    mixture = problem_of_mesh(model.topology, model.mesh).mixture(model.parameters, model.candidate_weights)
    if not mixture.has_least_squares:
        return LiveFit(live_mapping(model, nodes), (), np.zeros_like(model.control_points), mixture)
    problem, parameters = live_problem(model, nodes)
    operator = problem.operator(parameters)
    matrices = tuple(step.matrix for step in operator.steps)
    exponent = EXPONENTS[model.settings.parametrization]
    mapping = LiveMapping(problem, model.settings.knots, exponent, nodes, parameters, matrices)
    return LiveFit(mapping, operator.steps, operator.forward(nodes), mixture)


@dataclass(frozen=True, eq=False)
class LiveFit:
    """A fit at one baseline grid with its first derivatives."""

    mapping: LiveMapping  # parameters, knots and matrices of this grid
    steps: tuple[FitStep, ...]  # factored least squares; none if they have no weight in any control point
    least_squares: np.ndarray  # (n_control_points, 3), control points by least squares (m)
    mixture: Mixture  # control points where least squares fold

    @property
    def control_points(self) -> np.ndarray:
        """The fitted control points (m), shape (n_control_points, 3)."""
        points, ties = self.mixture.forward(self.least_squares, self.nodes), self.mapping.problem.ties
        return points if ties is None else ties.lay(points.copy())

    @property
    def nodes(self) -> np.ndarray:
        """The grid (m), shape (n_nodes, 3)."""
        return self.mapping.nodes

    def jvp(self, d_nodes: np.ndarray) -> np.ndarray:
        """Differentiate the control points, shape (n_control_points, 3), along ``d_nodes``, shape (n_nodes, 3)."""
        change, d_control = self.mapping.change(d_nodes), np.zeros_like(self.least_squares)
        with one_blas_thread:
            for step in self.steps:
                if step.factor is not None:
                    self._step_jvp(step, change, d_nodes, d_control)
        d_points, ties = self.mixture.forward(d_control, d_nodes), self.mapping.problem.ties
        return d_points if ties is None else ties.lay_jvp(d_points)

    def vjp(self, control_bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: cotangent of the nodes, shape (n_nodes, 3)."""
        ties = self.mapping.problem.ties
        if ties is not None:
            control_bar = ties.lay_vjp(control_bar.copy())
        control_bar, nodes_bar = self.mixture.adjoint(control_bar, len(self.nodes))
        bars = self.mapping.no_change()
        with one_blas_thread:
            for step in reversed(self.steps):
                if step.factor is not None:
                    self._step_vjp(step, control_bar, nodes_bar, bars)
        self.mapping.add_change_vjp(bars, nodes_bar)
        return nodes_bar

    def _step_jvp(self, step: FitStep, change: Change, d_nodes: np.ndarray, d_control: np.ndarray) -> None:
        """Solve the differentiated normal equations of an entity."""
        net, residual = self._net_and_residual(step)
        terms = self.mapping.matrix_jvp(step.entity, step.matrix, change)
        moved = d_nodes[step.entity.rows] - sum_apply(terms, net)
        right = sum(term.apply_transpose(residual) for term in terms)
        step.solve_residual(moved, right, d_nodes, d_control)

    def _step_vjp(self, step: FitStep, control_bar: np.ndarray, nodes_bar: np.ndarray, bars: Change) -> None:
        """Solve the transposed normal equations of an entity: reverse of `_step_jvp`."""
        moved_bar, right_bar = step.solve_residual_transpose(control_bar, nodes_bar)
        np.add.at(nodes_bar, step.entity.rows, moved_bar)
        net, residual = self._net_and_residual(step)
        self.mapping.add_matrix_vjp(step.entity, step.matrix, bars, [(-moved_bar, net), (residual, right_bar)])

    def _net_and_residual(self, step: FitStep) -> tuple[np.ndarray, np.ndarray]:
        """Control points of the section of an entity, and their residual at its nodes."""
        net = step.entity.net(self.least_squares)
        return net, self.nodes[step.entity.rows] - step.matrix.apply(net)


def live_mapping(
    model: FittedModel,  # source of topology, numbers of control points, orders and kind of knots
    nodes: np.ndarray,  # (n_nodes, 3), the baseline grid (m)
) -> LiveMapping:
    """Regenerate with the parameters and knots of another baseline grid."""
    # `InputError` if the model has corrected parameters, or the user's own parameters or knots, which are not functions
    # of the grid
    problem, parameters = live_problem(model, nodes)
    matrices = tuple(
        build_design_matrix(problem.mesh.volumes[e.segment], parameters[e.segment][e.inner].reshape(-1, 3), e.is_free)
        for e in problem.entities
    )
    settings = model.settings
    return LiveMapping(problem, settings.knots, EXPONENTS[settings.parametrization], nodes, parameters, matrices)


def live_problem(model: FittedModel, nodes: np.ndarray) -> tuple[FitProblem, tuple[np.ndarray, ...]]:
    """Set up the fit of another baseline grid, with its own parameters and knots; see `live_mapping`."""
    settings = model.settings
    if settings.corrections or "given" in (settings.knots, settings.parametrization):
        raise InputError(
            f"{model.header.source}: a fit with corrected or given parameters or given knots does not follow the grid; "
            f"fit without them, or keep parameters and knots frozen"
        )
    frozen = problem_of_mesh(model.topology, model.mesh)
    exponent = EXPONENTS[settings.parametrization]
    parameters = tuple(chord_length_parameters(nodes[rows], exponent) for rows in frozen.sharing.rows)
    n_control, orders = zip(*((v.n_control, v.orders) for v in model.mesh.volumes))
    knots = knots_of_segments(model.topology, parameters, n_control, orders, settings.knots)
    volumes = tuple(map(Volume, knots))
    return replace(frozen, mesh=replace(model.mesh, volumes=volumes)), parameters


@dataclass(frozen=True, eq=False)
class LiveMapping:
    """Regeneration of a grid with the parameters and knots of one baseline grid."""

    problem: FitProblem  # entities and shared nodes, with the knots of this grid
    kind: str  # kind of knots
    exponent: float  # power of the chords for parameters, see `bspline_mdao.core.fit.options.EXPONENTS`
    nodes: np.ndarray  # (n_nodes, 3), the baseline grid (m)
    parameters: tuple[np.ndarray, ...]  # each (L0, L1, L2, 3), parameters of every segment
    matrices: tuple[DesignMatrix, ...]  # of every entity of the problem

    def evaluate(self, control_points: np.ndarray) -> np.ndarray:
        """Grid, shape (n_nodes, 3), from control points, shape (n_control_points, 3)."""
        points = np.empty_like(self.nodes)
        for entity, matrix in zip(self.problem.entities, self.matrices):
            points[entity.rows] = matrix.apply(entity.net(control_points))
        return self._copy_shared(points)

    def jvp(
        self,
        # control points and direction in them
        control_points: np.ndarray,  # (n_control_points, 3)
        d_nodes: np.ndarray,  # (n_nodes, 3), direction in the baseline grid
        d_control: np.ndarray,  # (n_control_points, 3)
    ) -> np.ndarray:  # (n_nodes, 3)
        """Differentiate `evaluate`, including the parameters and knots."""
        change, d_points = self.change(d_nodes), np.empty_like(self.nodes)
        for entity, matrix in zip(self.problem.entities, self.matrices):
            d_matrix = self.matrix_jvp(entity, matrix, change)
            moved = sum_apply(d_matrix, entity.net(control_points))
            d_points[entity.rows] = matrix.apply(entity.net(d_control)) + moved
        return self._copy_shared(d_points)

    def vjp(
        self,
        control_points: np.ndarray,  # (n_control_points, 3)
        bar: np.ndarray,  # (n_nodes, 3), cotangent of the regenerated grid
    ) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        # returns nodes_bar (n_nodes, 3): cotangent of the baseline grid
        # returns control_bar (n_control_points, 3)
        bar, copies = bar.copy(), self.problem.sharing.copies
        np.add.at(bar, copies[:, 1], bar[copies[:, 0]])
        nodes_bar, control_bar, bars = np.zeros_like(self.nodes), np.zeros_like(control_points), self.no_change()
        for entity, matrix in zip(self.problem.entities, self.matrices):
            net_bar = matrix.apply_transpose(bar[entity.rows]).reshape(*entity.control_ids.shape, 3)
            np.add.at(control_bar, entity.control_ids, net_bar)
            self.add_matrix_vjp(entity, matrix, bars, [(bar[entity.rows], entity.net(control_points))])
        self.add_change_vjp(bars, nodes_bar)
        return nodes_bar, control_bar

    def change(self, d_nodes: np.ndarray) -> Change:
        """Differentiate parameters and edge knots along ``d_nodes``, shape (n_nodes, 3)."""
        d_parameters, d_corners = [], []
        for rows, x, volume in zip(self.problem.sharing.rows, self.parameters, self.problem.mesh.volumes):
            d_parameters.append(chord_length_parameters_jvp(self.nodes[rows], x, d_nodes[rows], self.exponent))
            arguments = x, volume.n_control, volume.orders, self.kind, d_parameters[-1]
            d_corners.append(knots_of_segment_jvp(*arguments))
        return Change(d_parameters, self._joined(d_corners))

    def add_change_vjp(self, bars: Change, nodes_bar: np.ndarray) -> None:
        """Add the cotangent of the nodes from the parameters' and edge knots': transpose of `change`."""
        corners = self._joined(bars.corners)
        for segment, (rows, x) in enumerate(zip(self.problem.sharing.rows, self.parameters)):
            volume = self.problem.mesh.volumes[segment]
            arguments = x, volume.n_control, volume.orders, self.kind, corners[segment]
            parameters_bar = bars.parameters[segment] + knots_of_segment_vjp(*arguments)
            nodes_bar[rows] += chord_length_parameters_vjp(self.nodes[rows], x, parameters_bar, self.exponent)

    def _joined(self, corners: list[list[np.ndarray]]) -> list[list[np.ndarray]]:
        """Changes of edge knots, or their cotangents, with shared ones joined."""
        return joined_corners(self.problem.topology, corners) if self.kind == "constant" else corners

    def no_change(self) -> Change:
        """Zeros of the shapes of a `Change`."""
        shapes = [[(2, 2, k.n_control + k.order) for k in volume.knots] for volume in self.problem.mesh.volumes]
        corners = [[np.zeros(shape) for shape in triple] for triple in shapes]
        return Change([np.zeros_like(x) for x in self.parameters], corners)

    def matrix_jvp(self, entity: Entity, matrix: DesignMatrix, change: Change) -> list[DesignMatrix]:
        """Differentiate the matrix of an entity; the result is a sum of design matrices."""
        d_parameters = change.parameters[entity.segment][entity.inner].reshape(-1, 3)
        return self._live_matrix(entity, matrix).jvp(d_parameters, change.corners[entity.segment])

    def add_matrix_vjp(
        self, entity: Entity, matrix: DesignMatrix, bars: Change, pairs: Sequence[tuple[np.ndarray, np.ndarray]]
    ) -> None:
        """Add the cotangents of the sum of ``bar . (A b)`` over pairs of bar and b: transpose of `matrix_jvp`."""
        parameters_bar, corners_bar = self._live_matrix(entity, matrix).vjp(pairs)
        inner = bars.parameters[entity.segment][entity.inner]
        inner += parameters_bar.reshape(inner.shape)
        for total, part in zip(bars.corners[entity.segment], corners_bar):
            total += part

    def _live_matrix(self, entity: Entity, matrix: DesignMatrix) -> LiveMatrix:
        parameters = self.parameters[entity.segment][entity.inner].reshape(-1, 3)
        return LiveMatrix.of(matrix, self.problem.mesh.volumes[entity.segment], parameters, entity.is_free)

    def _copy_shared(self, points: np.ndarray) -> np.ndarray:
        copies = self.problem.sharing.copies
        points[copies[:, 0]] = points[copies[:, 1]]
        return points


@dataclass(frozen=True, eq=False)
class Change:
    """Derivatives, or cotangents, of the matrices' arguments."""

    parameters: list[np.ndarray]  # each (L0, L1, L2, 3), of every segment
    corners: list[list[np.ndarray]]  # each (2, 2, N + p), edge knots of every segment


def sum_apply(terms: Sequence[DesignMatrix], net: np.ndarray) -> Any:
    """Apply a sum of design matrices; 0 for a corner, which has none."""
    return sum(term.apply(net) for term in terms)


def live_grid(
    model: FittedModel,  # source of topology, control point counts, orders, kind of knots, and the nodes near walls
    nodes: np.ndarray,  # (n_nodes, 3), the baseline grid (m)
    grid_map: GridMap | None = None,  # the model's map with sliding nodes, see `Model.map_sliding`
) -> LiveGrid:
    """Regenerate with all properties of another baseline grid; `InputError` as for `live_mapping`."""
    return LiveGrid(live_mapping(model, nodes), grid_map or model.grid_map(), model.residual is not None)


@dataclass(frozen=True, eq=False)
class LiveGrid:
    """Regeneration of a grid with everything that depends on one baseline. Made by `live_grid`."""

    mapping: LiveMapping  # A(x0), and the baseline
    grid_map: GridMap  # the parts that do not change with the baseline
    has_residual: bool  # whether the model has a residual

    @property
    def nodes(self) -> np.ndarray:
        """The baseline, shape (n_nodes, 3), in metres."""
        return self.mapping.nodes

    @cached_property
    def sliding(self) -> SlidingCorrection | None:
        """Map that takes nodes to the surfaces that they slide on; None if there are none."""
        correction, sliding = self.grid_map.correction, self.grid_map.sliding
        return None if correction is None or sliding is None else SlidingCorrection(correction, sliding)

    @property
    def needs_initial(self) -> bool:
        """Whether the grid depends on the control points of the baseline."""
        of = self.grid_map
        return self.has_residual or any(part is not None for part in (of.following, of.sliding, of.ties))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, the baseline first."""
        return (GRID_INITIAL, *((CONTROL_POINTS_INITIAL,) if self.needs_initial else ()), CONTROL_POINTS)

    def at(self, control_points: np.ndarray, control_points_initial: np.ndarray | None = None) -> LiveGridState:
        """Grid and its derivative at moved control points (n_control_points, 3) (m), and the baseline's if needed."""
        # `needs_initial` tells whether they are; `MovementError` if the neighbourhood of a point is turned inside out
        if self.needs_initial and control_points_initial is None:
            raise InputError("live grid: it depends on the control points of the baseline; give these as well")
        initial = control_points if control_points_initial is None else control_points_initial
        grid_map, nodes = self.grid_map, self.mapping.evaluate(control_points)
        rotation = vectors = followed = slid = None
        start = self.mapping.evaluate(initial) if self.needs_initial else nodes
        if self.has_residual:
            residual, start = self.nodes - start, self.nodes
            if grid_map.rotation_map is None:
                nodes += residual
            else:
                rotation = grid_map.rotation_map.at(control_points, initial)
                vectors = grid_map.rotation_map.vectors(residual)
                nodes += rotation.evaluate(np.zeros_like(control_points), vectors)
        if grid_map.ties is not None:
            grid_map.ties.move_alike(nodes, start)
        if self.sliding is not None:
            slid = self.sliding.apply(nodes, start)
        if grid_map.following is not None:
            followed = grid_map.following.at(start, nodes, start, nodes)
        if grid_map.ties is not None and not (slid is None and followed is None):
            grid_map.ties.move_alike(nodes, start)
        return LiveGridState(self, initial, control_points, nodes, rotation, vectors, followed, slid)


@dataclass(frozen=True, eq=False)
class LiveGridState:
    """A grid and its derivative."""

    of: LiveGrid  # the map
    # control points of the baseline (arbitrary if the grid does not depend on them), and now (m)
    initial: np.ndarray  # (n_control_points, 3)
    control_points: np.ndarray  # (n_control_points, 3)
    nodes: np.ndarray  # (n_nodes, 3), the grid (m)
    rotation: RotationState | None  # rotations of the residual
    vectors: Vectors | None  # the residual that turns
    followed: Followed | None  # nodes that followed walls
    slid: SlidNodes | None  # nodes that slid on surfaces

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.of.inputs

    def jvp(
        self,
        # changes, none by default: of the baseline, and of the initial and current control points
        grid_initial: np.ndarray | None = None,  # (n_nodes, 3)
        control_points_initial: np.ndarray | None = None,  # (n_control_points, 3)
        control_points: np.ndarray | None = None,  # (n_control_points, 3)
    ) -> np.ndarray:  # (n_nodes, 3)
        """Change of the grid."""
        of, none = self.of, np.zeros_like(self.control_points)
        d_nodes = np.zeros_like(self.nodes) if grid_initial is None else grid_initial
        d_control = none if control_points is None else control_points
        change = d_start = of.mapping.jvp(self.control_points, d_nodes, d_control)
        if of.needs_initial:
            d_initial = none if control_points_initial is None else control_points_initial
            d_start = of.mapping.jvp(self.initial, d_nodes, d_initial)
        if of.has_residual:
            d_residual, d_start = d_nodes - d_start, d_nodes
            if self.rotation is None or self.vectors is None:
                change += d_residual
            else:
                d_rotation = self.rotation.change(d_control, d_initial)
                d_vectors = self.rotation.of.vectors(d_residual)
                change += self.rotation.jvp(none, d_rotation, self.vectors, d_vectors)
        ties = of.grid_map.ties
        if ties is not None:
            ties.move_alike(change, d_start)
        if self.slid is not None and of.sliding is not None:
            of.sliding.jvp(self.slid, change, d_start)
        if self.followed is not None:
            self.followed.jvp(change, change, d_start)
        if ties is not None and not (self.slid is None and self.followed is None):
            ties.move_alike(change, d_start)
        return change

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`: derivatives in the inputs that are named, in all by default."""
        of, wrt = self.of, require_inputs(wrt, self.inputs)
        bar, start_bar, ties = bar.copy(), np.zeros_like(bar), of.grid_map.ties
        if ties is not None and not (self.slid is None and self.followed is None):
            ties.move_alike_vjp(bar, start_bar)
        if self.followed is not None:
            self.followed.add_vjp(bar, bar, start_bar)
        if self.slid is not None and of.sliding is not None:
            of.sliding.vjp(self.slid, bar, start_bar)
        if ties is not None:
            ties.move_alike_vjp(bar, start_bar)
        bars = dict(zip((GRID_INITIAL, CONTROL_POINTS), of.mapping.vjp(self.control_points, bar)))
        if of.needs_initial:
            bars[CONTROL_POINTS_INITIAL] = np.zeros_like(self.initial)
            if of.has_residual:
                residual_bar = bar
                if self.rotation is not None and self.vectors is not None:
                    residual_bar = self._rotation_vjp(self.rotation, self.vectors, bar, bars)
                bars[GRID_INITIAL] += start_bar + residual_bar
                start_bar = -residual_bar
            for name, part in zip((GRID_INITIAL, CONTROL_POINTS_INITIAL), of.mapping.vjp(self.initial, start_bar)):
                bars[name] = bars[name] + part
        return {name: bars[name] for name in wrt}

    def _rotation_vjp(
        self, rotation: RotationState, vectors: Vectors, bar: np.ndarray, bars: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Add the rotations' part to the bars of both sets of control points; return the bar of the residual."""
        copies = self.of.mapping.problem.sharing.copies
        np.add.at(bar, copies[:, 1], bar[copies[:, 0]])
        bar[copies[:, 0]] = 0.0
        by_rotation = rotation.vjp(vectors, bar, (CONTROL_POINTS, CONTROL_POINTS_INITIAL, "vectors"))
        bars[CONTROL_POINTS] += by_rotation[CONTROL_POINTS]
        bars[CONTROL_POINTS_INITIAL] = by_rotation[CONTROL_POINTS_INITIAL]
        by_rotation["vectors"][copies[:, 0]] = 0.0
        return by_rotation["vectors"]
