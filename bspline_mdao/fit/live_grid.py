"""The whole map to the grid where the baseline changes ("live"): residual and wall layer are those of that baseline.

    y = A(x0) b + T(b, b0) r,    r = x0 - A(x0) b0,         x = layer(y; x0)

with x0 the baseline and b0 the control points fitted to it; see `bspline_mdao.walls.grid_map`. Without a residual
r is nothing, and the layer is that of A(x0) b0. What is near which wall, how much it follows, and where in its span a
node is, stays that of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.fitted_model import FittedModel
from ..walls.grid_map import GridMap
from ..walls.layer import Layered
from ..walls.turning import Turn, Vectors
from .live_mapping import LiveMapping, live_mapping

__all__ = ["LiveGrid", "LiveGridState", "live_grid"]


@dataclass(frozen=True, eq=False)
class LiveGrid:
    """Regeneration of a grid with all that depends on one baseline. Made by `live_grid`.

    Parameters
    ----------
    mapping : LiveMapping
        A(x0), and the baseline.
    grid_map : GridMap
        What does not change with the baseline.
    has_residual : bool
        Whether a residual is carried.
    """

    mapping: LiveMapping
    grid_map: GridMap
    has_residual: bool

    @property
    def nodes(self) -> np.ndarray:
        """The baseline, shape (n_nodes, 3), in metres."""
        return self.mapping.nodes

    @property
    def needs_initial(self) -> bool:
        """Whether the control points of the baseline matter."""
        return self.has_residual or self.grid_map.layer is not None

    def at(self, initial: np.ndarray | None, control_points: np.ndarray) -> LiveGridState:
        """Grid and its derivative at control points of the baseline, and moved ones, shape (n_control_points, 3).

        Raises
        ------
        MovementError
            If the surroundings of a point are turned inside out.
        """
        grid_map, nodes = self.grid_map, self.mapping.evaluate(control_points)
        turn = vectors = layered = None
        start = self.mapping.evaluate(initial) if self.needs_initial else None
        if self.has_residual:
            residual, start = self.nodes - start, self.nodes
            if grid_map.turning is None:
                nodes += residual
            else:
                turn, vectors = grid_map.turning.at(control_points, initial), grid_map.turning.vectors(residual)
                nodes += turn.evaluate(np.zeros_like(control_points), vectors)
        rim_points = nodes[grid_map.rim_rows]
        if grid_map.layer is not None:
            rows = grid_map.wall_rows
            layered = grid_map.layer.at(start, nodes, start[rows], nodes[rows], grid_map.normals(rim_points))
        return LiveGridState(self, initial, control_points, nodes, turn, vectors, layered, rim_points)


@dataclass(frozen=True, eq=False)
class LiveGridState:
    """A grid and its derivative.

    Parameters
    ----------
    of : LiveGrid
        The map.
    initial, control_points : ndarray, shape (n_control_points, 3)
        Control points of the baseline (None where they do not matter), and now (m).
    nodes : ndarray, shape (n_nodes, 3)
        The grid (m).
    turn : Turn or None
        Rotations of the residual.
    vectors : Vectors or None
        The residual that turns.
    layered : Layered or None
        Nodes that followed walls.
    rim_points : ndarray, shape (n_rim, 3)
        Nodes on the rims of planes before that (m).
    """

    of: LiveGrid
    initial: np.ndarray | None
    control_points: np.ndarray
    nodes: np.ndarray
    turn: Turn | None
    vectors: Vectors | None
    layered: Layered | None
    rim_points: np.ndarray

    def jvp(self, d_nodes: np.ndarray, d_initial: np.ndarray | None, d_control_points: np.ndarray) -> np.ndarray:
        """Change of the grid, shape (n_nodes, 3), with those of the baseline and of both sets of control points."""
        of, grid_map = self.of, self.of.grid_map
        change, d_start = of.mapping.jvp(self.control_points, d_nodes, d_control_points), None
        if of.needs_initial:
            d_start = of.mapping.jvp(self.initial, d_nodes, d_initial)
        if of.has_residual:
            d_residual, d_start = d_nodes - d_start, d_nodes
            if self.turn is None:
                change += d_residual
            else:
                d_turn, d_vectors = self.turn.change(d_control_points, d_initial), self.turn.of.vectors(d_residual)
                change += self.turn.jvp(np.zeros_like(d_control_points), d_turn, self.vectors, d_vectors)
        if self.layered is not None:
            rows, d_normals = grid_map.wall_rows, grid_map.normals_jvp(self.rim_points, change[grid_map.rim_rows])
            self.layered.jvp(d_start, change, d_start[rows], change[rows], d_normals)
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Transpose of `jvp`: derivatives in the baseline and in both sets of control points."""
        of, grid_map = self.of, self.of.grid_map
        bar, start_bar = bar.copy(), np.zeros_like(bar)
        if self.layered is not None:
            rows = grid_map.wall_rows
            start_bar, bar, wall_start_bar, wall_bar, normals_bar = self.layered.vjp(bar)
            start_bar[rows] += wall_start_bar
            bar[rows] += wall_bar
            bar[grid_map.rim_rows] += grid_map.normals_vjp(self.rim_points, normals_bar)
        nodes_bar, control_bar = of.mapping.vjp(self.control_points, bar)
        if not of.needs_initial:
            return nodes_bar, None, control_bar
        initial_bar = np.zeros_like(control_bar)
        if of.has_residual:
            residual_bar = bar
            if self.turn is not None:
                copies = of.mapping.problem.sharing.copies
                np.add.at(bar, copies[:, 1], bar[copies[:, 0]])
                bar[copies[:, 0]] = 0.0
                turn_bar, initial_bar, residual_bar = self.turn.vjp(self.vectors, bar)
                residual_bar[copies[:, 0]] = 0.0
                control_bar += turn_bar
            nodes_bar += start_bar + residual_bar
            start_bar = -residual_bar
        by_start, start_control_bar = of.mapping.vjp(self.initial, start_bar)
        return nodes_bar + by_start, initial_bar + start_control_bar, control_bar


def live_grid(model: FittedModel, nodes: np.ndarray) -> LiveGrid:
    """Regenerate with all that another baseline grid has.

    Parameters
    ----------
    model : FittedModel
        Gives topology, numbers of control points, orders, kind of knots, and what is near which wall.
    nodes : ndarray, shape (n_nodes, 3)
        The baseline grid (m).

    Raises
    ------
    InputError
        As `live_mapping`.
    """
    return LiveGrid(live_mapping(model, nodes), model.grid_map(), model.residual is not None)
