"""Load and displacement transfer of MPhys by rigid links to a beam.

Theory: ``docs/theory/aerostructure.rst``.
"""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from mphys import Builder
from openmdao.vectors.vector import Vector

from ....base.numerics.processes import summed
from ....core.om.check_directions import check_along_directions
from ....core.om.component import SMOOTH_STEP, CheckedOnProcesses, fails_together, finite_points
from ....core.om.mphys.conventions import COORDINATES, COUPLING, F_AERO, U_AERO, U_STRUCT, X_JIG, X_STRUCT, names_of
from ....core.om.mphys.distribution import nodes_of_rank
from ...loads.rigid_links import N_DOF, RigidLinks

__all__ = ["LinkedDisplacements", "LinkedLoads", "RigidLinkBuilder"]


class RigidLinkBuilder(Builder):
    """Load and displacement transfer of aerostructural scenarios between a surface and a beam (``ldxfer_builder``).

    Parameters
    ----------
    links : RigidLinks
        The nodes of the beam to which each node of the surface is linked.
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.flow import RigidLinks
    >>> from bspline_mdao.mphys import RigidLinkBuilder
    >>> beam = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> builder = RigidLinkBuilder(RigidLinks.to_beam(np.array([[0.0, 0.1, 0.5]]), beam))
    >>> [type(part).__name__ for part in builder.get_coupling_group_subsystem()]
    ['LinkedDisplacements', 'LinkedLoads']
    """

    def __init__(self, links: RigidLinks, generation: int | None = None):
        self._links, self._generation = links, generation

    def get_coupling_group_subsystem(self, scenario_name: str | None = None) -> tuple[LinkedDisplacements, LinkedLoads]:
        """Make the components that transfer displacements and loads."""
        return LinkedDisplacements(links=self._links), LinkedLoads(links=self._links, generation=self._generation)


class _Linked(CheckedOnProcesses, om.ExplicitComponent):
    """Common part of both components: the points of this process, and the beam, which all processes have."""

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("links", types=RigidLinks, recordable=False, desc="what hangs on which nodes of the beam")

    def setup(self) -> None:
        """Declare the coordinates of both sides."""
        n_points, n_nodes = self.options["links"].weights.shape
        self._rows = nodes_of_rank(None, n_points, "points", self.comm, self.msginfo)
        self._here, self._n_nodes = self.options["links"].of_points(self._rows), n_nodes
        self.add_input(X_JIG, shape=3 * len(self._rows), distributed=self.comm.size > 1, tags=COORDINATES)
        self.add_input(X_STRUCT, shape=3 * n_nodes, tags=COORDINATES)
        check_along_directions(self, SMOOTH_STEP)

    @fails_together
    def _at(self, inputs: Vector, name: str, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, beam, and the transferred quantity."""
        x, beam = (finite_points(inputs[known], known, self.msginfo) for known in (X_JIG, X_STRUCT))
        return x, beam, inputs[name].reshape(-1, width)

    def _along(self, inputs: Vector, d_inputs: Vector, name: str, width: int) -> list[np.ndarray]:
        """Directions in all of these, zero if OpenMDAO leaves one out."""
        names = (X_JIG, 3), (X_STRUCT, 3), (name, width)
        return [(d_inputs[n] if n in d_inputs else 0.0 * inputs[n]).reshape(-1, size) for n, size in names]


class LinkedDisplacements(_Linked):
    """Displacements of a surface that is attached to a beam by rigid links.

    ==============  ======  ============  ==============================================================================
    name            role    shape         meaning
    ==============  ======  ============  ==============================================================================
    ``x_aero0``     input   (3 n_points)  nodes of the surface before it is displaced (m)
    ``x_struct0``   input   (3 n_nodes)   nodes of the beam before (m)
    ``u_struct``    input   (6 n_nodes)   their displacements (m) and rotations (rad)
    ``u_aero``      output  (3 n_points)  displacements of the surface (m)
    ==============  ======  ============  ==============================================================================

    On several processes the surface is distributed, and the beam the same on all.

    Options
    -------
    links : RigidLinks
        The nodes of the beam to which each node of the surface is linked.
    """

    def setup(self) -> None:
        """Declare the variables."""
        super().setup()
        self.add_input(U_STRUCT, val=np.zeros(N_DOF * self._n_nodes), tags=COUPLING)
        nothing = np.zeros(3 * len(self._rows))
        self.add_output(U_AERO, val=nothing, distributed=self.comm.size > 1, tags=COUPLING)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Displace the points of this process."""
        outputs[U_AERO] = self._here.displacements(*self._at(inputs, U_STRUCT, N_DOF)).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if U_AERO not in d_outputs:
            return
        at = self._at(inputs, U_STRUCT, N_DOF)
        if mode == "fwd":
            along = self._along(inputs, d_inputs, U_STRUCT, N_DOF)
            d_outputs[U_AERO] += self._here.displacements_jvp(*at, *along).ravel()
            return
        x_bar, beam_bar, u_bar = self._here.displacements_vjp(*at, d_outputs[U_AERO].reshape(-1, 3))
        for name, bar in (X_JIG, x_bar), (X_STRUCT, summed(self.comm, beam_bar)), (U_STRUCT, summed(self.comm, u_bar)):
            if name in d_inputs:
                d_inputs[name] += bar.ravel()


class LinkedLoads(_Linked):
    """Loads on a beam from the forces on a surface that is attached to it by rigid links.

    =================  ======  ============  ===========================================================================
    name               role    shape         meaning
    =================  ======  ============  ===========================================================================
    ``x_aero0``        input   (3 n_points)  nodes of the surface before it is displaced (m)
    ``x_struct0``      input   (3 n_nodes)   nodes of the beam before (m)
    ``f_aero``         input   (3 n_points)  forces on the surface (N)
    ``f_aero_struct``  output  (6 n_nodes)   forces (N) and moments (N m) on the beam; ``f_struct`` in MPhys 1.x
    =================  ======  ============  ===========================================================================

    On several processes the surface is distributed, and the beam the same on all.

    Options
    -------
    links : RigidLinks
        The nodes of the beam to which each node of the surface is linked.
    generation : int, optional
        1 or 2: the MPhys version whose names are used; by default the installed one.
    """

    def initialize(self) -> None:
        """Declare the options."""
        super().initialize()
        self.options.declare("generation", default=None, desc="MPhys whose names are used")

    def setup(self) -> None:
        """Declare the variables."""
        super().setup()
        self._loads = names_of(self.options["generation"], self.msginfo).struct_loads
        nothing = np.zeros(3 * len(self._rows))
        self.add_input(F_AERO, val=nothing, distributed=self.comm.size > 1, tags=COUPLING)
        self.add_output(self._loads, val=np.zeros(N_DOF * self._n_nodes), tags=COUPLING)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Sum the forces of all processes."""
        loads = self._here.loads(*self._at(inputs, F_AERO, 3))
        outputs[self._loads] = summed(self.comm, loads).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if self._loads not in d_outputs:
            return
        at = self._at(inputs, F_AERO, 3)
        if mode == "fwd":
            change = self._here.loads_jvp(*at, *self._along(inputs, d_inputs, F_AERO, 3))
            d_outputs[self._loads] += summed(self.comm, change).ravel()
            return
        x_bar, beam_bar, f_bar = self._here.loads_vjp(*at, d_outputs[self._loads].reshape(-1, N_DOF))
        for name, bar in (X_JIG, x_bar), (X_STRUCT, summed(self.comm, beam_bar)), (F_AERO, f_bar):
            if name in d_inputs:
                d_inputs[name] += bar.ravel()
