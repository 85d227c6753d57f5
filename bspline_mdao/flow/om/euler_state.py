"""The steady Euler equations as an OpenMDAO component.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import openmdao.api as om
from openmdao.jacobians.jacobian import Jacobian
from openmdao.utils.options_dictionary import OptionsDictionary
from openmdao.vectors.vector import Vector

from ...base.numerics.processes import largest, summed_number
from ...base.numerics.progress import Progress, progress_bar
from ...core.om.check_directions import check_along_directions
from ...core.om.checked_along_edges import check_along_edges, numbered_blocks
from ...core.om.component import (
    SMOOTH_STEP,
    CheckedOnProcesses,
    add_bar,
    central_step,
    direction_in,
    fails_together,
    finite_points,
    finite_values,
    refuse_complex_step,
)
from ...errors import InputError
from ...names import GRID
from ..euler.adjoint import FlowTangent
from ..euler.cold_start import cold_solutions
from ..euler.flow_grid import FlowGrid
from ..euler.forces import FlowForces
from ..euler.gas import N_STATES, free_stream, free_stream_partials, mach_numbers
from ..euler.krylov import KrylovSolution
from ..euler.linearization import Linearization
from ..euler.modified_newton import solve_nearby
from ..euler.newton import FlowSolution, relative_residual, solve_flow
from ..euler.newton_step import NewtonStep
from ..euler.residual import Discretization
from ..loads.stream import RADIAN
from .derivative_mode import warn_of_derivative_mode
from .mach_range import EULER, warn_of_mach_number
from .residual_log import ResidualLog

INPUTS = (GRID, "alpha", "Mach_number")


STATES_STEP = 1e-6
"""Step of differences by the states. For a cylinder at Mach 0.1 and 40 random directions, those of the entropy drag
have relative errors of up to 3e-6 for 1e-5, 3e-8 for 1e-6, and 1e-6 for 1e-8."""

MACH_STEP = 1e-7
"""Step of differences by the Mach number: coefficients are divided by up to its cube. For a cylinder at 0.1, with
frozen states, central differences of the entropy drag with a step of 1e-5 have relative errors of 4e-4."""

SHARPNESS = 30.0
"""Edges of the grid divided by the lengths over which residuals change, for `check_along_edges`: wave speeds are
rounded at a twentieth of the speed of sound where the flow is along a face."""

LARGEST_RESIDUAL = 1e-8
"""Residual, relative to the uniform stream's, below which a flow that no longer converges is accepted."""


