"""Common base of components whose output is nodes that a map computes from points."""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ..evaluation.node_map import NodeMap, NodeState
from .checked_along_edges import CheckedAlongEdges
from .component import LastState, add_product, failures_as_analysis_errors, finite_points


class MovedPoints(CheckedAlongEdges, om.ExplicitComponent):
    """Component whose output is the nodes of a map."""

    # Its ``setup`` calls `_moves_by` once the map is known.

    def _moves_by(self, node_map: NodeMap, of: str, *wrt: str) -> None:
        """Set the map and the names of output and inputs, in the order of the map's arguments."""
        self._map, self._of, self._wrt, self._last = node_map, of, wrt, LastState()

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Evaluate the points."""
        state = self._state_at(inputs)
        outputs[self._of] = state.nodes.ravel()
        if self.under_complex_step:
            outputs[self._of] += 1j * state.jvp(*(inputs[wrt].imag.reshape(-1, 3) for wrt in self._wrt)).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose at the inputs."""
        state = self._state_at(inputs)
        names = [name for name in state.inputs if name in d_inputs]

        def jvp(*directions: np.ndarray) -> np.ndarray:
            return state.jvp(**dict(zip(names, directions)))

        def vjp(bar: np.ndarray) -> list[np.ndarray]:
            bars = state.vjp(bar, names)
            return [bars[name] for name in names]

        add_product(inputs, d_inputs, d_outputs, mode, jvp=jvp, vjp=vjp, of=self._of, wrt=names)

    def _state_at(self, inputs: Vector) -> NodeState:
        with failures_as_analysis_errors(self):
            points = [finite_points(inputs[name], name, self.msginfo).real for name in self._wrt]
            return self._last.at(points, self._map.at)
