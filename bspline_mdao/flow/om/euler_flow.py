"""The flow about the grid of a fitted model by the Euler equations, as an OpenMDAO group, and its forces.

Theory: ``docs/theory/euler.rst`` and ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...core.design.hinge import Hinge
from ...core.mesh.surface import SurfaceGrid
from ...core.model.model import Model
from ...core.om.component import CheckedOnProcesses, add_bar, direction_in, fails_together
from ...core.om.model_option import Copied, declare_model
from ...core.om.subdomains import declare_partition, part_of_model
from ...errors import InputError
from ...grids.topology.partition import Partition, Subdomain
from ...names import GRID
from ..euler.flow_grid import FlowGrid, area_vectors
from ..euler.forces import FlowForces
from ..euler.gas import N_STATES
from ..euler.residual import SHOCK_THRESHOLD
from ..euler.sequencing import coarse_levels, useful_levels
from ..functionals import FUNCTIONALS
from ..loads.hinges import HingeMoment
from ..loads.stream import RADIAN
from .euler_state import SOLVER_OPTIONS, EulerState, check_on_grid, declare_solver
from .euler_wall_forces import EulerWallForces
from .flow_files import load_states, save_states, write_fields
from .moved_hinge import MovedHingeMoment
from .outputs import declare_outputs, documents_outputs
from .references import REFERENCES, declare_references, warn_of_area
from .spurious_drag import drag_sources, is_optimised, refuse_no_induced_drag, warn_of_spurious_drag
from .trimmed_state import TrimmedState


@documents_outputs("euler")
class EulerFlow(Copied, om.Group):
    """Steady compressible inviscid flow on all blocks of a grid, with its exact adjoint.

    The flow slips at walls and planes of symmetry, and the far field is the free stream. Patches of these kinds must
    cover the boundary of the grid. A cell with a negative volume raises ``om.AnalysisError``. Folded corners are not
    detected: avoid them by constraints of `Quality`. If blocks share a node, only its first row in the grid counts.

    ================  ======  ============  =====  =====================================================================
    name              role    shape         units  meaning
    ================  ======  ============  =====  =====================================================================
    ``grid``          input   (3 n_nodes)   m      nodes, blocks in file order, each in C order of (i, j, k)
    ``alpha``         input   (1,)          deg    angle of attack; 2 by default
    ``Mach_number``   input   (1,)                 of the free stream; 0.3 by default
    name of a Hinge   input   (6,)          m      both points of the axis of a hinge moment, where it moves
    ``states``        output  (5 n_cells)          see `EulerState`
    {outputs}
    ``CM_...``        output  (1,)                 hinge moments, one for each of the ``hinges``, by its name
    ================  ======  ============  =====  =====================================================================

    Moments are divided by reference area and chord.

    On several processes ``grid`` and ``states`` are distributed, and ``grid`` must be connected, for example to the
    output of `GridEvaluate`; all other variables are the same on all processes. All processes raise the same error.

    With ``trim`` the angle is solved for, such that ``CL`` equals its target, and all derivatives are at fixed lift:

    =============  ======  ============  =====  ========================================================================
    name           role    shape         units  meaning
    =============  ======  ============  =====  ========================================================================
    ``CL_target``  input   (1,)                 lift coefficient; 0.3 by default
    ``alpha``      output  (1,)          deg    angle of attack; 2 at first
    =============  ======  ============  =====  ========================================================================

    With a ``loaded`` surface also

    ====================  ======  ============  =====  =================================================================
    name                  role    shape         units  meaning
    ====================  ======  ============  =====  =================================================================
    ``dynamic_pressure``  input   (1,)          Pa     of the free stream; to be given
    ``wall_forces``       output  (3 n_points)  N      forces on the nodes of the surface, see `EulerWallForces`
    ====================  ======  ============  =====  =================================================================

    Options
    -------
    model : FittedModel or LocalModel
        The fitted grid, with its patches; or the part of it on this process.
    reference_area : float
        Area of the modelled part (m^2): of the half wing, if the grid contains one half.
    reference_chord : float
        Chord for moments (m).
    moment_reference : sequence of three float
        Reference point of moments, in the axes of the grid (m).
    partition : Partition, optional
        The distribution of the grid on several processes; the same as in the component that provides the ``grid``.
        `Partition.of` by default.
    axes : str
        Axes of the grid that point downstream, along the span, and up.
    shock_threshold : float
        Threshold of the shock sensor; 0.05 by default, 0 for none. Flow slower than 0.83 of the speed of sound is
        bitwise the same with and without it.
    loaded : SurfaceGrid, optional
        Walls whose nodes get forces.
    hinges : sequence of HingeMoment
        Control surfaces whose moments are outputs.
    restart : path-like, optional
        File of states to start from, made by `save_states` for this grid or another member of its family.
    trim : bool
        Whether to solve for the angle of attack at a given lift, see `TrimmedState`.
    tolerance, linear_tolerance, max_steps, iprint, anchored
        See `EulerState`.

    Raises
    ------
    InputError
        In ``setup``, if the patches do not define the kinds of the boundary, there is no reference area, or the
        partition does not fit the model or the number of processes.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import EulerFlow, fit_grid
    >>> from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0)))
    >>> problem = om.Problem(EulerFlow(model=model, reference_area=1.0, iprint=0), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("alpha", 2.0, units="deg")
    >>> problem.set_val("Mach_number", 0.5)
    >>> problem.run_model()
    >>> problem.get_val("CL").round(1)
    array([0.3])
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Model,
            reference_area: float | None = None,
            reference_chord: float = 1.0,
            moment_reference: Sequence[float] = (0.0, 0.0, 0.0),
            partition: Partition | Subdomain | None = None,
            axes: str = "xzy",
            shock_threshold: float = 0.05,
            loaded: SurfaceGrid | None = None,
            hinges: Sequence[HingeMoment] = (),
            restart: str | os.PathLike[str] | None = None,
            trim: bool = False,
            tolerance: float = 1e-12,
            linear_tolerance: float = 1e-14,
            max_steps: int = 100,
            iprint: int = 1,
            anchored: bool = False,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, Model)
        declare_references(self.options)
        declare_partition(self)
        self.options.declare("axes", default="xzy", desc="axes downstream, along the span, up")
        self.options.declare("shock_threshold", default=SHOCK_THRESHOLD, lower=0.0, desc="of the sensor; 0 for none")
        self.options.declare("loaded", types=SurfaceGrid, default=None, allow_none=True, recordable=False)
        self.options.declare("hinges", types=(list, tuple), default=(), recordable=False, desc="hinge moments")
        self.options.declare("restart", default=None, desc="file of states to start from")
        self.options.declare("trim", types=bool, default=False, desc="solve for alpha at a given lift")
        declare_solver(self.options)

    def setup(self) -> None:
        """Add the solution and its outputs."""
        model = self.options["model"]
        self._partition, nodes = self._pieces()
        partition = self._partition
        shocks = self.options["shock_threshold"]
        how: dict[str, Any] = {"partition": partition, "comm": self.comm, "shock_threshold": shocks}
        flow = FlowGrid.of(model.topology, nodes, self.options["axes"], **how)
        n_levels = useful_levels(model.topology)
        levels = coarse_levels(model.topology, nodes, n_levels, self.options["axes"], **how)
        settings = {name: self.options[name] for name in SOLVER_OPTIONS}
        references = [self.options[name] for name in REFERENCES]
        forces = FlowForces.of(flow, nodes, *references, hinges=self._hinges(flow))  # type: ignore[misc]
        if self.comm.size == 1:
            warn_of_area(self.pathname, references[0], area_vectors(flow.walls.nodes(nodes), flow.walls.corners))
        kind = TrimmedState if self.options["trim"] else EulerState
        state = kind(flow=flow, levels=levels, nodes=nodes, forces=forces, **settings)
        if self.options["restart"] is not None:
            states, alpha = load_states(self.options["restart"], self.comm, model.topology, partition)
            state.start_from(states, alpha)
        self.add_subsystem("state", state, promotes=["*"])
        self.add_subsystem("forces", EulerForces(flow=flow, nodes=nodes, forces=forces), promotes=["*"])
        for hinge in self.options["hinges"]:
            if isinstance(hinge.axis, Hinge):
                made = MovedHingeMoment(hinge=hinge, volume=hinge.volume((references[0], references[1])))
                self.add_subsystem(f"hinge_{hinge.name}", made, promotes=["*"])
        if self.options["loaded"] is not None:
            wall_forces = EulerWallForces(flow=flow, nodes=nodes, surface=self.options["loaded"])
            self.add_subsystem("wall_forces", wall_forces, promotes=["*"])
        if self.comm.size == 1:  # OpenMDAO requires distributed inputs to be connected
            self.set_input_defaults(GRID, val=nodes.ravel(), units="m")
        if self.options["trim"]:
            self.set_input_defaults("CL_target", val=0.3)
        else:
            self.set_input_defaults("alpha", val=2.0, units="deg")
        self.set_input_defaults("Mach_number", val=0.3)

    @property
    def is_section(self) -> bool:
        """Whether the flow is about a section, see `SurfaceGrid.is_section`: without trailing vortices."""
        model = self.options["model"]
        has_walls = any(face.kind == "wall" for face in model.topology.boundary)
        return has_walls and SurfaceGrid.of(model).is_section

    def write_fields(self, path: str | os.PathLike) -> None:
        """Write the fields of the flow for ParaView or Tecplot: on all blocks, and in a second file on the walls.

        ``Cp``, ``Mach``, ``velocity`` and ``density`` relative to the stream's, ``entropy`` above the stream's divided
        by the specific heat at constant volume, and ``total_pressure_loss`` relative to the stream's are on nodes and
        cells. Cells also have the fields of `bspline_mdao.grids.cells.cell_fields`: quality, height at walls, block and
        patch. Walls have the fields of the cells behind them, but their own ``Cp``. Several processes all call this,
        and the first writes.

        Parameters
        ----------
        path : path-like
            ``something.vtm`` (ParaView) or ``something.dat`` (Tecplot); the walls go to ``something_walls.vtm``.

        Raises
        ------
        InputError
            If the model has not been run, or a file cannot be written.
        """
        model = self.options["model"]
        write_fields(path, self.state, self.forces, model.topology, model.header, self._partition)

    def save_states(self, path: str | os.PathLike) -> None:
        """Save the states, for the option ``restart`` or `load_states`.

        Parameters
        ----------
        path : path-like
            HDF5 file; an existing one is replaced when the new one is complete.

        Raises
        ------
        InputError
            If the model has not been run, or the file cannot be written.
        """
        save_states(path, self.state, self.options["model"].topology, self._partition)

    def load_states(self, path: str | os.PathLike) -> None:
        """Start the next run from saved states of this grid or of another member of its family, after ``setup``.

        Parameters
        ----------
        path : path-like
            File made by `save_states`.

        Raises
        ------
        InputError
            If it is missing, damaged, not a file of states, or for another grid.
        """
        self.start_from(*load_states(path, self.comm, self.options["model"].topology, self._partition))

    def start_from(self, states: np.ndarray, alpha: float) -> None:
        """Start the next run from states, after ``setup``.

        Parameters
        ----------
        states : ndarray, shape (n_cells, 5)
            See `EulerState`; for the cells of this process.
        alpha : float
            Their angle of attack (deg).
        """
        self.state.start_from(states, alpha)
        self.state.set_val("states", states.ravel())
        if self.options["trim"]:
            self.state.set_val("alpha", alpha, units="deg")

    def _hinges(self, flow: FlowGrid) -> list[tuple[HingeMoment, np.ndarray]]:
        """The hinges, and the wall faces of the patches of each."""
        parts = []
        for hinge in self.options["hinges"]:
            is_within = np.ones(len(flow.walls.corners), dtype=bool)
            if hinge.patches is not None:
                surface = hinge.patches
                if not isinstance(surface, SurfaceGrid):
                    surface = SurfaceGrid.of(self.options["model"], surface)
                is_within[:] = False
                is_within[flow.walls.faces_on(surface.rows[surface.quads])] = True
            parts.append((hinge, is_within))
        return parts

    @fails_together
    def _pieces(self) -> tuple[Partition, np.ndarray]:
        """The distribution of the grid, and the baseline nodes of this process (m), shape (n_nodes, 3)."""
        part, partition = part_of_model(self), self.options["partition"]
        assert isinstance(part, Model)  # the option accepts nothing else
        if isinstance(partition, Subdomain):
            raise InputError(f"{self.msginfo}: a Subdomain does not know which cells others have; give its Partition")
        partition = partition or Partition.of(part.topology, self.comm.size)
        if not part.fits(partition.subdomain(self.comm.rank)):
            raise InputError(
                f"{self.msginfo}: the model belongs to another subdomain than in Partition.of(model.topology, "
                f"{self.comm.size}); give its partition"
            )
        return partition, part.local_nodes()


