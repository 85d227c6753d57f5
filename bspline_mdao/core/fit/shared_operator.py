"""The linear map from the nodes of a grid to its control points, on several processes with some blocks each.

Forwards, the control points of each round of entities (`bspline_mdao.core.fit.problem.FitProblem.rounds`) are sent to
all processes before the next round begins. In reverse the rounds run backwards: the cotangents from later rounds for
the control points of a round are summed over all processes before it begins.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...base.numerics.processes import summed, together
from ...base.numerics.threads import map_tasks, one_blas_thread
from .fit_nodes import FitNodes
from .least_squares import FitStep
from .problem import FitProblem
from .quasi_interpolant import Mixture

__all__ = ["SharedFitOperator"]


@dataclass(frozen=True, eq=False)
class SharedFitOperator:
    """The linear map from distributed nodes to all control points, for given parameters and knots."""

    sharing: FitNodes  # nodes of this process
    unknown_ids: tuple[np.ndarray, ...]  # for every round, numbers of the control points that any process solves for
    steps: tuple[tuple[FitStep, ...], ...]  # for every round, the least squares of this process
    n_control_points: int  # number of control points
    mixture: Mixture  # control points where least squares fold

    @classmethod
    def of(
        cls,
        problem: FitProblem,  # the fit on the nodes of this process
        # parameters of the nodes of every segment of this process; of shape (0, 0, 0, 3) for others
        parameters: Sequence[np.ndarray],  # each (L0, L1, L2, 3)
        weights: np.ndarray | None,  # (n_control_points, 6), or None, weights of the candidates, see `Mixture`
    ) -> SharedFitOperator:
        """Factor all least squares of this process; all processes call this."""
        mixture, here = problem.mixture(parameters, weights), set(problem.sharing.here)
        ids, steps = [], []
        with together(problem.sharing.comm), one_blas_thread:
            for entities in problem.rounds() if mixture.has_least_squares else ():
                local = [entity for entity in entities if entity.segment in here]
                ids.append(np.concatenate([entity.unknown_ids for entity in entities]))
                steps.append(tuple(map_tasks(partial(problem.step, parameters), local, problem.n_threads)))
        return cls(problem.sharing, tuple(ids), tuple(steps), problem.mesh.n_control_points, mixture)

    def forward(self, nodes: np.ndarray) -> np.ndarray:
        """Control points, shape (n_control_points, 3), on all processes, from the nodes of each, shape (n_owned, 3)."""
        nodes = self.sharing.fetch(self.sharing.with_places(nodes))
        control_points = np.zeros((self.n_control_points, 3))
        with one_blas_thread:
            for steps in self.steps:
                for step in steps:
                    step.solve(nodes, control_points)
                found = [step.entity.unknown_ids for step in steps]
                self.sharing.from_owners(np.concatenate([np.zeros(0, dtype=np.int64), *found]), control_points)
        return self.mixture.forward(control_points, nodes)

    def adjoint(self, control_bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`, shape (n_owned, 3), for a ``control_bar`` that is the same on all processes."""
        seed, nodes_bar = self.mixture.adjoint(control_bar, self.sharing.n_rows)
        wanted = np.zeros_like(seed)
        with one_blas_thread:
            for ids, steps in zip(reversed(self.unknown_ids), reversed(self.steps)):
                wanted[ids] = seed[ids] + summed(self.sharing.comm, wanted[ids])
                for step in steps:
                    step.solve_transpose(wanted, nodes_bar)
                wanted[ids] = 0.0
        return self.sharing.add_back(nodes_bar)[: self.sharing.n_owned]
