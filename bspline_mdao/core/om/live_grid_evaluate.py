"""The grid that belongs to a set of control points and to a baseline grid that changes, as an OpenMDAO component."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...errors import InputError
from ...grids.topology.partition import Partition, Subdomain
from ...names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, GRID, GRID_INITIAL
from ..fit.live_fit import LiveGrid, LiveGridState, live_grid
from ..mesh.boundary import require_mesh_of
from ..mesh.moving_mesh import MovingMesh
from ..model.fitted_model import FittedModel
from .checked_along_edges import check_along_edges, numbered_blocks
from .component import (
    CheckedOnProcesses,
    LastState,
    add_product,
    fails_together,
    failures_as_analysis_errors,
    finite_points,
    refuse_complex_step,
)
from .fit import LIVE_SHARPNESS
from .model_option import declare_model
from .subdomains import WholeNodes, blocks_of, declare_partition

INPUTS = (GRID_INITIAL, CONTROL_POINTS_INITIAL, CONTROL_POINTS)


class LiveGridEvaluate(CheckedOnProcesses, om.ExplicitComponent):
    """Regenerate the grid with parameters and knots that follow the baseline grid x0: `bspline_mdao.core.fit.live_fit`.

    The partner of ``Fit(live=True)``: behind a grid generator the totals of the regenerated grid are exact. Residual
    and wall layer are those of x0; which nodes are near a wall, and how much they follow it, stays as in the model. Of
    a model without ``wall_layer`` the grid is ``x = x0 + A(x0) (b - b0)``. Where there is no residual either, it is
    ``x = A(x0) b``, and there is no input ``control_points_initial``.

    ==========================  ======  ====================  =====  ===============================================
    name                        role    shape                 units  meaning
    ==========================  ======  ====================  =====  ===============================================
    ``grid_initial``            input   (3 n_nodes)           m      nodes of the baseline, as for `Fit`
    ``control_points_initial``  input   (3 n_control_points)  m      control points fitted to the baseline
    ``control_points``          input   (3 n_control_points)  m      control points after movement
    ``grid``                    output  (3 n_nodes)           m      nodes, blocks in file order, each in C order of
                                                                     (i, j, k), xyz interleaved
    ==========================  ======  ====================  =====  ===============================================

    On several processes ``grid_initial`` and ``grid`` are distributed, as ``grid_initial`` of `Fit`. Each process is
    sent all nodes, and evaluates all of the grid: for grids that fit into the memory of one.

    Options
    -------
    model : FittedModel
        Fit of a baseline grid: topology, orders and numbers of control points.
    mesh : MovingMesh, optional
        Control mesh that moved: where patches of it slide on surfaces that are not planes, see `moving_mesh`, their
        nodes stay as high above these as ``grid_initial`` has them, see :doc:`/theory/sliding`.
    partition : Partition, optional
        Which blocks each process holds, none of them cut; by default
        ``Partition.of(model.topology, n, imbalance=math.inf)``.

    Raises
    ------
    InputError
        In ``setup``, if the mesh is that of another model, if the model's parameters are corrected or given, or its
        knots are the user's own, or if the partition cuts a block or is of another number of processes; in a run,
        under complex step.
    om.AnalysisError
        In a run, if a number is not finite, if the nodes have no parameters and knots, or if the surroundings of a
        point are turned inside out.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import LiveGridEvaluate, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("body", LiveGridEvaluate(model=model), promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()
    >>> problem.get_val("grid").shape
    (2250,)
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: FittedModel,
            mesh: MovingMesh | None = None,
            partition: Partition | Subdomain | None = None,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, FittedModel, desc="fit of the baseline grid")
        types = (MovingMesh, type(None))
        self.options.declare("mesh", types=types, default=None, recordable=False, desc="control mesh that moved")
        declare_partition(self)

    @fails_together
    def setup(self) -> None:
        """Declare the variables, of the sizes of the model."""
        model, is_distributed, mesh = self.options["model"], self.comm.size > 1, self.options["mesh"]
        if mesh is not None:
            require_mesh_of(model, mesh, f"{self.msginfo}: the mesh")
        self._map = model.map_sliding(() if mesh is None else mesh.slides, model)
        partition = blocks_of(self)
        self._whole = WholeNodes.of(self.comm, partition)
        grid = model.regenerate()
        baseline = grid.to_vector().reshape(-1, 3)
        self._baseline, self._last = LastState(), LastState()
        needs_initial = self._baseline.at([baseline], self._grid).needs_initial
        local = self._whole.local(baseline).ravel()
        self.add_input(GRID_INITIAL, val=local, units="m", distributed=is_distributed)
        if needs_initial:
            self.add_input(CONTROL_POINTS_INITIAL, val=model.control_points.ravel(), units="m")
        self.add_input(CONTROL_POINTS, val=model.control_points.ravel(), units="m")
        self.add_output(GRID, val=local, units="m", distributed=is_distributed)
        shapes = (window.shape for window in partition.pieces[self.comm.rank])
        check_along_edges(self, GRID_INITIAL, numbered_blocks(shapes), LIVE_SHARPNESS)
        for name in (CONTROL_POINTS_INITIAL, CONTROL_POINTS) if needs_initial else (CONTROL_POINTS,):
            check_along_edges(self, name, model.mesh.control_ids)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Evaluate the volumes at the nodes, and let nodes follow walls."""
        outputs[GRID] = self._whole.local(self._state_at(inputs).nodes).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        state, whole = self._state_at(inputs), self._whole

        names = [name for name in state.inputs if name in d_inputs]

        def jvp(*directions: np.ndarray) -> np.ndarray:
            changes = dict(zip(names, directions))
            if GRID_INITIAL in changes:
                changes[GRID_INITIAL] = whole.gather(changes[GRID_INITIAL])
            return whole.local(state.jvp(**changes))

        def vjp(bar: np.ndarray) -> list[np.ndarray | None]:
            bars = state.vjp(whole.gather(bar), names)
            return [whole.local(bars[name]) if name == GRID_INITIAL else bars[name] for name in names]

        add_product(inputs, d_inputs, d_outputs, mode, jvp=jvp, vjp=vjp, of=GRID, wrt=names)

    def _grid(self, nodes: np.ndarray) -> LiveGrid:
        return live_grid(self.options["model"], nodes, self._map)

    def _state_at(self, inputs: Vector) -> LiveGridState:
        points = self._points(inputs)
        points[GRID_INITIAL] = self._whole.gather(points[GRID_INITIAL])
        return self._state_of(points)

    @fails_together
    def _points(self, inputs: Vector) -> dict[str, np.ndarray]:
        """Inputs as points, those of the grid of this process alone."""
        refuse_complex_step(self)
        return {name: finite_points(inputs[name], name, self.msginfo) for name in INPUTS if name in inputs}

    @fails_together
    def _state_of(self, points: dict[str, np.ndarray]) -> LiveGridState:
        with failures_as_analysis_errors(self, (InputError,)):
            grid = self._baseline.at([points[GRID_INITIAL]], self._grid)

        def make(*copies: np.ndarray) -> LiveGridState:
            made_for = dict(zip(points, copies))
            return grid.at(made_for[CONTROL_POINTS], made_for.get(CONTROL_POINTS_INITIAL))

        with failures_as_analysis_errors(self):
            return self._last.at(list(points.values()), make)
