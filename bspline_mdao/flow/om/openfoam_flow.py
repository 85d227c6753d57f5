"""The flow about a moved grid or mesh by OpenFOAM, as an OpenMDAO component."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...base.checks import as_axes
from ...core.model.movable import Movable
from ...core.om.component import (
    LastState,
    failures_as_analysis_errors,
    finite_points,
    finite_values,
    refuse_complex_step,
)
from ...core.om.model_option import Copied, declare_model
from ...errors import InputError, MovementError, ReferenceWarning, SolverError
from ...names import GRID
from ..loads.force_coefficients import check_references
from ..loads.stream import RADIAN
from ..openfoam.case_folder import CaseFolder
from ..openfoam.case_mesh import CaseMesh
from ..openfoam.flow_adjoint import CoefficientGradient, FlowAdjoint
from ..openfoam.flow_case import FlowCase
from ..openfoam.flow_run import CaseFlow, CaseResult
from ..openfoam.inviscid import InviscidCase
from .outputs import declaration
from .references import REFERENCES, declare_references

__all__ = ["OpenFoamFlow"]

SPEEDS = {"Mach_number": (0.3, None), "speed": (30.0, "m/s")}
"""Default values and units of the inputs for the speed."""


class OpenFoamFlow(Copied, om.ExplicitComponent):
    """Steady flow by an OpenFOAM solver in its own folder; each design starts from the last solution.

    The solver must be on the PATH: ``apt-get install openfoam`` on Debian. It runs on this machine. Its output goes to
    ``log.<program>`` in the folder, which also has the fields of the last design. A design that cannot be solved raises
    ``om.AnalysisError``, so that drivers take a smaller step: cells without volume, a solver that is missing, diverged,
    was killed or took too long, or residuals that stay above their tolerance.

    ================  ======  ============  =====  =====================================================================
    name              role    shape         units  meaning
    ================  ======  ============  =====  =====================================================================
    ``grid``          input   (3 n_nodes)   m      nodes of the model
    ``alpha``         input   (1,)          deg    angle of attack; 2 by default
    ``Mach_number``   input   (1,)                 of the free stream of a compressible case; 0.3 by default
    ``speed``         input   (1,)          m/s    of an incompressible case in its place; 30 by default
    ``CL``            output  (1,)                 lift coefficient
    ``CD``            output  (1,)                 drag coefficient
    ``CM``            output  (3,)                 moment coefficients about the axes of the grid
    ``Cp``            output  (n_faces)            pressure coefficients on the faces of walls
    ``Cf``            output  (n_faces, 3)         friction on the walls by the dynamic pressure, as a vector
    ``y_plus``        output  (2,)                 lowest and highest on walls; 0 without friction
    ``n_iterations``  output  (1,)                 of the solver
    ================  ======  ============  =====  =====================================================================

    Faces of walls are patch after patch. For a fitted grid they are in the order of `CellFaces`, without those that
    have collapsed to lines. Coefficients are summed here over the faces and compared with OpenFOAM's, and after the
    first solution a `ReferenceWarning` reports what looks wrong: axes, reference area, forces.

    By default there are no derivatives: let OpenMDAO take differences over a few variables, of the model or of a group
    around this component and the movement of its grid, with ``approx_totals`` (:doc:`/howto/openfoam_flow`). All
    designs of a difference start from the same solution.

    With ``derivatives="adjoint"`` the derivatives of CL, CD and CM by nodes and angle come from OpenFOAM's continuous
    adjoint, in reverse mode, with one solution of ``adjointOptimisationFoam`` for each coefficient, in a folder of its
    own in the case; for incompressible flows, laminar or with the Spalart-Allmaras model. Nodes that are on no wall
    have zeros. These are derivatives of the equations, which differ by some per cent to some tens of per cent from the
    derivatives of the solution: see :doc:`/howto/openfoam_flow` before you trust them. Derivatives by the speed are
    zero, at a fixed Reynolds number.

    Options
    -------
    model : FittedModel or MeshModel
        The fitted grid, or an unstructured mesh, with its walls.
    folder : path-like
        Folder for the case, new or empty or of an earlier run; it is kept. Only one run at a time may use it. A later
        run of the same mesh and solver starts from the solution there.
    case : FlowCase, optional
        The case to solve; an `InviscidCase` by default.
    reference_area : float
        Area of the modelled part (m^2): of the half wing, if the grid contains one half.
    reference_chord : float
        Chord for moments (m).
    moment_reference : sequence of three float
        Reference point of moments, in the axes of the grid (m).
    axes : str
        Axes of the grid that point downstream, along the span, and up.
    n_processes : int
        Number of processes for OpenFOAM, by ``mpirun``, flow and adjoint: ``decomposePar`` distributes the cells
        before, and ``reconstructPar`` merges the fields after.
    time_limit : float, optional
        Wall time of a solution (s) after which the solver is stopped.
    unconverged : {"refuse", "take"}
        What happens if residuals are above the tolerance of the case after all of its iterations: an
        ``om.AnalysisError`` names them, or the solution is accepted anyway.
    derivatives : {"none", "adjoint"}
        Whether there are derivatives, see above.
    iprint : int
        1 prints a line for each solution, 0 prints none.

    Raises
    ------
    InputError
        In ``setup``, if no patch is a wall, or there is no reference area; in a run, if another one uses the folder.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.flow import OpenFoamFlow
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> model = fit_grid(onera_m6_grid((9, 9, 7)))
    >>> flow = OpenFoamFlow(model=model, folder="m6_case", reference_area=0.75)
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("flow", flow, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("alpha", 3.0, units="deg")
    >>> problem.run_model()  # doctest: +SKIP
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            folder: str | os.PathLike[str],
            case: FlowCase | None = None,
            reference_area: float | None = None,
            reference_chord: float = 1.0,
            moment_reference: Sequence[float] = (0.0, 0.0, 0.0),
            axes: str = "xzy",
            n_processes: int = 1,
            time_limit: float | None = None,
            unconverged: Literal["refuse", "take"] = "refuse",
            derivatives: Literal["none", "adjoint"] = "none",
            iprint: int = 1,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self, desc="the fitted grid, or a mesh")
        self.options.declare(
            "folder", types=(str, os.PathLike), recordable=False, desc="folder for the case, which is kept"
        )
        self.options.declare("case", default=None, recordable=False, desc="what is solved")
        declare_references(self.options)
        self.options.declare("axes", default="xzy", desc="axes downstream, along the span, up")
        self.options.declare("n_processes", types=int, default=1, lower=1, desc="processes of OpenFOAM")
        self.options.declare("time_limit", default=None, desc="wall time of a solution, s")
        self.options.declare("unconverged", default="refuse", values=("refuse", "take"), desc="what is done with it")
        self.options.declare("derivatives", default="none", values=("none", "adjoint"), desc="of CL, CD and CM")
        self.options.declare("iprint", types=int, default=1, desc="lines for solutions")

    def setup(self) -> None:
        """Declare the variables, and find the mesh of the case."""
        if self.comm.size > 1:
            raise InputError(f"{self.msginfo}: has all of the grid, on one process; run the problem on one")
        model, case = self.options["model"], self.options["case"] or InviscidCase()
        references = tuple(self.options[name] for name in REFERENCES)
        check_references(*references)
        self._flow = CaseFlow(
            case,
            CaseMesh.of(model),
            CaseFolder(self.options["folder"]),
            as_axes(self.options["axes"], self.msginfo),
            references,
            self.options["time_limit"],
            takes_unconverged=self.options["unconverged"] == "take",
            n_processes=self.options["n_processes"],
        )
        self._adjoint = FlowAdjoint.of(self._flow) if self.options["derivatives"] == "adjoint" else None
        self._last, self._is_looked_at = LastState(), False
        self._gradients: dict[str, CoefficientGradient] = {}
        self._speed = case.speed_name
        value, units = SPEEDS[self._speed]
        self.add_input(GRID, val=self._flow.mesh.baseline.ravel(), units="m")
        self.add_input("alpha", val=2.0, units="deg", desc="angle of attack")
        self.add_input(self._speed, val=value, units=units, desc="of the free stream")
        n_faces = self._flow.walls.n_faces
        for name in ("CL", "CD", "CM", "Cp"):
            self.add_output(name, **declaration(name, {"faces": n_faces}))
        self.add_output("Cf", shape=(n_faces, 3), desc="friction on the walls by the dynamic pressure")
        self.add_output("y_plus", shape=2, desc="lowest and highest on walls")
        self.add_output("n_iterations", desc="of the solver")

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Run the solver, unless the last solution is for this design."""
        refuse_complex_step(self)
        nodes = finite_points(inputs[GRID], GRID, self.msginfo)
        state = [nodes, *(finite_values(inputs[name], name, self.msginfo) for name in ("alpha", self._speed))]
        with failures_as_analysis_errors(self, (SolverError, MovementError)):
            found: CaseResult = self._last.at(state, self._solve)
        loads = found.loads
        outputs["CL"], outputs["CD"], outputs["CM"] = loads.CL, loads.CD, loads.CM
        outputs["Cp"], outputs["Cf"] = loads.Cp, loads.Cf
        outputs["y_plus"], outputs["n_iterations"] = found.y_plus, found.convergence.n_iterations

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the transpose, by an adjoint solution for each coefficient; refuse where zeros would be misleading."""
        if self._adjoint is None:
            raise InputError(
                f"{self.msginfo}: has no derivatives; give it derivatives='adjoint', or call approx_totals() on the "
                f"model, or on a group around this and what moves its grid, with few variables"
            )
        others = [name for name in d_outputs if name.split(".")[-1] not in ("CL", "CD", "CM")]
        if mode == "fwd" or any(d_outputs[name].any() for name in others):
            raise InputError(
                f"{self.msginfo}: the adjoint has derivatives of CL, CD and CM in reverse mode only; set up the "
                f"problem with mode='rev', and take no derivatives of other outputs"
            )
        nodes, alpha, speed = (np.array(inputs[name]) for name in (GRID, "alpha", self._speed))
        found = self._last.at([nodes.reshape(-1, 3), alpha, speed], self._solve)
        for name, part in (("CL", 0), ("CD", 0), ("CM", 0), ("CM", 1), ("CM", 2)):
            bar = d_outputs[name][part] if name in d_outputs else 0.0
            if bar == 0.0:
                continue
            which = name + ("xyz"[part] if name == "CM" else "")
            if which not in self._gradients:
                with failures_as_analysis_errors(self, (SolverError,)):
                    self._gradients[which] = self._adjoint.gradient(
                        which, RADIAN * alpha.item(), speed.item(), found.loads
                    )
            gradient = self._gradients[which]
            if GRID in d_inputs:
                d_inputs[GRID] += bar * gradient.nodes.ravel()
            if "alpha" in d_inputs:
                d_inputs["alpha"] += bar * RADIAN * gradient.alpha

    def _solve(self, nodes: np.ndarray, alpha: np.ndarray, speed: np.ndarray) -> CaseResult:
        self._gradients = {}
        if self._adjoint is not None:
            self._last.points = None  # the folder has this design from here on, even if it fails
        found = self._flow.solve(nodes, RADIAN * alpha.item(), speed.item(), not self.under_finite_difference)
        if self.options["iprint"]:
            print(
                f"{self.msginfo}: {self._flow.case.program}, {found.convergence.n_iterations} iterations, "
                f"CL {found.loads.CL:.5f}, CD {found.loads.CD:.5f}, {found.seconds:.1f} s"
            )
        if not self._is_looked_at:
            self._is_looked_at = True
            for doubt in found.doubts:
                warnings.warn(f"{self.msginfo}: {doubt}", ReferenceWarning, stacklevel=2)
        return found
