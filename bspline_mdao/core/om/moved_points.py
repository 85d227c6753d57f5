"""What components have in common whose output is points that a map takes from points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from openmdao.vectors.vector import Vector

from .checked_along_edges import CheckedAlongEdges
from .component import LastState, add_product, failures_as_analysis_errors, finite_points


class MovedPoints(CheckedAlongEdges):
    """Outputs and products of a component whose output, under its option ``name``, is points."""

    # Its ``setup`` calls `_moves_by` once the map is known.

    def _moves_by(
        self,
        # takes points under every input, of shape (n, 3), and returns a state: ``points``, ``jvp`` of directions in the
        # inputs, and ``vjp``, which gives a sequence with the derivatives with respect to these first
        move: Callable,
        *wrt: str,  # names of the inputs
    ) -> None:
        """Set the map."""
        self._move, self._wrt, self._last = move, wrt, LastState()

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Evaluate the points."""
        state, name = self._state_at(inputs), self.options["name"]
        outputs[name] = state.points.ravel()
        if self.under_complex_step:
            imaginary = [inputs[wrt].imag.reshape(-1, 3) for wrt in self._wrt]
            outputs[name] += 1j * state.jvp(*imaginary).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose at the inputs."""
        state = self._state_at(inputs)
        products = {"jvp": state.jvp, "vjp": state.vjp, "of": self.options["name"], "wrt": self._wrt}
        add_product(inputs, d_inputs, d_outputs, mode, **products)

    def _state_at(self, inputs: Vector) -> Any:
        with failures_as_analysis_errors(self):
            points = [finite_points(inputs[name], name, self.msginfo).real for name in self._wrt]
            return self._last.at(points, self._move)
