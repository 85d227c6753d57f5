"""The steady Euler equations at a given lift, as an OpenMDAO component: the angle of attack is solved for with them.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import openmdao.api as om
from openmdao.jacobians.jacobian import Jacobian
from openmdao.vectors.vector import Vector

from ...base.checks import axes_text
from ...core.om.component import add_bar, direction_in, finite_values
from ...names import GRID
from ..euler.flow_grid import area_vectors
from ..euler.gas import N_STATES
from ..euler.newton_step import NewtonStep
from ..loads.force_coefficients import seen_areas
from ..loads.stream import RADIAN
from .euler_state import LARGEST_RESIDUAL, EulerState
from .residual_log import ResidualLog

__all__ = ["TrimmedState"]

FIRST_TOLERANCE, CLOSER = 1e-3, 1e-3
"""Residual to which the flow is solved before the angle is first changed, and the residual of later flows relative to
the remaining error of the lift."""

SENSITIVITY_TOLERANCE = 1e-2
"""Tolerance of the linear system for the change of the states with the angle."""

LARGEST_CHANGE, LARGEST_ANGLE, LARGEST_FALL = 5.0, 25.0, 0.5
"""Bounds of a change of the angle and of the angle itself (deg), and of the relative decrease of densities and
pressures in a change."""

SLOW, UNSURE, MAX_CHANGES = 0.2, 100.0, 20
"""Fraction of the error of the lift that a change may leave before the sensitivity to the angle is computed again; the
lift error relative to the flow's residual below which it has no meaning; and the largest number of changes."""


@dataclass(frozen=True, eq=False)
class _Sensitivity:
    """Change of the states, shape (n_cells, 5), and of the lift coefficient with the angle (1/deg)."""

    states: np.ndarray
    lift: float


