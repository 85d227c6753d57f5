"""The map from the control points of a fitted grid to the nodes of an embedded mesh.

    y = x0 + A (b - b0)                     A: the volumes at the parameters of the nodes
    y <- y + F (w - y_wall)                 w: nodes of the mesh's own walls; F fades around them
    x = layer(y; x0, w)                     nodes near these walls follow them as a rigid body

Wall nodes are at their prescribed positions or, if none are given, where the volumes put them,

    w = y_wall + (G - G0) d ,               d: their distance from the volumes; G rotates with the wall.

Nodes on patches that slide on fixed surfaces are at the nearest points of these (`.riding_slides`).

Everything is linear in b except the rotations of walls. At b0 the mesh is x0 to the last bit: the map's error there,
which is round-off, is added everywhere.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...errors import InputError, MovementError
from ...grids.cells.mixed_cells import MixedMesh
from ...names import CONTROL_POINTS
from ..evaluation.evaluator import Evaluator
from ..evaluation.inversion import PointInversion, embed_points, invert_points
from ..evaluation.node_map import require_inputs
from ..evaluation.turned_evaluator import TurnedEvaluator
from ..model.fitted_model import FittedModel
from ..sliding.fixed_surface import Plane
from ..sliding.sliding_nodes import Slide, SlidNodes
from ..walls.embedded_points import ON_PLANE, planes_of
from ..walls.frames import Frames
from ..walls.layer import Followed
from .riding_slides import RidingSlides
from .riding_walls import RidingWalls
from .section_span import require_planes_of_section
from .wall_faces import GridBoundary, WallFaces

__all__ = ["EmbeddedMesh", "EmbeddedMeshState"]

WALL = "wall"
"""Name of the input with prescribed positions of wall nodes."""

STAYS = 1e-9
"""Displacement, relative to the size of the grid, up to which the boundary next to fixed nodes counts as at rest."""


AT_END = 1e-12
"""Parameters this close to 0 or 1 are set to it: the accuracy of the search."""


@dataclass(frozen=True, eq=False)
class EmbeddedMesh(OneLine):
    """The map from control points to the nodes of a mesh. Made by `EmbeddedMesh.of`.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh on the baseline.
    control_points : ndarray, shape (n_control_points, 3)
        Control points of the baseline (m).
    evaluator : Evaluator
        A of the nodes that move.
    rows : ndarray of int, shape (n_moving,)
        Nodes that move.
    left : ndarray of int, shape (n_held,)
        Nodes outside the grid, which stay.
    boundary : Evaluator or None
        Nearest points of the grid to these.
    distances : ndarray, shape (n_points,)
        Distances of the nodes to the volumes (m).
    walls : RidingWalls or None
        Its walls.
    baseline : ndarray, shape (n_points, 3)
        Result of the map at the baseline control points: its nodes (m) to round-off.
    sliding : RidingSlides or None
        Nodes that slide on surfaces.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.meshes import EmbeddedMesh, MixedMesh
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> cell = np.array([[2.0, 0.0, 0.0], [2.5, 0.0, 0.0], [2.0, 0.5, 0.0], [2.0, 0.0, 0.5]])
    >>> riding = EmbeddedMesh.of(model, MixedMesh(cell, {"tetra": np.array([[0, 1, 2, 3]])}))
    >>> moved = riding.at(1.1 * model.control_points)
    >>> moved.nodes[0].round(6) + 0.0
    array([2.2, 0. , 0. ])
    """

    mesh: MixedMesh
    control_points: np.ndarray
    evaluator: Evaluator | TurnedEvaluator
    rows: np.ndarray
    left: np.ndarray
    boundary: Evaluator | None
    distances: np.ndarray
    walls: RidingWalls | None
    baseline: np.ndarray
    sliding: RidingSlides | None = None

    @classmethod
    def of(
        cls,
        model: FittedModel,
        mesh: MixedMesh,
        walls: tuple[str, ...] | list[str] | None = None,
        tolerance: float | None = None,
        hold_outside: bool = False,
        slides: Sequence[Slide] = (),
    ) -> EmbeddedMesh:
        """Embed the nodes of a mesh in a fitted grid.

        Parameters
        ----------
        model : FittedModel
            The fitted grid.
        mesh : MixedMesh
            The mesh on the baseline.
        walls : sequence of str, optional
            Markers of the mesh that are walls, by name or pattern; by default markers on walls of the grid.
        tolerance : float, optional
            Distance (m) up to which a node may be outside the grid: it then moves with the grid's nearest point. By
            default the size of the grid's boundary faces there, since every mesh cuts curved walls differently.
        hold_outside : bool
            Fix nodes that are farther outside instead of refusing them. The boundary of the grid next to them must
            stay, too.
        slides : sequence of Slide
            Patches of the grid that slide on curved surfaces, ``mesh.slides`` of the mesh that moves: nodes there stay
            on these. A marker slides if most of its area is on such a patch.

        Returns
        -------
        EmbeddedMesh

        Raises
        ------
        InputError
            If nodes are outside the grid, a marker does not exist, the tolerance is not a length, or the mesh is
            two-dimensional and the grid is not a section between the same planes.
        """
        if tolerance is not None and not tolerance >= 0.0:
            raise InputError(f"{mesh.source}: a tolerance of {tolerance}; give a length in metres, 0 or more")
        require_planes_of_section(model, mesh)
        points = as_finite_points(mesh.points, mesh.n_points, mesh.source)
        boundary, b0 = GridBoundary.of(model), model.control_points
        planes = planes_of(model.grid_map(), points)
        found = _on_planes(model, invert_points(model.mesh, b0, points), points, planes)
        outside = np.flatnonzero(~found.is_inside)
        allowed = boundary.size_at(points[outside]) if tolerance is None else tolerance
        lost = outside[found.distance[outside] > allowed]
        if len(lost) and not hold_outside:
            raise InputError(_outside_message(mesh, found, lost))
        rows = np.setdiff1d(np.arange(len(points)), lost)
        evaluator = embed_points(model.mesh, _part(found, rows))
        left = embed_points(model.mesh, _part(found, lost)) if len(lost) else None
        embedded = cls(mesh, b0, evaluator, rows, lost, left, found.distance, None, points)
        return embedded._with_walls(model, WallFaces.of(mesh, boundary, walls), slides, boundary)

    def with_slides(self, model: FittedModel, slides: Sequence[Slide]) -> EmbeddedMesh:
        """Let patches of the grid slide, see `of`, if none does yet."""
        walls = WallFaces.none() if self.walls is None else self.walls.faces
        curved = any(not isinstance(slide.surface, Plane) for slide in slides)
        return self._with_walls(model, walls, slides, GridBoundary.of(model)) if curved else self

    def _with_walls(
        self, model: FittedModel, faces: WallFaces, slides: Sequence[Slide], boundary: GridBoundary
    ) -> EmbeddedMesh:
        """Let nodes follow faces of walls, and of patches of the grid that slide."""
        mesh, points = self.mesh, self.mesh.points
        sliding, faces = RidingSlides.of(mesh, slides, model.topology, boundary, faces, self.left)
        if not len(faces.faces):
            return self.with_baseline()
        missed = np.zeros_like(points)
        missed[self.rows] = points[self.rows] - self.evaluator.forward(self.control_points)
        walls = RidingWalls.of(mesh, faces, planes_of(model.grid_map(), points), self.left, missed)
        return replace(self, walls=walls, sliding=sliding).with_baseline()

    def with_baseline(self) -> EmbeddedMesh:
        """Set its baseline to the result of the map there."""
        return replace(self, baseline=self._mapped(self.control_points, None)[0])

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return self.mesh.n_points

    @property
    def asked_rows(self) -> np.ndarray:
        """Wall nodes, ascending, without sliding nodes that are on no wall."""
        if self.walls is None:
            return np.zeros(0, dtype=int)
        return self.walls.rows[self._given]

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Markers that are walls; one, ``"skin"``, if the mesh has no markers."""
        names = () if self.walls is None else self.walls.faces.names
        return names if self.sliding is None else names[: len(names) - len(self.sliding.slides)]

    @property
    def _given(self) -> np.ndarray | slice:
        """Which of the nodes of `walls` are on walls."""
        return slice(None) if self.sliding is None else np.flatnonzero(self.sliding.is_given)

    @property
    def n_asked(self) -> int:
        """Number of wall nodes."""
        return len(self.asked_rows)

    def at(self, control_points: np.ndarray, wall: np.ndarray | None = None) -> EmbeddedMeshState:
        """Nodes of the mesh and their derivative.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, 3)
            Control points (m).
        wall : ndarray, shape (n_asked, 3), optional
            Prescribed positions of wall nodes (m), in the order of ``asked_rows``; by default they follow the volumes.

        Returns
        -------
        EmbeddedMeshState

        Raises
        ------
        InputError
            If an array has the wrong shape or contains a number that is not finite.
        MovementError
            If the grid's boundary moves next to fixed nodes, or the surroundings of a wall node are inverted.
        """
        source = self.mesh.source
        control_points = as_finite_points(control_points, len(self.control_points), f"{source}: control points")
        if wall is not None:
            wall = as_finite_points(wall, self.n_asked, f"{source}: nodes of walls")
        self._require_rest(control_points)
        nodes, turned, followed, slid = self._mapped(control_points, wall)
        nodes += self.mesh.points - self.baseline
        if self.walls is not None and followed is not None:
            nodes[self.walls.rows] = followed.layered.frames.moved
        is_asked = wall is not None and self.walls is not None
        return EmbeddedMeshState(self, nodes, is_asked, turned, followed, slid)

    def _mapped(
        self, control_points: np.ndarray, wall: np.ndarray | None
    ) -> tuple[np.ndarray, Frames | None, Followed | None, SlidNodes | None]:
        """Nodes, the rotations of walls without prescribed positions, and the nodes that followed them and slid."""
        points = self.mesh.points.copy()
        points[self.rows] += self.evaluator.forward(control_points - self.control_points)
        walls, turned, slid = self.walls, None, None
        if walls is None:
            return points, None, None, None
        mapped, frames = points[walls.rows], walls.following.layer.wall.frames
        asked = mapped.copy()
        if wall is None or self.sliding is not None:
            turned = frames.at(walls.initial, mapped)
            rest = frames.at(walls.initial, walls.initial).matrices
            asked += np.einsum("nij,nj->ni", turned.matrices - rest, walls.missed)
        if wall is not None:
            asked[self._given] = wall
        if self.sliding is not None:
            slid = self.sliding.nodes.at(asked)
            asked[self.sliding.nodes.places] = slid.points
        points += walls.faded(asked - mapped)
        points[walls.rows] = asked
        return points, turned, walls.following.at(self.mesh.points, points, self.mesh.points, points), slid

    def _require_rest(self, control_points: np.ndarray) -> None:
        """Refuse a move of the boundary next to fixed nodes."""
        if self.boundary is None:
            return
        moves = np.linalg.norm(self.boundary.forward(control_points - self.control_points), axis=1)
        worst = int(np.argmax(moves))
        if moves[worst] > STAYS * np.linalg.norm(np.ptp(self.control_points, axis=0)):
            raise MovementError(
                f"{self.mesh.source}: {len(self.left):,} nodes outside the grid are held, but beside node "
                f"{self.left[worst] + 1} its boundary moves by {moves[worst]:.3g} m; fix that boundary, or take a grid "
                f"that covers the mesh"
            )