class EulerState(CheckedOnProcesses, om.ImplicitComponent):
    """Solve the steady Euler equations on the cells of a grid.

    ===============  ======  ============  =====  ======================================================================
    name             role    shape         units  meaning
    ===============  ======  ============  =====  ======================================================================
    ``grid``         input   (3 n_nodes)   m      nodes, blocks in file order, each in C order of (i, j, k)
    ``alpha``        input   (1,)          deg    angle of attack
    ``Mach_number``  input   (1,)                 of the free stream
    ``states``       output  (5 n_cells)          density, velocity and pressure of every cell, relative to density and
                                                  speed of sound of the free stream; its residual is the outflow divided
                                                  by the surface of the cell on the baseline
    ===============  ======  ============  =====  ======================================================================

    On several processes ``grid`` and ``states`` are distributed: each has the nodes and the cells of its pieces, see
    `Partition`.

    A run starts from the current states, usually the last design's, unless the uniform stream is closer. If they are
    still the last solution, they are changed with the free stream. Steps first use the Jacobian of the last
    derivatives, as long as it suffices. If that fails, and in a first run, it starts from the flow on coarser members
    of the grid or the uniform stream (with long time steps, if cells at walls are flat or the coarser members needed
    many steps), and then with the other kind of time steps.

    Options
    -------
    flow : FlowGrid
        The grid's faces, the scheme and the preconditioner.
    levels : list of CoarseLevel
        Coarser members of the grid to start on; by default none.
    nodes : ndarray, shape (n_nodes, 3)
        Baseline nodes of this process (m).
    tolerance : float
        Residual, relative to the uniform stream's, at which a run ends.
    linear_tolerance : float
        Residual of the linear systems of derivatives, relative to their right-hand sides, or to rounding. The error of
        totals of lift, drag and moments is ten times that, of the entropy drag four digits more.
    max_steps : int
        Largest number of Newton steps.
    iprint : int
        0 and below for no output, 1 for a line per solution, 2 for one per Newton step as well. ``set_solver_print`` of
        a problem or a group sets it as for solvers.
    anchored : bool
        Whether every run starts from the solution of the last derivatives instead of the last run. If a design has
        several flows, small steps of an optimiser then stay with the flow of the point they start from.
    forces : FlowForces
        Provides lift and drag for these lines.

    Raises
    ------
    om.AnalysisError
        In a run, if an input is not finite, the Mach number not positive or the volume of a cell negative, or if the
        residual does not fall below 1e-8, with its history; with derivatives, if it is not below that, or a linear
        system cannot be solved.
    InputError
        In a run under complex step; products can be checked by complex steps.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("flow", types=FlowGrid, recordable=False, desc="faces, scheme and preconditioner")
        self.options.declare("levels", default=[], types=list, recordable=False, desc="coarser members to start on")
        self.options.declare("nodes", types=np.ndarray, recordable=False, desc="baseline nodes, m")
        self.options.declare("forces", types=FlowForces, recordable=False, desc="lift and drag of states")
        declare_solver(self.options)

    _start: tuple[np.ndarray, float] | None = None

    _anchor: dict[str, np.ndarray] | None = None

    _solution: Any
    _converged: Any
    _tangent: Any
    _tangent_point: Any
    _last_scheme: tuple[np.ndarray, Discretization] | None = None

    def start_from(self, states: np.ndarray, alpha: float) -> None:
        """Set states to start from, shape (n_cells, 5), and their angle of attack (deg)."""
        self._start = states, alpha

    def setup(self) -> None:
        """Declare the variables."""
        flow, nodes = self.options["flow"], self.options["nodes"]
        check_in_flow(self)
        if self.comm.size == 1:  # it is left out on several
            shapes = [tuple(1 + n for n in cells) for cells in flow.faces.layout.shapes]
            check_along_edges(self, GRID, numbered_blocks(shapes), SHARPNESS, digits=None, is_complex=True)
        self._solution = self._converged = self._anchor = self._last_scheme = None
        self._tangent = self._tangent_point = None
        self._is_mode_looked_at = self._is_mach_said = False
        is_distributed = self.comm.size > 1
        # residuals are of the size of the states in any unit of length: checks of derivatives compare absolute values
        self._surfaces = flow.discretization.sizes(flow.areas(nodes))
        self.add_input(GRID, val=nodes.ravel(), units="m", distributed=is_distributed, desc="nodes")
        self._declare_angle()
        self.add_input("Mach_number", desc="of the free stream")
        at_rest = flow.discretization.uniform(free_stream(0.0, 0.0, flow.axes))
        start = at_rest if self._start is None else self._start[0]
        self.add_output(
            "states", val=start.ravel(), distributed=is_distributed, desc="density, velocity, pressure of cells"
        )

    def apply_nonlinear(self, inputs: Vector, outputs: Vector, residuals: Vector) -> None:
        """Sum the outflow of every cell, by its surface."""
        states = outputs["states"].reshape(-1, N_STATES)
        outflow = self._scheme(inputs).residual(states, *self._at(inputs))
        residuals["states"] = (outflow / self._surfaces).ravel()

    def solve_nonlinear(self, inputs: Vector, outputs: Vector) -> None:
        """Solve for the states, from the current ones or from scratch."""
        self._log = ResidualLog(self.pathname, self.options["forces"], self.comm)
        self._return_to_anchor(inputs, outputs)
        self._solve(inputs, outputs, self.options["tolerance"])
        self._warn_of(self._solution)

    def _declare_angle(self) -> None:
        """Declare the angle of attack."""
        self.add_input("alpha", units="deg", desc="angle of attack")

    def _solve(self, inputs: Vector, outputs: Vector, tolerance: float) -> None:
        """Solve for the states at the inputs, or raise."""
        self._check(inputs)
        if not self._is_mach_said and self.comm.rank == 0:
            self._is_mach_said = warn_of_mach_number(self.pathname, float(inputs["Mach_number"][0]), EULER)
        areas, stream = self._at(inputs)
        self._solution = None
        with progress_bar("flow") as report:
            for solution in self._attempts(inputs, outputs, areas, stream, tolerance, report):
                if self._solution is None or solution.residual < self._solution.residual:
                    self._solution = solution  # the best one is reported
                if solution.residual <= max(tolerance, LARGEST_RESIDUAL):
                    self._converged = solution
                    outputs["states"] = solution.states.ravel()
                    return
        field = self._scheme(inputs), areas, stream
        raise om.AnalysisError(
            f"{self.msginfo}: {self._advised(f'{_complaint(self._solution)}; {self._worst_cell(*field)}', inputs)}, or "
            f"a finer or more even grid"
        )

    def _advised(self, complaint: str, inputs: Vector) -> str:
        """Complaint of a flow that did not converge, with what to do."""
        return f"{complaint}; take a smaller angle or Mach number"

    def linearize(self, inputs: Vector, outputs: Vector, jacobian: Jacobian) -> None:
        """Refuse states that are not a solution, and differentiate the residual."""
        if not self._is_mode_looked_at:
            self._is_mode_looked_at = True
            warn_of_derivative_mode(self, "states")
        self._tangent_at_solution(inputs, outputs)

    def apply_linear(
        self, inputs: Vector, outputs: Vector, d_inputs: Vector, d_outputs: Vector, d_residuals: Vector, mode: str
    ) -> None:
        """Apply the Jacobian of the residual at these inputs and states, or its transpose."""
        if "states" not in d_residuals:
            return
        linearization = self._tangent_at(inputs, outputs).linearization
        if mode == "fwd":
            self._forward(linearization, inputs, d_inputs, d_outputs, d_residuals)
        else:
            self._reverse(linearization, inputs, d_inputs, d_outputs, d_residuals)

    def solve_linear(self, d_outputs: Vector, d_residuals: Vector, mode: str) -> None:
        """Solve with the Jacobian at the current inputs and states, or with its transpose: the adjoint."""
        with self._unscaled_context(outputs=[self._outputs]):  # OpenMDAO scales them here, and passes none
            tangent = self._tangent_at_solution(self._inputs, self._outputs)
            self._drop_anchor()
        right, out = (d_residuals, d_outputs) if mode == "fwd" else (d_outputs, d_residuals)
        self._put(out, self._solved(tangent, self._right_side(right, mode), mode), mode)

    def _right_side(self, right: Vector, mode: str) -> np.ndarray:
        """Right-hand side of the linear system of the outflow, or of its transpose."""
        states = right["states"].reshape(-1, N_STATES)
        return states * self._surfaces if mode == "fwd" else states

    def _put(self, out: Vector, solution: np.ndarray, mode: str) -> None:
        """Set the solution of that system."""
        out["states"] = (solution if mode == "fwd" else solution * self._surfaces).ravel()

    def _solved(self, tangent: FlowTangent, right: np.ndarray, mode: str, tolerance: float | None = None) -> np.ndarray:
        """Solve with the Jacobian of the outflow by the states, or its transpose."""
        solve = tangent.solve if mode == "fwd" else tangent.solve_transposed
        return self._accepted(solve(right, tolerance or self.options["linear_tolerance"]))

    def _drop_anchor(self) -> None:
        """Keep the solution for the next runs, if they are to start from it."""
        if self.options["anchored"]:
            self._anchor = {name: self._outputs[name].copy() for name in self._outputs}

    def _return_to_anchor(self, inputs: Vector, outputs: Vector) -> None:
        """Set the outputs to the initial solution, unless they are a solution themselves, such as a restored one."""
        if self._anchor is None:
            return
        states = outputs["states"].reshape(-1, N_STATES)
        if not relative_residual(self._scheme(inputs), states, *self._at(inputs)) <= LARGEST_RESIDUAL:
            for name, value in self._anchor.items():
                outputs[name] = value

    def _accepted(self, solution: KrylovSolution, tolerance: float | None = None) -> np.ndarray:
        """Solution of a linear system, if it is one, to a tolerance or the tolerance of the options."""
        if not solution.is_converged:
            raise om.AnalysisError(
                f"{self.msginfo}: the linear system of the derivatives is not solved to "
                f"{tolerance or self.options['linear_tolerance']:g} by {solution.n_products} products; allow a larger "
                f"one"
            )
        return solution.x

    def adjoint(self, bar: np.ndarray, tolerance: float) -> np.ndarray:
        """Adjoint, shape (n_cells, 5), of a functional of the states at a given angle, at the current solution.

        ``bar``, shape (n_cells, 5), are the functional's derivatives by the states; the residual is relative to it.
        """
        with self._unscaled_context(outputs=[self._outputs]):
            tangent = self._tangent_at_solution(self._inputs_of_flow(), self._outputs)
        return self._accepted(tangent.solve_transposed(bar, tolerance), tolerance)

    def _inputs_of_flow(self) -> Any:
        """Grid, angle and Mach number, by name."""
        return self._inputs

    @property
    def solution(self) -> FlowSolution | None:
        """The last solution, with its history; None before the first run."""
        return self._solution

    def _forward(
        self, linearization: Linearization, inputs: Vector, d_inputs: Vector, d_outputs: Vector, d_residuals: Vector
    ) -> None:
        change = np.zeros((self._discretization.faces.n_cells, N_STATES))
        if "states" in d_outputs:
            change += linearization.state_jvp(d_outputs["states"].reshape(-1, N_STATES))
        if GRID in d_inputs:
            nodes, d_nodes = inputs[GRID].reshape(-1, 3), direction_in(d_inputs, inputs, GRID)
            change += self.options["flow"].nodes_jvp(nodes, linearization, d_nodes)
        for name, d_stream in self._stream_partials(inputs).items():
            if name in d_inputs:
                change += linearization.stream_jvp(d_stream * d_inputs[name])
        d_residuals["states"] += (change / self._surfaces).ravel()

    def _reverse(
        self, linearization: Linearization, inputs: Vector, d_inputs: Vector, d_outputs: Vector, d_residuals: Vector
    ) -> None:
        bar = d_residuals["states"].reshape(-1, N_STATES) / self._surfaces
        if "states" in d_outputs:
            d_outputs["states"] += linearization.state_vjp(bar).ravel()
        if GRID in d_inputs:
            nodes = inputs[GRID].reshape(-1, 3)
            add_bar(d_inputs, GRID, self.options["flow"].nodes_vjp(nodes, linearization, bar))
        for name, d_stream in self._stream_partials(inputs).items():
            if name in d_inputs:
                d_inputs[name] += d_stream @ linearization.stream_vjp(bar)

    def _tangent_at_solution(self, inputs: Vector, outputs: Vector) -> FlowTangent:
        """Derivatives of the residual at a solution; at other states they have no meaning for the flow."""
        states = outputs["states"].reshape(-1, N_STATES)
        residual = relative_residual(self._scheme(inputs), states, *self._at(inputs))
        if not residual <= LARGEST_RESIDUAL:
            raise om.AnalysisError(
                f"{self.msginfo}: no derivatives at a residual of {residual:.1e} relative to the uniform "
                f"stream's; run the model first, to {LARGEST_RESIDUAL:g}"
            )
        return self._tangent_at(inputs, outputs)

    def _tangent_at(self, inputs: Vector, outputs: Vector) -> FlowTangent:
        """Derivatives of the residual: the last ones if they are at these inputs and states."""
        point = (outputs["states"], *(inputs[name] for name in INPUTS))
        if self._tangent is None or not self._everywhere(all(map(np.array_equal, point, self._tangent_point))):
            self._tangent = None  # free memory for the next
            self._tangent_point = tuple(map(np.array, point))
            states, pattern = self._tangent_point[0].reshape(-1, N_STATES), self.options["flow"].pattern
            areas, stream = self._at(inputs)
            self._tangent = FlowTangent.of(self._scheme(inputs), states, areas, stream, pattern)
        return self._tangent

    @property
    def _discretization(self) -> Discretization:
        return self.options["flow"].discretization

    def _scheme(self, inputs: Vector) -> Discretization:
        """Discretisation with the weights of the current grid, computed once per design."""
        flow, nodes = self.options["flow"], inputs[GRID].reshape(-1, 3)
        if self._everywhere(np.array_equal(nodes, self.options["nodes"])):
            return flow.discretization
        if self._last_scheme is None or not self._everywhere(np.array_equal(nodes, self._last_scheme[0])):
            self._last_scheme = None  # free memory for the next
            self._last_scheme = nodes.copy(), flow.at(nodes)
        return self._last_scheme[1]

    def _at(self, inputs: Vector) -> tuple[np.ndarray, np.ndarray]:
        """Area vectors and free stream."""
        flow = self.options["flow"]
        stream = free_stream(inputs["Mach_number"][0], RADIAN * inputs["alpha"][0], flow.axes)
        return flow.areas(inputs[GRID].reshape(-1, 3)), stream

    def _check(self, inputs: Vector) -> None:
        """Refuse unusable flows."""
        self._check_numbers(inputs)
        nodes = inputs[GRID].reshape(-1, 3)
        try:
            self.options["flow"].require_volumes(nodes)
        except InputError as error:
            raise om.AnalysisError(
                f"{self.msginfo}: {error}; take a smaller step, or keep them out by a lower bound of 'corner_ks'"
            ) from error

    @fails_together
    def _check_numbers(self, inputs: Vector) -> None:
        """Refuse inputs that are not numbers of a flow."""
        refuse_complex_step(self)
        finite_points(inputs[GRID], GRID, self.msginfo)
        finite_values(inputs["alpha"], "alpha", self.msginfo)
        if not 0.0 < inputs["Mach_number"][0] < np.inf:
            raise om.AnalysisError(f"{self.msginfo}: Mach_number is {inputs['Mach_number'][0]}; it has to be positive")

    def _worst_cell(self, discretization: Discretization, areas: np.ndarray, stream: np.ndarray) -> str:
        """Name the cell with the largest residual per surface, and its Mach number: the same on all processes."""
        states = self._solution.states
        rows = discretization.residual(states, areas, stream) / discretization.sizes(areas)
        sizes, found = np.linalg.norm(rows, axis=1), (-1.0, "")
        if len(sizes):
            cell = int(np.argmax(sizes))
            mach = mach_numbers(states[cell : cell + 1])[0]
            place = discretization.faces.place(cell)
            found = float(sizes[cell]), f"it is largest in {place}, where the Mach number is {mach:.2g}"
        return max(self.comm.allgather(found) if self.comm.size > 1 else [found])[1]

    def _everywhere(self, flag: bool) -> bool:
        """Whether something is true on all processes."""
        return not largest(self.comm, float(not flag))

    def _supersonic(self, states: np.ndarray) -> str:
        """Advise a shock sensor if there is none and the flow is supersonic."""
        n_supersonic = int(summed_number(self.comm, int(np.count_nonzero(mach_numbers(states) > 1.0))))
        is_missing = n_supersonic and not self._discretization.shock_threshold
        return f"; it is supersonic in {n_supersonic} cells, set shock_threshold" if is_missing else ""

    def _last_states(self, outputs: Vector, stream: np.ndarray) -> np.ndarray:
        """Current states, with the change of the free stream since they were solved for, if they were."""
        states, last = outputs["states"].reshape(-1, N_STATES), self._converged
        is_solved = last is not None and self._everywhere(np.array_equal(states, last.states))
        return states + (stream - last.stream) if is_solved else states.copy()

    def _stream_partials(self, inputs: Vector) -> dict[str, np.ndarray]:
        """Derivatives of the free stream with respect to the inputs, by name."""
        axes = self.options["flow"].axes
        d_stream_d_mach, d_stream_d_alpha = free_stream_partials(
            inputs["Mach_number"][0], RADIAN * inputs["alpha"][0], axes
        )
        return {"Mach_number": d_stream_d_mach, "alpha": RADIAN * d_stream_d_alpha}

    def _attempts(
        self, inputs: Vector, outputs: Vector, areas: np.ndarray, stream: np.ndarray, tolerance: float, report: Progress
    ) -> Iterator[FlowSolution]:
        """Yield solutions, each by a more robust method than the last."""
        flow, levels = (self.options[name] for name in ("flow", "levels"))
        settings = {"tolerance": tolerance, "max_steps": self.options["max_steps"]}
        settings["progress"] = self._progress(inputs, tolerance, report)
        scheme, settings["pattern"] = self._scheme(inputs), flow.pattern
        field, starts = (scheme, areas, stream), (self._last_states(outputs, stream), scheme.uniform(stream))
        # the plain norm, mainly of the far field, shows whether states match the stream; gas at rest does not
        norms = [scheme.norm(scheme.residual(start, areas, stream)) for start in starts]
        if norms[0] < norms[1]:
            yield self._from_nearby(inputs, outputs, field, starts[0], settings)
        elif self._is_given(outputs):  # of a member of the family, say, with another far field
            yield solve_flow(*field, states=starts[0], **settings)
        how = {name: value for name, value in settings.items() if name != "pattern"}
        yield from cold_solutions(flow, levels, inputs[GRID].reshape(-1, 3), areas, stream, **how)

    def _is_given(self, outputs: Vector) -> bool:
        """Whether the states are the given initial ones."""
        given = self._start
        is_so = given is not None and np.array_equal(outputs["states"].reshape(-1, N_STATES), given[0])
        return given is not None and self._everywhere(is_so)

    def _from_nearby(
        self,
        inputs: Vector,
        outputs: Vector,
        field: tuple[Discretization, np.ndarray, np.ndarray],
        start: np.ndarray,
        settings: dict[str, Any],
    ) -> FlowSolution:
        """Solve with the last Jacobian while it suffices, and then by steps with their own."""
        tangent = self._tangent or self._tangent_at(inputs, outputs)
        how = {name: value for name, value in settings.items() if name != "pattern"}
        nearby = solve_nearby(*field, states=start, tangent=tangent, **how)
        if nearby.is_converged:
            return nearby
        self._tangent = tangent = None  # free memory for the next ones
        settings = settings | {"max_steps": settings["max_steps"] - len(nearby.history) + 1}
        solution = solve_flow(*field, states=nearby.states, **settings)
        return replace(solution, history=nearby.history[:-1] + solution.history)

    def _progress(self, inputs: Vector, tolerance: float, report: Progress) -> Callable:
        """Callback of Newton's method for every step: it moves a bar, and prints a line if requested."""
        nodes, alpha, mach = inputs[GRID].reshape(-1, 3), RADIAN * inputs["alpha"][0], inputs["Mach_number"][0]
        is_printed = self.options["iprint"] > 1

        def message(step: NewtonStep, states: np.ndarray) -> None:
            digits = np.log(max(step.residual, tolerance)) / np.log(tolerance)
            report(float(np.clip(digits, 0.0, 1.0)), f"residual {step.residual:.1e}")
            if is_printed:
                self._log.log_step(step, states, nodes, alpha, mach)

        return message

    def _warn_of(self, solution: FlowSolution) -> None:
        """Print a line about a solution."""
        if self.options["iprint"] > 0:
            end = f"residual {solution.residual:.1e} after {len(solution.history) - 1} Newton steps"
            advice = self._supersonic(solution.states)
            if self.comm.rank == 0:
                print(f"{self.pathname}: {end}{advice}", flush=True)

    def _set_solver_print(
        self, level: int = 2, depth: float = 1e99, type_: str = "all", debug_print: bool | None = None
    ) -> None:
        """Take the level of ``set_solver_print`` for nonlinear solvers."""
        if type_ != "LN":
            self.options["iprint"] = level


