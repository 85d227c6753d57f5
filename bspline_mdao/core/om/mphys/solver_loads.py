"""Forces on the surface nodes, as MPhys passes them to structures."""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ....base.numerics.processes import summed
from ..check_directions import check_along_directions
from ..component import LINEAR_STEP, CheckedOnProcesses
from .conventions import COUPLING, F_AERO
from .distribution import nodes_of_rank

__all__ = ["WALL_FORCES", "SolverLoads"]

WALL_FORCES = "wall_forces"
"""Forces on all surface nodes, as the flows of this package return them."""


class SolverLoads(CheckedOnProcesses, om.ExplicitComponent):
    """Give each process the forces on its surface nodes.

    ===============  ======  ============  =====  ======================================================================
    name             role    shape         units  meaning
    ===============  ======  ============  =====  ======================================================================
    ``wall_forces``  input   (3 n)         N      forces on all nodes of the surface, the same on all processes
    ``f_aero``       output  (3 n_points)         forces (N) on the nodes of this process, distributed as ``x_aero``
    ===============  ======  ============  =====  ======================================================================

    Options
    -------
    n_points : int
        Nodes of the surface.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("n_points", types=int, desc="nodes of the surface")

    def setup(self) -> None:
        """Declare the variables."""
        n_points = self.options["n_points"]
        self._numbers = nodes_of_rank(None, n_points, "numbers", self.comm, self.msginfo)
        nothing, is_distributed = np.zeros(3 * len(self._numbers)), self.comm.size > 1
        self.add_input(WALL_FORCES, val=np.zeros(3 * n_points), units="N")
        self.add_output(F_AERO, val=nothing, distributed=is_distributed, tags=COUPLING)
        check_along_directions(self, LINEAR_STEP)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Take the nodes of this process."""
        outputs[F_AERO] = inputs[WALL_FORCES].reshape(-1, 3)[self._numbers].ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if F_AERO not in d_outputs or WALL_FORCES not in d_inputs:
            return
        if mode == "fwd":
            d_outputs[F_AERO] += d_inputs[WALL_FORCES].reshape(-1, 3)[self._numbers].ravel()
        else:
            bar = np.zeros((self.options["n_points"], 3), dtype=d_outputs[F_AERO].dtype)
            bar[self._numbers] = d_outputs[F_AERO].reshape(-1, 3)
            d_inputs[WALL_FORCES] += summed(self.comm, bar).ravel()