class TrimmedState(EulerState):
    """Solve the steady Euler equations on the cells of a grid, and for the angle of attack of a given lift.

    ===============  ======  ============  =====  ======================================================================
    name             role    shape         units  meaning
    ===============  ======  ============  =====  ======================================================================
    ``grid``         input   (3 n_nodes)   m      nodes, blocks in file order, each in C order of (i, j, k)
    ``Mach_number``  input   (1,)                 of the free stream
    ``CL_target``    input   (1,)                 lift coefficient
    ``states``       output  (5 n_cells)          see `EulerState`
    ``alpha``        output  (1,)          deg    angle of attack; its residual is the lift coefficient less that one
    ===============  ======  ============  =====  ======================================================================

    A run solves for the states at the current angle, roughly at first. Then the angle and the states are changed
    according to the error of the lift, using the sensitivity of the linearized flow to the angle. This costs one linear
    system, which is kept for later changes and runs while it is accurate enough. The smaller the error, the more
    tightly each flow is solved. The derivatives are of states and angle together: with one more row and column than the
    Jacobian of the states, and one more linear system, once for all gradients of a design.

    Options
    -------
    flow, levels, nodes, forces, tolerance, linear_tolerance, max_steps, iprint, anchored
        See `EulerState`; the lift coefficient is met to ``tolerance`` as well.

    Raises
    ------
    om.AnalysisError
        As in `EulerState`; also in a run if the lift is out of reach: at an angle beyond 25 degrees, or if it no longer
        rises with the angle.
    """

    _borders: dict[str, Any]

    def solve_nonlinear(self, inputs: Vector, outputs: Vector) -> None:
        """Solve for states and angle, from the current ones."""
        self._log = ResidualLog(self.pathname, self.options["forces"], self.comm, shows_alpha=True)
        finite_values(inputs["CL_target"], "CL_target", self.msginfo)
        self._return_to_anchor(_merged(inputs, outputs), outputs)
        start = {name: outputs[name].copy() for name in ("states", "alpha")}
        try:
            self._trim(inputs, outputs)
        except om.AnalysisError:
            for name, value in start.items():
                outputs[name] = value
            raise
        self._warn_of(self._solution)

    def apply_nonlinear(self, inputs: Vector, outputs: Vector, residuals: Vector) -> None:
        """Sum the outflow of every cell, by its surface, and compare the lift."""
        super().apply_nonlinear(_merged(inputs, outputs), outputs, residuals)
        residuals["alpha"] = self._lift(inputs, outputs) - inputs["CL_target"]

    def linearize(self, inputs: Vector, outputs: Vector, jacobian: Jacobian) -> None:
        """Refuse states that are not a solution, and differentiate the residual."""
        super().linearize(_merged(inputs, outputs), outputs, jacobian)

    def apply_linear(
        self, inputs: Vector, outputs: Vector, d_inputs: Vector, d_outputs: Vector, d_residuals: Vector, mode: str
    ) -> None:
        """Apply the Jacobian of both residuals at these inputs and outputs, or its transpose."""
        at, names = _merged(inputs, outputs), [name for name in (GRID, "Mach_number") if name in d_inputs]
        d_at = {name: d_inputs[name] for name in names}
        if "alpha" in d_outputs:
            d_at["alpha"] = d_outputs["alpha"]
        super().apply_linear(at, outputs, d_at, d_outputs, d_residuals, mode)
        if "alpha" not in d_residuals:
            return
        if mode == "fwd":
            d_residuals["alpha"] += self._lift_jvp(at, outputs, d_at, d_outputs)
            if "CL_target" in d_inputs:
                d_residuals["alpha"] -= d_inputs["CL_target"]
        else:
            bar = d_residuals["alpha"].item()
            for name, part in self._lift_vjp(at, outputs, bar).items():
                add_bar(d_outputs if name == "states" else d_at, name, part)
            if "CL_target" in d_inputs:
                d_inputs["CL_target"] -= bar

    def solve_linear(self, d_outputs: Vector, d_residuals: Vector, mode: str) -> None:
        """Solve with the Jacobian of both residuals, or with its transpose: the adjoint at a given lift."""
        # With A the Jacobian of the states, its column r for the angle, and the row l of the lift with its end s, the
        # solution is A's for the right-hand side minus the effect of the angle, ``(c - l.y) / (s - l.z)``: ``A z = r``
        # is solved once per design. The transpose has rows for columns.
        with self._unscaled_context(outputs=[self._outputs]):
            at, outputs = _merged(self._inputs, self._outputs), self._outputs
            tangent = self._tangent_at_solution(at, outputs)
            self._drop_anchor()
            bars = self._lift_vjp(at, outputs, 1.0)
            column = tangent.linearization.stream_jvp(self._stream_partials(at)["alpha"])
            right, out = (d_residuals, d_outputs) if mode == "fwd" else (d_outputs, d_residuals)
            if self._borders.get("of") is not tangent:
                self._borders = {"of": tangent}
            if mode not in self._borders:
                self._borders[mode] = self._solved(tangent, column if mode == "fwd" else bars["states"], mode)
            border, plain = self._borders[mode], self._solved(tangent, self._right_side(right, mode), mode)

            def across(vector: np.ndarray) -> Any:
                if mode == "fwd":
                    return self._lift_jvp(at, outputs, {}, {"states": vector})
                return self._stream_partials(at)["alpha"] @ tangent.linearization.stream_vjp(vector)

            angle = (right["alpha"].item() - across(plain)) / (bars["alpha"].item() - across(border))
        self._put(out, plain - angle * border, mode)
        out["alpha"] = angle

    def _inputs_of_flow(self) -> Any:
        return _merged(self._inputs, self._outputs)

    def _declare_angle(self) -> None:
        self._sensitivity: _Sensitivity | None = None
        self._borders = {}
        self.add_input("CL_target", desc="lift coefficient")
        start = 2.0 if self._start is None else self._start[1]
        self.add_output("alpha", val=start, units="deg", desc="angle of attack")

    def _trim(self, inputs: Vector, outputs: Vector) -> None:
        """Solve for the states, and change the angle until the lift is right."""
        target, final = inputs["CL_target"].item(), self.options["tolerance"]
        tolerance, before = max(final, FIRST_TOLERANCE), np.inf
        history: tuple[NewtonStep, ...] = ()
        for _ in range(MAX_CHANGES):
            self._solve(_merged(inputs, outputs), outputs, tolerance)
            history += self._solution.history[1 if history else 0 :]
            lack = target - float(self._lift(inputs, outputs))
            if tolerance <= final and abs(lack) <= final:
                break
            if self._sensitivity is None or abs(lack) > max(SLOW * before, UNSURE * tolerance):
                self._sensitivity = None  # free memory for the next
                self._sensitivity = self._sensitivity_at(inputs, outputs)
            self._change(outputs, self._sensitivity, lack, target)
            tolerance, before = max(final, min(tolerance, CLOSER * abs(lack))), abs(lack)
        else:
            if abs(lack) > LARGEST_RESIDUAL:
                raise om.AnalysisError(
                    f"{self.msginfo}: the lift coefficient is {lack:.1e} away from CL_target after {MAX_CHANGES} "
                    f"changes of alpha; the flow may not be steady there, take a smaller CL_target"
                )
        self._tangent = None  # it belongs to an intermediate angle
        self._solution = self._converged = replace(self._solution, history=history)

    def _advised(self, complaint: str, inputs: Vector) -> str:
        """Message on a flow that fails on the way to the lift: what to check; a wrong area leads to wrong angles."""
        return (
            f"CL_target {self._inputs['CL_target'].item():g} is not reached: at alpha {inputs['alpha'].item():.4g} deg "
            f"{complaint}; check CL_target, {self._frame()}, or take a smaller CL_target or Mach number"
        )

    def _frame(self) -> str:
        """Axes, reference area and, to compare, the area of the walls as seen from above."""
        forces = self.options["forces"]
        areas = area_vectors(forces.walls.nodes(self.options["nodes"]), forces.walls.corners)
        coefficients = forces.wing.coefficients
        (seen,) = seen_areas(areas, coefficients.axes[2:])
        area = f"reference_area ({coefficients.area:.4g} m^2; the walls as seen from above: {seen:.3g} m^2)"
        return f"axes ('{axes_text(coefficients.axes)}': downstream, along the span, up) and {area}"

    def _sensitivity_at(self, inputs: Vector, outputs: Vector) -> _Sensitivity:
        """Sensitivity of states and lift to the angle."""
        at = _merged(inputs, outputs)
        tangent = self._tangent_at(at, outputs)
        d_stream, linearization = self._stream_partials(at)["alpha"], tangent.linearization
        uniform = self._discretization.uniform(d_stream)  # sufficient for the wide cells of the far field
        rest = linearization.stream_jvp(d_stream) + linearization.state_jvp(uniform)
        states = uniform - self._solved(tangent, rest, "fwd", SENSITIVITY_TOLERANCE)
        one = {"alpha": np.ones(1)}
        return _Sensitivity(states, self._lift_jvp(at, outputs, one, {"states": states}))

    def _change(self, outputs: Vector, sensitivity: _Sensitivity, lack: float, target: float) -> None:
        """Change the angle, and the states with it, according to the error of the lift."""
        alpha, slope, states = outputs["alpha"].item(), sensitivity.lift, outputs["states"].reshape(-1, N_STATES)
        change = float(np.clip(lack / slope, -LARGEST_CHANGE, LARGEST_CHANGE)) if slope > 0.0 else np.inf
        if not abs(alpha + change) <= LARGEST_ANGLE:
            raise om.AnalysisError(
                f"{self.msginfo}: CL_target {target:g} is out of reach: at alpha {alpha:.4g} deg CL is "
                f"{target - lack:.4g} and rises by {slope:.2g} a degree; check {self._frame()}, or take "
                f"a CL_target nearer to that"
            )
        moved = states + change * sensitivity.states
        is_physical = np.all(moved[:, [0, 4]] > (1.0 - LARGEST_FALL) * states[:, [0, 4]])
        if self._everywhere(bool(is_physical)):
            outputs["states"] = moved.ravel()
        outputs["alpha"] = alpha + change

    def _lift(self, inputs: Vector, outputs: Vector) -> float:
        """Lift coefficient; real or complex."""
        return self.options["forces"].evaluate(*_arguments(_merged(inputs, outputs), outputs))["CL"]

    def _lift_jvp(
        self, at: Mapping[str, np.ndarray], outputs: Vector, d_at: Mapping[str, np.ndarray], d_outputs: Vector
    ) -> float:
        """Change of the lift coefficient with states, nodes, angle and Mach number, zero where there is none."""
        states = np.asarray(d_outputs["states"]) if "states" in d_outputs else np.zeros_like(outputs["states"])
        alpha, mach = (np.asarray(d_at[name]).item() if name in d_at else 0.0 for name in ("alpha", "Mach_number"))
        along = states.reshape(-1, N_STATES), direction_in(d_at, at, GRID), RADIAN * alpha, mach
        return float(self.options["forces"].jvp(*_arguments(at, outputs), *along)["CL"])

    def _lift_vjp(self, at: Mapping[str, np.ndarray], outputs: Vector, bar: float) -> dict[str, np.ndarray]:
        """Derivatives of the lift coefficient times a number, by name of the input or output."""
        states, nodes, alpha, mach = self.options["forces"].vjp(*_arguments(at, outputs), {"CL": np.array(bar)})
        return {"states": states, GRID: nodes, "alpha": np.asarray(RADIAN * alpha), "Mach_number": np.asarray(mach)}


def _merged(inputs: Vector, outputs: Vector) -> Mapping[str, np.ndarray]:
    """Inputs as in `EulerState`, with the angle, which is an output here."""
    return {GRID: inputs[GRID], "alpha": outputs["alpha"], "Mach_number": inputs["Mach_number"]}


def _arguments(at: Mapping[str, np.ndarray], outputs: Vector) -> tuple[np.ndarray, np.ndarray, float, float]:
    """States, nodes, angle (rad) and Mach number."""
    states, nodes = outputs["states"].reshape(-1, N_STATES), at[GRID].reshape(-1, 3)
    return states, nodes, RADIAN * at["alpha"].item(), at["Mach_number"].item()
