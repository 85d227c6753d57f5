"""The contract of what gives nodes from points: grids, their surfaces, points in them, meshes that ride, live grids.

A map is made once for a baseline. ``state = a_map.at(control_points, ...)`` has the nodes, and their derivative there:

    change = state.jvp(control_points=d_control_points)        directions by the names of inputs; one left out is zero
    bars = state.vjp(bar, wrt=["control_points"])              derivatives of a scalar by the same names

What is written by these alone, such as the components, serves every mesh. A new map, of a mesh without structure, say,
keeps to the following; `tests/core/evaluation/test_node_maps.py` proves it of one once it is listed there.

- *Names.* Inputs are parameters of ``at`` and ``jvp`` under the names in ``inputs``, those of its component's
  variables. A map that is made anew for what changes, as a live grid is for its baseline, has that in ``inputs``, too.
- *Shapes.* Every input and its direction has shape (n_input, 3), nodes and bars (n_nodes, 3), in metres, C order.
- *Numbering.* Rows of an input and of the nodes are numbered once, when the map is made. Nodes that coincide have a row
  each where their file has; all of them have equal bits, and a bar counts in each.
- *Real numbers.* Points, directions and bars are real. Both parts of a complex one, under complex step, are taken in
  turn by the component (``by_parts``).
- *A function of the design alone.* Equal inputs give equal bits, whatever was asked before; searches, and which node is
  near which wall, are those of the baseline. Neither map nor state changes, and no argument is written to.
- *Exact and linear.* ``jvp`` is the derivative of ``nodes``, ``vjp`` its transpose to round-off. A subset of ``wrt``
  gives what all of it gives, and costs less where it can.
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
        """Names of all that the nodes were made from and can be differentiated in."""

    def jvp(self, *changes: Any, **named: Any) -> np.ndarray:
        """Change of the nodes, shape (n_nodes, 3), with those of the inputs, in their order or by their names."""

    def vjp(self, bar: np.ndarray, wrt: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Transpose of `jvp`: of a bar of the nodes, those of the inputs in ``wrt``; of all inputs by default."""


class NodeMap(Protocol):
    """A map from points to nodes."""

    def at(self, *points: Any, **named: Any) -> NodeState:
        """Nodes and their derivative; `MovementError` where the map has no sensible value."""


def require_inputs(wrt: Collection[str] | None, inputs: tuple[str, ...]) -> Collection[str]:
    """Names that derivatives are asked in, which have to be among the inputs; all of these for None."""
    for name in wrt or ():
        if name not in inputs:
            raise InputError(f"nodes: no derivative in '{name}'; they depend on {', '.join(inputs)}")
    return inputs if wrt is None else wrt
