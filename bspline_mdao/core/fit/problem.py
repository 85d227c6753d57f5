"""A fit that is set up, and the pass of least squares that solves it, section II.D.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain

import numpy as np

from ...base.numerics.processes import together
from ...base.numerics.progress import Progress, no_progress
from ...base.numerics.threads import map_tasks, one_blas_thread, thread_count
from ...grids.topology.periodic_ties import Ties, control_ties
from ...grids.topology.topology import Topology
from ..splines.mesh import BSplineMesh
from .entities import Entity, entities_in_order
from .fit_nodes import FitNodes
from .least_squares import LARGEST_GRAM, FitOperator, FitStep, build_step, places_on_edges
from .quasi_interpolant import Mixture


@dataclass(frozen=True, eq=False)
class FitProblem:
    """A fit that is set up: everything except control points."""

    # edge_places: see `bspline_mdao.core.fit.least_squares.places_on_edges`, of every segment; they stay fixed when the
    # knots change

    topology: Topology  # segments and links
    sharing: FitNodes  # nodes of the segments of this process
    mesh: BSplineMesh  # one volume per segment
    entities: tuple[Entity, ...]  # in the order of section II.D
    edge_places: tuple[tuple[np.ndarray, ...], ...]

    @cached_property
    def ties(self) -> Ties | None:
        """Control points of periodic sides, which are equal up to a motion; None if there are none."""
        return control_ties(self.topology, self.mesh.control_ids)

    def step(self, parameters: Sequence[np.ndarray], entity: Entity) -> FitStep:
        """Least squares of an entity, factored, for parameters of every segment."""
        s, name = entity.segment, f"{self.topology.source}: {entity.describe(self.topology.segment_names)}"
        segment = self.mesh.volumes[s], parameters[s], self.sharing.rows[s], self.edge_places[s]
        return build_step(entity, *segment, self.sharing.n_rows, name)

    def rounds(self) -> list[list[Entity]]:
        """Entities in successive sets: entities of a set do not depend on each other's control points."""
        round_of = np.full(self.mesh.n_control_points, -1)
        rounds: list[list[Entity]] = []
        for entity in self.entities:
            number = int(round_of[entity.control_ids].max()) + 1
            round_of[entity.unknown_ids] = number
            rounds.extend([] for _ in range(number + 1 - len(rounds)))
            rounds[number].append(entity)
        return rounds

    @property
    def n_threads(self) -> int:
        """Threads for a fit: fewer than usual if the Gram matrices together would exceed the limit for one."""
        largest = max((len(entity.unknown_ids) for entity in self.entities), default=0)
        return max(1, min(thread_count(None), LARGEST_GRAM // (8 * largest**2 + 1)))

    def mixture(self, parameters: Sequence[np.ndarray], weights: np.ndarray | None) -> Mixture:
        """Mixture of candidates for these parameters, see `Mixture`."""
        return Mixture.of(weights, self.mesh, self.sharing, parameters)

    def operator(
        self,
        parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3), parameters of the nodes of every segment
        # weights of the candidates, see `Mixture`; only least squares by default
        weights: np.ndarray | None = None,  # (n_control_points, 6)
        entities: Sequence[Entity] | None = None,  # entities to solve for, in order; all by default
    ) -> FitOperator:
        """Linear map from nodes to control points for these parameters, with all factors kept."""
        mixture, steps = self.mixture(parameters, weights), ()
        if mixture.has_least_squares:
            entities = self.entities if entities is None else entities
            with one_blas_thread:
                steps = tuple(map_tasks(partial(self.step, parameters), entities, self.n_threads))
        return FitOperator(steps, self.sharing.n_rows, self.mesh.n_control_points, mixture)


@dataclass(frozen=True, eq=False)
class FitSolution:
    """Control points and fitted nodes of a fit."""

    # weights: see `Mixture`; None for least squares only

    control_points: np.ndarray  # (n_control_points, 3), control points (m)
    fitted: np.ndarray  # (n_nodes, 3), points of the spline at the nodes (m)
    warnings: tuple[str, ...] = ()  # entities whose data do not determine all control points
    weights: np.ndarray | None = None
    # least squares for the same parameters, if they were solved and differ
    least_squares: FitSolution | None = None


def problem_of_mesh(
    topology: Topology,  # segments and links
    mesh: BSplineMesh,  # one volume per segment
    sharing: FitNodes | None = None,  # nodes of this process; all by default
) -> FitProblem:
    """Set up the fit of an existing mesh, for example a fitted model's."""
    sharing = FitNodes.of(topology) if sharing is None else sharing
    entities = tuple(entities_in_order(mesh.control_ids, sharing, mesh.n_control_points))
    edge_places = tuple(places_on_edges(volume) for volume in mesh.volumes)
    return FitProblem(topology, sharing, mesh, entities, edge_places)


def solve_fit(
    problem: FitProblem,
    parameters: Sequence[
        np.ndarray
    ],  # sequence of ndarray each (L0, L1, L2, 3), parameters of the nodes of every segment
    nodes: np.ndarray,  # (n_rows, 3), the nodes of this process (m), including those that it needs from others
    progress: Progress | None = None,  # as for `fit_grid`
) -> FitSolution:
    """Solve the least squares of all entities, a round at a time on several threads, without keeping factors."""
    # The result has the same bits for any number of threads.
    progress, sharing = progress or no_progress, problem.sharing
    control_points, fitted = np.zeros((problem.mesh.n_control_points, 3)), np.empty_like(nodes)
    is_fitted, here = np.zeros(len(nodes), dtype=bool), set(sharing.here)
    singular: list[tuple[int, int]] = []
    rounds, n_done = problem.rounds(), 0

    def solve(entity: Entity) -> bool:
        step = problem.step(parameters, entity)
        step.solve(nodes, control_points)
        fitted[entity.rows] = step.evaluate(control_points)
        is_fitted[entity.rows] = True
        return step.factor is not None and step.factor.is_singular

    with one_blas_thread:
        for number, entities in enumerate(rounds):
            local = [place for place, entity in enumerate(entities) if entity.segment in here]
            with together(sharing.comm):
                results = map_tasks(solve, [entities[place] for place in local], problem.n_threads)
                for place, is_singular in zip(local, results):
                    singular.extend([(number, place)] * is_singular)
                    n_done += len(entities[place].rows)
                    progress(n_done / max(sharing.n_owned, 1), "least squares")
            found = [entities[place].unknown_ids for place in local]
            sharing.from_owners(np.concatenate([np.zeros(0, dtype=np.int64), *found]), control_points)
    sharing.put(fitted, is_fitted)
    sharing.copy_shared(fitted)
    if sharing.comm.size > 1:
        singular = sorted(chain.from_iterable(sharing.comm.allgather(singular)))
    names = [rounds[number][place] for number, place in singular]
    return FitSolution(control_points, fitted, _warn_of_singular(problem.topology, names))


def _warn_of_singular(topology: Topology, entities: Sequence[Entity]) -> tuple[str, ...]:
    """One line on the entities with too little data."""
    if not entities:
        return ()
    names = topology.segment_names
    listed = ", ".join(entity.describe(names) for entity in entities[:5]) + (", ..." if len(entities) > 5 else "")
    return (
        f"the nodes do not determine all control points of {len(entities)} parts ({listed}); these are drawn to the "
        f"grid's own coarse nodes; fewer control points avoid it (n_control, --n-control)",
    )


def part_of(progress: Progress, start: float, stop: float) -> Progress:
    """Report the progress of a part of the work, from ``start`` to ``stop`` of the whole."""
    return lambda fraction, what: progress(start + (stop - start) * fraction, what)
