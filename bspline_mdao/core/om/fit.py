"""Control points fitted to a grid, as an OpenMDAO component."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...base.numerics.processes import together
from ...errors import InputError
from ...grids.topology.partition import Partition, Subdomain
from ...names import CONTROL_POINTS_INITIAL, GRID_INITIAL
from ..fit.fit_nodes import FitNodes
from ..fit.least_squares import FitOperator
from ..fit.live_fit import LiveFit, live_fit
from ..fit.problem import problem_of_mesh
from ..fit.shared_operator import SharedFitOperator
from ..model.fitted_model import FittedModel
from .check_directions import check_along_directions
from .checked_along_edges import check_along_edges, numbered_blocks
from .component import (
    LINEAR_STEP,
    CheckedOnProcesses,
    LastState,
    add_product,
    by_parts,
    fails_together,
    failures_as_analysis_errors,
    finite_points,
    refuse_complex_step,
)
from .model_option import declare_model
from .subdomains import WholeNodes, blocks_of, declare_partition

LIVE_SHARPNESS = 1000.0
"""Edges of the grid divided by lengths over which a live fit changes, for `check_along_edges`: chord lengths of close
neighbours determine knots, and knots affect many control points."""


class Fit(CheckedOnProcesses, om.ExplicitComponent):
    """Fit control points to a grid, section II.D, by least squares or such that the control mesh stays valid.

    With the model's parameters and knots frozen, the component is linear (`is_linear`). Its Jacobian is dense, since
    every node affects every control point of its block, so it is only applied, never stored.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    ``grid_initial``            input   (3 n_nodes)           m      nodes, blocks in file order, each in C order of
                                                                     (i, j, k), xyz interleaved
    ``control_points_initial``  output  (3 n_control_points)  m      fitted control points, each shared one once
    ==========================  ======  ====================  =====  ===============================================

    On several processes ``grid_initial`` is distributed: each fits whole blocks, and control points are sent to all.
    With ``live`` each process receives all nodes and computes the whole fit, so the grid must fit into the memory of
    one process.

    Options
    -------
    model : FittedModel
        Fit of the baseline grid: topology, orders, numbers of control points, and the parameters and knots to freeze.
    partition : Partition, optional
        Which blocks each process has, none of them cut; by default
        ``Partition.of(model.topology, n, imbalance=math.inf)``.
    live : bool
        Compute parameters and edge knots from the input as well, and differentiate through them, so an upstream grid
        generator gets the exact total derivative. Where control points fall back on a quasi-interpolant, its weights
        remain those of the model's own grid.

    Raises
    ------
    InputError
        In ``setup``, if ``live`` is set for a model with corrected or given parameters or user-defined knots, or if the
        partition cuts a block or has a different number of processes; in a run, under complex step with ``live``.
    om.AnalysisError
        In a run, if a node is not finite, or if the nodes cannot be fitted.

    Examples
    --------
    >>> import numpy as np
    >>> import openmdao.api as om
    >>> from bspline_mdao import Fit, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", Fit(model=model), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("grid_initial", 2.0 * model.regenerate().to_vector())
    >>> problem.run_model()
    >>> bool(np.allclose(problem.get_val("control_points_initial"), 2.0 * model.control_points.ravel()))
    True
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: FittedModel,
            partition: Partition | Subdomain | None = None,
            live: bool = False,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, FittedModel, desc="fit of the baseline grid")
        declare_partition(self)
        self.options.declare("live", types=bool, default=False, desc="differentiate through parameters and knots")

    @property
    def is_linear(self) -> bool:
        """Whether the outputs depend linearly on the inputs."""
        return not self.options["live"]

    def setup(self) -> None:
        """Declare the variables in the model's sizes."""
        model, comm = self.options["model"], self.comm
        with together(comm):
            partition = blocks_of(self)
            subdomain = partition.subdomain(comm.rank)
            baseline = model.regenerate() if comm.size == 1 else model.local_model(subdomain).regenerate()
            self._whole = WholeNodes.of(comm, partition)
        nodes = baseline.to_vector().reshape(-1, 3) if comm.size == 1 else baseline
        is_live, self._last = self.options["live"], LastState()
        if is_live:
            self._live = LastState()
            whole = self._whole.gather(nodes)
            with together(comm):
                self._live.at([whole], self._fit)
        else:
            self._frozen = self._operator(partition)
        self.add_input(GRID_INITIAL, val=nodes.ravel(), units="m", distributed=comm.size > 1)
        self.add_output(CONTROL_POINTS_INITIAL, val=model.control_points.ravel(), units="m")
        if is_live:
            shapes = (window.shape for window in partition.pieces[comm.rank])
            check_along_edges(self, GRID_INITIAL, numbered_blocks(shapes), LIVE_SHARPNESS, digits=300.0)
        else:
            check_along_directions(self, LINEAR_STEP)

    def _operator(self, partition: Partition) -> FitOperator | SharedFitOperator:
        """Linear map of the frozen fit."""
        model, comm = self.options["model"], self.comm
        sharing = FitNodes.of(model.topology, comm, partition)
        problem = problem_of_mesh(model.topology, model.mesh, sharing)
        if comm.size == 1:
            return problem.operator(model.parameters, model.candidate_weights)
        here, nothing = set(sharing.here), np.empty((0, 0, 0, 3))
        parameters = [x if s in here else nothing for s, x in enumerate(model.parameters)]
        return SharedFitOperator.of(problem, parameters, model.candidate_weights)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Solve the least squares."""
        with failures_as_analysis_errors(self):
            nodes = finite_points(inputs[GRID_INITIAL], GRID_INITIAL, self.msginfo)
        control_points = self._live_at(nodes).control_points if self.options["live"] else self._frozen_at(nodes)
        outputs[CONTROL_POINTS_INITIAL] = control_points.ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if self.options["live"]:
            fit, whole = self._live_at(inputs[GRID_INITIAL]), self._whole

            def jvp(d_nodes: np.ndarray) -> np.ndarray:
                return fit.jvp(whole.gather(d_nodes))

            def vjp(bar: np.ndarray) -> np.ndarray:
                return whole.local(fit.vjp(bar))

            products: dict[str, Callable[[np.ndarray], np.ndarray]] = {"jvp": jvp, "vjp": vjp}
        else:
            if mode == "fwd" and self.comm.size == 1 and GRID_INITIAL in d_inputs and not d_inputs[GRID_INITIAL].any():
                return  # the grid is constant, in products of a whole problem
            products = {"jvp": self._frozen.forward, "vjp": self._frozen.adjoint}
        add_product(inputs, d_inputs, d_outputs, mode, **products, of=CONTROL_POINTS_INITIAL, wrt=GRID_INITIAL)

    def _frozen_at(self, nodes: np.ndarray) -> np.ndarray:
        """Control points of the frozen fit; a design loop over one grid fits it once."""
        if self.comm.size > 1:  # whose operator all processes call, or none
            return by_parts(self._frozen.forward, nodes)
        return self._last.at([nodes], lambda nodes: by_parts(self._frozen.forward, nodes))

    def _fit(self, nodes: np.ndarray) -> LiveFit:
        return live_fit(self.options["model"], nodes)

    @fails_together
    def _live_at(self, nodes: np.ndarray) -> LiveFit:
        with failures_as_analysis_errors(self, ()):
            refuse_complex_step(self)
        whole = self._whole.gather(nodes.reshape(-1, 3))
        with failures_as_analysis_errors(self, (InputError,)):
            return self._live.at([whole], self._fit)
