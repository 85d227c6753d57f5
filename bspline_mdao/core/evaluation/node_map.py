"""The contract of maps from points to nodes: of grids, surfaces, points in grids, meshes that ride, live grids.

A map is made once for a baseline. ``state = a_map.at(control_points, ...)`` has the nodes and their derivative:

    change = state.jvp(control_points=d_control_points)        directions by the names of inputs; zero if missing
    bars = state.vjp(bar, wrt=["control_points"])              derivatives of a scalar by the same names

Code written only against these, such as the components, serves every mesh. A new map, for an unstructured mesh,
say, must satisfy the following. `tests/core/evaluation/test_node_maps.py` proves it for every map that is listed there.

- *Names.* Inputs are parameters of ``at`` and ``jvp`` under the names in ``inputs``, which are the names of its
  component's variables. A map that is rebuilt when something changes, as a live grid for its baseline, has that in
  ``inputs``, too.
- *Shapes.* Every input and its direction has shape (n_input, 3), nodes and bars (n_nodes, 3), in metres, C order.
- *Numbering.* Rows of an input and of the nodes are numbered once, when the map is made. Nodes that coincide have a row
  each if they do in their file; all of them have equal bits, and a bar counts in each.
- *Real numbers.* Points, directions and bars are real. Under complex step, the component treats both parts of a complex
  one in turn (``by_parts``).
- *A function of the design alone.* Equal inputs give equal bits, whatever was evaluated before. Searches, and which
  node is near which wall, are done on the baseline. Neither map nor state changes, and no argument is written to.
- *Exact and linear.* ``jvp`` is the derivative of ``nodes``, ``vjp`` its transpose to round-off. A subset of ``wrt``
  gives the same values as all of it, and costs less where possible.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Protocol

import numpy as np

from ...errors import InputError

__all__ = ["NodeMap", "NodeState", "require_inputs"]


class NodeState(Protocol):
    """Nodes at one set of inputs, and their derivative there."""

    @property
    def nodes(self) -> np.ndarray:
        """The nodes (m), shape (n_nodes, 3)."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of all inputs that the nodes depend on and can be differentiated in."""

    def jvp(self, *changes: Any, **named: Any) -> np.ndarray:
        """Change of the nodes, shape (n_nodes, 3), with changes of the inputs, in their order or by name."""

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`: from a bar of the nodes to bars of the inputs in ``wrt``; all inputs by default."""


class NodeMap(Protocol):
    """A map from points to nodes."""

    def at(self, *points: Any, **named: Any) -> NodeState:
        """Nodes and their derivative; `MovementError` if the map has no sensible value."""


def require_inputs(wrt: Collection[str] | None, inputs: tuple[str, ...]) -> Collection[str]:
    """Inputs to differentiate in, after a check that they exist; all inputs for None."""
    for name in wrt or ():
        if name not in inputs:
            raise InputError(f"nodes: no derivative in '{name}'; they depend on {', '.join(inputs)}")
    return inputs if wrt is None else wrt