@dataclass(frozen=True, eq=False)
class EmbeddedMeshState(OneLine):
    """A moved mesh, and the derivative of its nodes."""

    of: EmbeddedMesh  # the map
    nodes: np.ndarray  # (n_points, 3), the nodes (m)
    is_asked: bool  # whether positions of wall nodes were prescribed
    turned: Frames | None  # rotations of walls without prescribed positions
    followed: Followed | None  # the nodes that followed walls
    slid: SlidNodes | None  # the nodes that slid on surfaces

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, including wall positions if they were prescribed."""
        return (CONTROL_POINTS, WALL) if self.is_asked else (CONTROL_POINTS,)

    def jvp(
        self,
        # (n_control_points, 3), change of the control points; none by default
        control_points: np.ndarray | None = None,
        # (n_asked, 3), change of the prescribed positions of wall nodes; none by default
        wall: np.ndarray | None = None,
    ) -> np.ndarray:
        """Change of the nodes, shape (n_points, 3)."""
        of, change = self.of, np.zeros_like(self.nodes)
        if control_points is not None:
            change[of.rows] = of.evaluator.forward(control_points)
        walls = of.walls
        if walls is None or self.followed is None:
            return change
        mapped = change[walls.rows]
        asked = mapped.copy()
        if self.turned is not None:
            asked += np.einsum("nij,nj->ni", self.turned.jvp(None, mapped), walls.missed)
        if self.is_asked:
            asked[of._given] = 0.0 if wall is None else wall
        if self.slid is not None and of.sliding is not None:
            places = of.sliding.nodes.places
            asked[places] = self.slid.jvp(asked[places])
        change += walls.faded(asked - mapped)
        change[walls.rows] = asked
        self.followed.jvp(change, change)
        return change

    def vjp(
        self,
        bar: np.ndarray,  # (n_points, 3), derivative of a scalar with respect to the nodes
        # which derivatives: ``control_points``, shape (n_control_points, 3), and, if positions of wall nodes were
        # prescribed, ``wall``, shape (n_asked, 3); all `inputs` by default
        wrt: Collection[str] | None = None,
    ) -> dict[str, np.ndarray]:
        """Transpose of `jvp`."""
        of, bar, wrt = self.of, np.array(bar, dtype=float), require_inputs(wrt, self.inputs)
        walls, bars = of.walls, {}
        if walls is not None and self.followed is not None:
            self.followed.add_vjp(bar, bar)
            wall_bar = bar[walls.rows]
            bar[walls.rows] = 0.0
            missed_bar = walls.faded_vjp(bar)
            asked_bar = wall_bar + missed_bar
            bar[walls.rows] -= missed_bar
            if self.slid is not None and of.sliding is not None:
                places = of.sliding.nodes.places
                asked_bar[places] = self.slid.vjp(asked_bar[places])
            if self.is_asked:
                bars[WALL] = asked_bar[of._given].copy()
                asked_bar[of._given] = 0.0
            if self.turned is not None:
                turned_bar = np.einsum("ni,nj->nij", asked_bar, walls.missed)
                asked_bar = asked_bar + self.turned.vjp(turned_bar, ("moved",))["moved"]
            bar[walls.rows] += asked_bar
        if CONTROL_POINTS in wrt:
            bars[CONTROL_POINTS] = of.evaluator.adjoint(np.ascontiguousarray(bar[of.rows]))
        return {name: bars[name] for name in wrt}


def _on_planes(model: FittedModel, found: PointInversion, points: np.ndarray, planes: list) -> PointInversion:
    """Put parameters of nodes in planes, rows of points, shape (n, 3), on the volumes' sides in these planes."""
    # The nearest point of the volumes need not be in the plane if a node is outside, and the node would leave it.
    # Points off by round-off are in the plane: all parameters of a section are in its planes except across it.
    # Parameters off an end by round-off are set to it, so nodes stay in planes to the last bit.
    parameters, near = found.parameters.copy(), ON_PLANE * np.linalg.norm(np.ptp(model.control_points, axis=0))
    for rows, normal in planes:
        for d in range(3):
            at_end = rows[np.abs(parameters[rows, d] - np.round(parameters[rows, d])) <= AT_END]
            parameters[at_end, d] = np.round(parameters[at_end, d])
            ids = np.setdiff1d(rows, at_end)
            kept, off = parameters[ids, d], []
            for values in (kept, np.round(kept)):
                parameters[ids, d] = values
                places = embed_points(model.mesh, replace(_part(found, ids), parameters=parameters[ids]))
                off.append(np.abs((places.forward(model.control_points) - points[ids]) @ normal))
            parameters[ids, d] = np.where((off[0] > near) & (off[1] < 1e-3 * off[0]), np.round(kept), kept)
    return replace(found, parameters=parameters)


def _part(found: PointInversion, rows: np.ndarray) -> PointInversion:
    """The result for some points."""
    return PointInversion(*(getattr(found, part.name)[rows] for part in fields(PointInversion)))


def _outside_message(mesh: MixedMesh, found: PointInversion, lost: np.ndarray) -> str:
    """Say which nodes are outside the grid and what to do."""
    worst = lost[np.argmax(found.distance[lost])]
    first, farthest = (
        f"node {q % mesh.n_stored + 1} at ({', '.join(f'{x:.4g}' for x in mesh.points[q])})" for q in (lost[0], worst)
    )
    return (
        f"{mesh.source}: {len(mesh.stored_ids(lost)):,} of {mesh.n_stored:,} nodes are outside the fitted grid, "
        f"the first is {first}, the farthest {farthest}, {found.distance[worst]:.3g} m away; take a grid that covers "
        f"the mesh, allow a larger tolerance, or hold nodes outside where they are (--tolerance, --hold-outside)"
    )