@documents_outputs("euler")
class EulerForces(CheckedOnProcesses, om.ExplicitComponent):
    """Coefficients of forces and moments, pressures, and far-field drag, from the states of all cells.

    ================  ======  ============  =====  =====================================================================
    name              role    shape         units  meaning
    ================  ======  ============  =====  =====================================================================
    ``states``        input   (5 n_cells)          see `EulerState`
    ``grid``          input   (3 n_nodes)   m      nodes
    ``alpha``         input   (1,)          deg    angle of attack
    ``Mach_number``   input   (1,)                 of the free stream
    {outputs}
    ``CM_...``        output  (1,)                 hinge moments
    ``loads_...``     output  (6,)                 force (m^2) and moment (m^3) of a control surface whose hinge moves,
                                                   by the dynamic pressure; about its first point on the baseline
    ================  ======  ============  =====  =====================================================================

    Wall faces are in the order of `CellFaces`.

    Options
    -------
    flow : FlowGrid
        Faces and axes.
    nodes : ndarray, shape (n_nodes, 3)
        Baseline nodes (m).
    forces : FlowForces
        What sums them, with the references.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("flow", types=FlowGrid, recordable=False, desc="faces and axes")
        self.options.declare("nodes", types=np.ndarray, recordable=False, desc="baseline nodes, m")
        self.options.declare("forces", types=FlowForces, recordable=False, desc="what sums them")

    def setup(self) -> None:
        """Declare the variables."""
        check_on_grid(self, self.options["flow"], self.options["nodes"])
        self._forces, self._is_looked_at = self.options["forces"], False
        is_distributed = self.comm.size > 1
        self.add_input("states", shape=N_STATES * self.options["flow"].faces.n_cells, distributed=is_distributed)
        self.add_input(GRID, val=self.options["nodes"].ravel(), units="m", distributed=is_distributed)
        self.add_input("alpha", units="deg", desc="angle of attack")
        self.add_input("Mach_number", desc="of the free stream")
        n_strips, n_faces = self._forces.wing.induced.strips.n_strips, len(self._forces.walls.corners)
        declare_outputs(self, "euler", {"strips": n_strips, "faces": n_faces})
        for name in self._forces.wing.moments:
            if name not in FUNCTIONALS:
                self.add_output(name, desc="hinge moment")
        for name in self._forces.wing.hinge_loads:
            self.add_output(name, shape=6, desc="force, m^2, and moment, m^3, by the dynamic pressure")

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Sum the pressures on the walls, and compute the other outputs."""
        at = _at(inputs)
        for name, value in self._forces.evaluate(*at).items():
            outputs[name] = value
        if not self._is_looked_at and not np.iscomplexobj(at[0]):
            self._is_looked_at = True
            refuse_no_induced_drag(self, self._forces)
            if is_optimised(self, "CD"):
                sources = drag_sources(self.options["flow"], self._forces, *at)
                if self.comm.rank == 0:
                    warn_of_spurious_drag(self.pathname, sources)

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if mode == "fwd":
            found = self._forces.jvp(*_at(inputs), *_directions(inputs, d_inputs))
            for name in d_outputs:
                d_outputs[name] += found[name]
        else:
            bars = self._forces.vjp(*_at(inputs), {name: d_outputs[name] for name in d_outputs})
            for name, bar, unit in zip(_INPUTS, bars, _UNITS):
                add_bar(d_inputs, name, unit * np.asarray(bar))


_INPUTS = ("states", GRID, "alpha", "Mach_number")

_UNITS = (1.0, 1.0, RADIAN, 1.0)
"""Inputs in the order of the kernel's arguments, and the kernel's units."""


def _at(inputs: Vector) -> tuple[np.ndarray, np.ndarray, float, float]:
    """States, nodes, angle (rad) and Mach number."""
    states, nodes = inputs["states"].reshape(-1, N_STATES), inputs[GRID].reshape(-1, 3)
    return states, nodes, RADIAN * inputs["alpha"][0], inputs["Mach_number"][0]


def _directions(inputs: Vector, d_inputs: Vector) -> tuple[np.ndarray, Any, float, float]:
    """Directions in all of these, zero if OpenMDAO leaves one out."""
    states = d_inputs["states"] if "states" in d_inputs else np.zeros_like(inputs["states"])
    d_alpha, d_mach = (d_inputs[name].item() if name in d_inputs else 0.0 for name in _INPUTS[2:])
    return states.reshape(-1, N_STATES), direction_in(d_inputs, inputs, GRID), RADIAN * d_alpha, d_mach
