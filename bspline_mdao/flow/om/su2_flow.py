"""The flow about a grid or a mesh by SU2, as an OpenMDAO component by files, with SU2's discrete adjoint.

How to: ``docs/howto/su2.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...core.model.movable import Movable
from ...core.om.check_directions import check_along_directions
from ...core.om.component import (
    LastState,
    add_bar,
    failures_as_analysis_errors,
    finite_points,
    finite_values,
    refuse_complex_step,
)
from ...core.om.model_option import Copied, declare_model
from ...errors import InputError, SolverError
from ...names import GRID
from ..loads.force_coefficients import check_references
from ..su2.case import Gradient, Su2Case, Su2Point, Su2Solution
from ..su2.config import Su2Config
from ..su2.frame import Su2Frame
from ..su2.mesh_text import MeshToFly, Su2Mesh
from ..su2.wall_pressures import WallPressures
from .derivative_mode import outputs_downstream
from .references import REFERENCES, declare_references

__all__ = ["Su2Flow"]

CHECK_STEP = 1e-5
"""Step of ``check_partials`` in all inputs: flows are converged to about 1e-10, and change over a length of order 1."""


class Su2Flow(Copied, om.ExplicitComponent):
    """Steady compressible flow by SU2, viscous or inviscid, run in a case folder, and its discrete adjoint.

    SU2 is a separate program, version 7 or 8; ``SU2_CFD`` must be on the PATH and, for derivatives, ``SU2_CFD_AD``.
    Derivatives by the nodes are SU2's sensitivities of all nodes, exact for its discrete flow; they do not pass through
    its own mesh deformation. Lift and drag take two adjoint solutions together, each moment takes one.

    ================  ======  ==========  =====  =======================================================================
    name              role    shape       units  meaning
    ================  ======  ==========  =====  =======================================================================
    ``grid``          input   (3 n)       m      nodes of the grid or mesh, xyz interleaved
    ``alpha``         input   (1,)        deg    angle of attack; 2 by default
    ``Mach_number``   input   (1,)               of the free stream; 0.3 by default
    ``CL``, ``CD``    output  (1,)               lift and drag of pressure and friction
    ``CM``            output  (3,)               moments about the axes of the grid through the reference point; of a
                                                 mesh of two dimensions that across its plane alone, the others are 0
    ``Cp``            output  (n_wall,)          pressure coefficients at ``wall_nodes``; discrete, without derivatives
    ================  ======  ==========  =====  =======================================================================

    A two-dimensional mesh is solved in two dimensions: coefficients are per unit span, and the nodes of its first plane
    count. For a node that blocks share, the first row in the grid counts for all. The first flow is checked: forces
    must agree with SU2's own pressures on the walls, at the given reference values and axes.

    A flow starts from the last one in its folder. If it fails, does not converge or takes too long, the run raises
    ``om.AnalysisError`` with the last lines of SU2's log, so that a driver takes a smaller step.

    Options
    -------
    model : FittedModel or MeshModel
        The fitted grid, with its patches, or an unstructured mesh.
    reference_area : float
        Area of the modelled part (m^2): of the half wing, if the grid contains one half; chord times 1 m in two
        dimensions.
    reference_chord : float
        Chord for moments (m).
    moment_reference : sequence of three float
        Reference point of moments, in the axes of the grid (m).
    axes : str
        Axes of the grid that point downstream, along the span, and up; in two dimensions the second is normal to the
        plane.
    config : path-like, optional
        Configuration of SU2: solver, turbulence, schemes and convergence. The keys that a run sets are replaced in a
        copy, and named by the logger ``bspline_mdao``. By default the Euler equations with a Roe scheme.
    case : path-like
        Folder of the runs, ``su2_case`` by default, which is kept: meshes, configurations, logs, results. Components
        that run at the same time need one each.
    n_processes : int
        Number of processes for SU2, by ``mpirun``.
    time_limit : float, optional
        For each run (s).
    needs_convergence : bool
        Whether a run that reaches its last iteration counts as failed.
    warm_start : bool
        Whether a flow starts from the last one in the folder.
    program, adjoint_program : str
        Names of the executables.

    Raises
    ------
    InputError
        In ``setup``, if there is no reference area, the mesh has cells that SU2 does not support, or the configuration
        does not fit; in the first run, if forces and pressures do not agree, or ``Mach_number`` is a design variable
        but the configuration ties other properties of the stream to it; its derivatives are NaN then.
    om.AnalysisError
        In a run, if SU2 is missing or fails.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.flow import Su2Flow
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> model = fit_grid(onera_m6_grid((9, 8, 7)))
    >>> flow = Su2Flow(model=model, reference_area=0.75, time_limit=600.0)
    >>> problem = om.Problem(reports=None)
    >>> _ = problem.model.add_subsystem("flow", flow, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.run_model()  # doctest: +SKIP
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            reference_area: float | None = None,
            reference_chord: float = 1.0,
            moment_reference: Sequence[float] = (0.0, 0.0, 0.0),
            axes: str = "xzy",
            config: str | os.PathLike[str] | None = None,
            case: str | os.PathLike[str] = "su2_case",
            n_processes: int = 1,
            time_limit: float | None = None,
            needs_convergence: bool = True,
            warm_start: bool = True,
            program: str = "SU2_CFD",
            adjoint_program: str = "SU2_CFD_AD",
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        declare_references(self.options)
        self.options.declare("axes", default="xzy", desc="axes downstream, along the span, up")
        self.options.declare("config", default=None, desc="configuration of SU2")
        self.options.declare("case", default="su2_case", desc="folder of the runs")
        self.options.declare("n_processes", types=int, default=1, lower=1, desc="processes of SU2")
        self.options.declare("time_limit", types=(int, float), default=None, allow_none=True, desc="of each run, s")
        self.options.declare("needs_convergence", types=bool, default=True, desc="the last iteration is a failure")
        self.options.declare("warm_start", types=bool, default=True, desc="start from the last flow in the folder")
        self.options.declare("program", types=str, default="SU2_CFD", desc="name of the solver")
        self.options.declare("adjoint_program", types=str, default="SU2_CFD_AD", desc="name of the adjoint solver")

    def setup(self) -> None:
        """Take the mesh, check the configuration, and declare the variables."""
        if self.comm.size > 1:
            raise InputError(f"{self.msginfo}: runs on one process of OpenMDAO; give n_processes to SU2 itself")
        options, model = self.options, self.options["model"]
        check_references(*(options[name] for name in REFERENCES))
        self._flown = MeshToFly.of(model)
        self._frame = Su2Frame.of(options["axes"], self._flown.across, self.msginfo)
        self._pressures = WallPressures.of(self._flown)
        self._config = Su2Config.read(options["config"])
        self._config.check(self._flown.walls)
        self._case, self._solution, self._is_looked_at = self._of_case(), LastState(), False
        self._gradients: dict[str, Gradient] = {}
        nodes = model.node_map.nodes[: model.node_map.n_asked]
        self.add_input(GRID, val=nodes.ravel(), units="m")
        self.add_input("alpha", val=2.0, units="deg", desc="angle of attack")
        self.add_input("Mach_number", val=0.3, desc="of the free stream")
        self.add_output("CL", desc="lift")
        self.add_output("CD", desc="drag")
        self.add_output("CM", shape=3, desc="moments about the axes of the grid")
        self.add_discrete_output("Cp", np.zeros(len(self._pressures.nodes)), desc="pressure coefficients at wall_nodes")
        check_along_directions(self, CHECK_STEP)

    @property
    def wall_nodes(self) -> np.ndarray:
        """Rows in ``grid`` of the nodes of ``Cp``, after ``setup``."""
        return self._flown.rows[self._pressures.nodes]

    def compute(self, inputs: Vector, outputs: Vector, discrete_inputs: dict, discrete_outputs: dict) -> None:
        """Run SU2."""
        refuse_complex_step(self)
        solution = self._solution_at(inputs)
        outputs["CL"], outputs["CD"] = solution.values["CL"], solution.values["CD"]
        outputs["CM"] = sum(
            solution.values[f"CM{key[-1].lower()}"] * row for key, row in self._frame.moment_rows.items()
        )
        surface = solution.surface
        at = np.searchsorted(surface.nodes, self._pressures.nodes)
        discrete_outputs["Cp"] = surface.column("Pressure_Coefficient")[at]

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose, by the required adjoints."""
        refuse_complex_step(self)
        if not any(name in d_inputs for name in INPUTS):
            return
        parts = [
            (name, entry, part)
            for name, of_output in self._parts(inputs).items()
            if name in d_outputs
            for entry, part in enumerate(of_output)
        ]
        if mode == "fwd":
            for name, entry, part in parts:
                for each, bar in self._bars(inputs, part).items():
                    if each in d_inputs and d_inputs[each].any():  # the others may be NaN
                        d_outputs[name][entry] += np.vdot(bar, d_inputs[each])
            return
        seeded = _Part.sum_of([(d_outputs[name][entry], part) for name, entry, part in parts])
        for name, bar in self._bars(inputs, seeded).items():
            add_bar(d_inputs, name, bar)

    def _parts(self, inputs: Vector) -> dict[str, list[_Part]]:
        """The parts of every entry of every output."""
        frame, values = self._frame, self._solution_at(inputs).values
        weights, by_alpha = frame.lift_and_drag(inputs["alpha"].item())
        forces = np.array([values[f"CF{key[-1].lower()}"] for key in frame.force_keys])
        drag, lift = (
            _Part(dict(zip(frame.force_keys, of_axes)), float(change @ forces))
            for of_axes, change in zip(weights, by_alpha)
        )
        rows = frame.moment_rows
        moments = [_Part({key: row[axis] for key, row in rows.items()}, 0.0) for axis in range(3)]
        return {"CD": [drag], "CL": [lift], "CM": moments}

    def _bars(self, inputs: Vector, part: _Part) -> dict[str, np.ndarray]:
        """Derivatives by all inputs."""
        point, nodes = self._point(inputs), inputs[GRID].reshape(-1, 3)[self._flown.rows]
        on_file, by_alpha = np.zeros_like(nodes), part.by_alpha
        by_mach = 0.0 if self._config.mach_is_alone else np.nan
        with failures_as_analysis_errors(self, (SolverError,)):
            for objective, weight in part.weights.items():
                if weight != 0.0:
                    gradient = self._gradients.get(objective) or self._case.gradient(nodes, point, objective)
                    self._gradients[objective] = gradient
                    on_file += weight * gradient.nodes @ self._frame.rows
                    by_alpha += weight * gradient.alpha
                    by_mach += weight * gradient.mach
        on_grid = np.zeros((inputs[GRID].size // 3, 3))
        on_grid[self._flown.rows] = on_file
        return {GRID: on_grid.ravel(), "alpha": np.array([by_alpha]), "Mach_number": np.array([by_mach])}

    def _solution_at(self, inputs: Vector) -> Su2Solution:
        """The flow at inputs."""
        arrays = [finite_values(inputs[name], name, self.pathname) for name in INPUTS[1:]]
        with failures_as_analysis_errors(self, (SolverError,)):
            nodes = finite_points(inputs[GRID], GRID, self.pathname)
            return self._solution.at([nodes, *arrays], self._solve)

    def _solve(self, nodes: np.ndarray, alpha: np.ndarray, mach: np.ndarray) -> Su2Solution:
        """Run SU2, and check the results of its first run."""
        on_file = nodes[self._flown.rows]
        solution = self._case.solve(on_file, Su2Point(float(mach[0]), float(alpha[0])))
        if not self._is_looked_at:
            whole = self._flown.on_mesh(nodes)
            references = float(alpha[0]), float(self.options["reference_area"]), self._config.is_viscous
            if not self._config.mach_is_alone and self._varies("Mach_number"):
                raise InputError(
                    f"{self.msginfo}: Mach_number is a design variable, or depends on one, but {self._config.source} "
                    f"ties the density of the stream to its Reynolds number, and SU2's derivative is at a fixed "
                    f"density; set INIT_OPTION= TD_CONDITIONS, or leave Mach_number out of the variables"
                )
            self._pressures.check(whole, solution.surface, solution.values, self._frame, *references, self.msginfo)
            self._is_looked_at = True
        self._gradients = {}
        return solution

    def _varies(self, name: str) -> bool:
        """Whether an input is a design variable of the problem, or depends on one."""
        model = self._problem_meta["model_ref"]()
        variables = {meta["source"] for meta in model.get_design_vars(get_sizes=False).values()}
        source = model.get_source(f"{self.pathname}.{name}")
        return source in outputs_downstream(model, variables)

    def _point(self, inputs: Vector) -> Su2Point:
        return Su2Point(inputs["Mach_number"].item(), inputs["alpha"].item())

    def _of_case(self) -> Su2Case:
        """The case for the options."""
        options, walls = self.options, f"( {', '.join(self._flown.walls)} )"
        about = np.asarray(options["moment_reference"], dtype=float)
        settings: dict[str, object] = {
            **self._frame.references(options["reference_area"], options["reference_chord"], about),
            **self._config.boundaries(self._flown.kinds),
            "MARKER_PLOTTING": walls,
        }
        if "MARKER_MONITORING" not in self._config.values:
            settings["MARKER_MONITORING"] = walls
        return Su2Case(
            Path(options["case"]).absolute(),  # the same if the process changes its working directory
            self._config,
            Su2Mesh.of(self._flown, self._frame),
            settings,
            program=options["program"],
            adjoint_program=options["adjoint_program"],
            n_processes=options["n_processes"],
            time_limit=options["time_limit"],
            needs_convergence=options["needs_convergence"],
            starts_warm=options["warm_start"],
        )


INPUTS = (GRID, "alpha", "Mach_number")


@dataclass(frozen=True)
class _Part:
    """Forces and moments of SU2 that make up an output, and its explicit dependence on the angle of attack."""

    weights: dict[str, float]  # by names of objectives
    by_alpha: float  # 1/deg

    @classmethod
    def sum_of(cls, parts: Sequence[tuple[float, _Part]]) -> _Part:
        """Sum of parts with factors."""
        weights: dict[str, float] = {}
        for factor, part in parts:
            for name, weight in part.weights.items():
                weights[name] = weights.get(name, 0.0) + factor * weight
        return cls(weights, sum(factor * part.by_alpha for factor, part in parts))