SOLVER_OPTIONS = ("tolerance", "linear_tolerance", "max_steps", "iprint", "anchored")
"""Options of `EulerState` that an enclosing group passes on."""


def declare_solver(options: OptionsDictionary) -> None:
    """Declare the options `SOLVER_OPTIONS`."""
    options.declare("tolerance", default=1e-12, lower=0.0, upper=LARGEST_RESIDUAL, desc="residual at which a run ends")
    options.declare("linear_tolerance", default=1e-14, lower=0.0, desc="of the linear systems of derivatives")
    options.declare("max_steps", types=int, default=100, desc="Newton steps at most")
    options.declare("iprint", types=int, default=1, desc="0 or less, 1 line a solution, or 2 for one a step")
    options.declare("anchored", types=bool, default=False, desc="start from the solution of the last derivatives")


def check_in_flow(component: om.Component) -> None:
    """Declare how products of a component of the flow are checked: its kernels are exact under complex steps."""
    check_along_directions(component, SMOOTH_STEP, is_complex=True)
    check_along_directions(component, STATES_STEP, "states", is_complex=True)
    check_along_directions(component, MACH_STEP, "Mach_number", is_complex=True)


def check_on_grid(component: om.Component, flow: FlowGrid, nodes: np.ndarray) -> None:
    """Declare the same for a component of faces, and one step for all nodes."""
    step = central_step(flow.extent(nodes), flow.least_height(nodes))
    check_in_flow(component)
    check_along_directions(component, step, GRID, is_complex=True)


def _complaint(solution: FlowSolution) -> str:
    """Describe a solution that did not converge."""
    residuals = " ".join(f"{step.residual:.1e}" for step in solution.history[-8:])
    return (
        f"the flow did not converge: residual {solution.residual:.1e}, relative to the uniform stream's, after "
        f"{len(solution.history) - 1} steps (the last: {residuals})"
    )
