"""Directions in which the points of a mesh may move, from the patches of its grid.

The points of the design surface are given. Points on symmetry planes slide in them, and so do points of any planar
patch that the design surface ends on: the edge that it moves would otherwise fold the cells next to it. Points of
curved patches that it ends on are free (`.following_faces`). All others on the boundary are fixed unless they are
released; walls are, planar or not. Where patches meet, the surface takes precedence over fixed points, and these over
sliding ones. The surface itself may leave planes that slide by default, but not symmetry planes.

Theory: ``docs/theory/movers.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from itertools import combinations
from typing import Any

import numpy as np

from ...base.checks import as_array
from ...base.matching import matching_names
from ...base.numerics.mean_planes import MeanPlane
from ...errors import InputError
from ...grids.cells.quads import edges_of
from ...grids.topology.periodic_ties import Ties, control_ties, tied_sides
from ...grids.topology.sharing import boundary_sections, boundary_sides
from ...grids.topology.topology import BoundaryFace, Topology, describe
from ..model.fitted_model import FittedModel
from ..model.model import Model
from ..model.movable import Movable
from ..sliding.fixed_surface import FixedSurface
from ..splines.greville import greville_abscissae
from ..splines.volume import Volume
from .allowed_directions import AllowedDirections, required_planes, sliding_planes
from .control_net import surface_quads
from .curved_sides import (
    Side,
    Sliding,
    curved_slides,
    given_surfaces,
    is_curved,
    require_off_design,
    slide_in_plane,
    tangent_normals,
)
from .following_faces import following_sides
from .moving_mesh import MovingMesh
from .sliding_points import SlidingPoints
from .span_lines import span_lines

__all__ = [
    "boundary_points",
    "matching_patches",
    "moving_grid",
    "moving_mesh",
    "require_mesh_of",
    "symmetry_planes",
    "wall_patches",
]

Selection = str | np.ndarray
"""Patches by name or pattern, or points by number."""


@singledispatch
def moving_mesh(
    model: Movable,
    design: str | Sequence[str] | None = None,
    fixed: Selection | Sequence[Selection] = (),
    released: str | Sequence[str] = (),
    sliding: Sliding = (),
) -> MovingMesh:
    """Prepare the control mesh of a model to move.

    Parameters
    ----------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid, or the part of it that one of several processes needs; or an unstructured mesh, whose walls
        are patches by the names of its markers.
    design : str or sequence of str, optional
        Patches whose control points are the design surface, by name or pattern (``"wing*"``); all walls by default.
    fixed : str, ndarray of int, or sequence of them
        Patches, or numbers of control points (from 0), that do not move.
    released : str or sequence of str
        Patches whose control points are free.
    sliding : str, sequence of str, or mapping from str to FixedSurface or None
        Patches whose control points slide: planar ones in their planes, others on a cylinder, a cone, a sphere or a
        surface of revolution about x, y or z. The surface is found from their nodes, or given by a mapping
        (``{"casing": Cylinder(...)}``; None finds it). Symmetry planes always slide, and so do planar patches that
        the design surface ends on unless they are walls, fixed or released.

    Returns
    -------
    MovingMesh

    Raises
    ------
    InputError
        If a patch does not exist, a patch that is to slide is on no such surface or far from the given one, there are
        conflicting requests for a patch, there is no design surface, or a block is planar.

    Notes
    -----
    In a section, one layer of cells between two planes of symmetry, the surface in one plane moves as in the other: it
    is one curve, with one value of a variable for each of its points (``copies``).

    Curved patches of the far field, of kind ``other`` and of no kind follow the design surface where it ends on them,
    unless they are fixed, or periodic and not tied: their points are free. Points of tied periodic sides are also free,
    planar or not, and both sides move alike.

    Where a patch slides on a curved surface, its nodes stay on it, and on planes that end on it, as well as they are on
    the baseline, whatever control points do. Its control points slide in tangent planes of the surface, and are free on
    sides of blocks on which the design surface ends. Components take the surface from the mesh, see
    :doc:`/theory/sliding`. The design surface may leave it; its nodes on the edge there do not.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))  # all walls move; symmetry planes slide
    >>> mesh.points.shape, mesh.surface_ids.size, mesh.n_invalid
    ((78, 3), 26, 0)
    """
    raise InputError(f"the model of a moving mesh is of type {type(model).__name__}; make it with fit_grid(grid)")


@moving_mesh.register
def _of_blocks(
    model: Model,
    design: str | Sequence[str] | None = None,
    fixed: Selection | Sequence[Selection] = (),
    released: str | Sequence[str] = (),
    sliding: Sliding = (),
) -> MovingMesh:
    """See `moving_mesh`."""
    parameters = tuple(greville_abscissae(volume) for volume in model.mesh.volumes)
    asked = _Requests.of(model.topology, len(model.control_points), design, fixed, released, sliding)
    is_whole = model.ownership is None

    def nodes() -> np.ndarray:
        return model.local_nodes()

    blocks, points = model.mesh.control_ids, model.control_points
    return _mesh(model.topology, blocks, points, asked, parameters, model.mesh.volumes, nodes if is_whole else None)


def require_mesh_of(model: Movable, mesh: MovingMesh, what: str) -> None:
    """Refuse the control mesh of another model; ``what`` names the mesh."""
    ids = model.control_ids
    if len(mesh.blocks) != len(ids) or not all(map(np.array_equal, mesh.blocks, ids)):
        raise InputError(f"{what} is not the control mesh of {model.source}; make it with moving_mesh(model)")


def moving_grid(
    topology: Topology,
    nodes: np.ndarray,
    design: str | Sequence[str] | None = None,
    fixed: Selection | Sequence[Selection] = (),
    released: str | Sequence[str] = (),
    sliding: Sliding = (),
) -> tuple[MovingMesh, np.ndarray]:
    """Prepare a grid to move node by node, as in the paper's comparison.

    Parameters
    ----------
    topology : Topology
        Topology of the grid.
    nodes : ndarray, shape (n_nodes, 3)
        All nodes of the grid (m), blocks in order, each in C order.
    design, fixed, released, sliding
        As for `moving_mesh`, with numbers of points of the mesh. Points on patches that slide on curved surfaces are on
        these after a move, and the displacement that this takes fades over the blocks, see :doc:`/theory/sliding`.
        Points on the edge of the design surface slide from their given places.

    Returns
    -------
    mesh : MovingMesh
        Every node of the grid once.
    point_ids : ndarray of int32, shape (n_nodes,)
        The point of each node: ``nodes = points[point_ids]``.

    Raises
    ------
    InputError
        As for `moving_mesh`; also if the nodes have the wrong shape.

    Examples
    --------
    >>> from bspline_mdao import find_topology
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_grid
    >>> grid = brick_grid((5, 5, 5, 5))
    >>> mesh, nodes = moving_grid(find_topology(grid), grid.to_vector().reshape(-1, 3))  # without splines
    >>> mesh.n_points, nodes.shape
    (490, (750,))
    """
    nodes = as_array(nodes, "moving grid: nodes")
    if nodes.shape != (topology.n_nodes, 3):
        raise InputError(f"moving grid: nodes of shape {nodes.shape}; give shape ({topology.n_nodes}, 3)")
    blocks = topology.node_ids()
    rows = topology.layout.numbers
    point_ids = np.empty(topology.n_nodes, dtype=np.int32)
    for segment, ids in zip(topology.segments, blocks):
        point_ids[rows[segment.block][segment.slices]] = ids
    points = np.empty((max(int(ids.max()) for ids in blocks) + 1, 3))
    points[point_ids] = nodes
    asked = _Requests.of(topology, len(points), design, fixed, released, sliding)
    mesh = _mesh(topology, blocks, points, asked, nodes=lambda: nodes)
    if mesh.slides:
        of_points = SlidingPoints.of(topology, nodes, point_ids, mesh.surface_ids, mesh.slides, mesh.ties)
        mesh = replace(mesh, sliding_points=of_points)
    return mesh, point_ids


@dataclass(frozen=True, eq=False)
class _Requests:
    """Requests for patches, by name, and for single points."""

    design: frozenset[str]
    fixed: frozenset[str]
    released: frozenset[str]
    sliding: frozenset[str]
    fixed_point_ids: np.ndarray
    surfaces: Mapping[str, FixedSurface]  # given surfaces, by patch

    @classmethod
    def of(
        cls,
        topology: Topology,
        n_points: int,
        design: str | Sequence[str] | None,
        fixed: Selection | Sequence[Selection],
        released: str | Sequence[str],
        sliding: Sliding,
    ) -> _Requests:
        for name, segment in zip(topology.segment_names, topology.segments):
            if 1 in segment.shape:
                raise InputError(
                    f"{topology.source}: {name} is planar; movement needs cells in all three directions; "
                    f"make a plane grid one cell deep by lift_plane_grid"
                )
        fixed_patches, fixed_point_ids = _split(fixed, n_points)
        design = wall_patches(topology) if design is None else design
        asked = {"fixed": fixed_patches, "released": released, "sliding": _names(sliding)}
        found = {what: matching_patches(topology, patterns) for what, patterns in asked.items()}
        for (what, names), (other, others) in combinations(found.items(), 2):
            if names & others:
                raise InputError(
                    f"{topology.source}: patch '{min(names & others)}' is to be both {what} and {other}; choose one"
                )
        surfaces = {
            name: surface
            for pattern, surface in given_surfaces(sliding).items()
            for name in matching_patches(topology, pattern)
        }
        return cls(matching_patches(topology, design), **found, fixed_point_ids=fixed_point_ids, surfaces=surfaces)


def _mesh(
    topology: Topology,
    blocks: Sequence[np.ndarray],
    points: np.ndarray,
    asked: _Requests,
    parameters: tuple[np.ndarray, ...] | None = None,
    volumes: tuple[Volume, ...] | None = None,
    nodes: Callable[[], np.ndarray] | None = None,
) -> MovingMesh:
    """Sort the boundary faces of all blocks by the requests for them."""
    allowed = AllowedDirections.of(len(points))
    others: list[Side] = []
    designed: list[Side] = []
    allowed.fix(asked.fixed_point_ids)
    for number, (face, ids) in enumerate(boundary_points(topology, blocks)):
        if face.patch in asked.design:
            allowed.surface[ids] = True
            designed.append(Side(face, ids, number))
        elif face.patch in asked.fixed or face.patch not in asked.released:
            others.append(Side(face, ids, number))
    ties = control_ties(topology, blocks)
    if ties is not None:
        of_ties = tied_sides(topology)
        tied = {number for number, (_, *side) in enumerate(boundary_sides(topology)) if tuple(side) in of_ties}
        is_free = [side.number in tied and _may_slide(side.face, asked) for side in others]
        others = [s for s, free in zip(others, is_free) if not free or _is_asked_to_slide(s.face, asked)]
    require_off_design(_curved(designed, points, asked, nodes is not None), topology.source)
    curved_sides = _curved(others, points, asked, nodes is not None)
    slides = curved_slides(topology, curved_sides, asked.surfaces, nodes)
    ids_of = {side.number: side.ids for side in curved_sides}
    others = [side for side in others if side.number not in ids_of]
    in_planes = list(_asked_planes(others, points, asked, topology.source))
    for side, asked_plane in in_planes:
        allowed.keep_in_plane(side.ids, asked_plane.normal)
    others = [side for side in others if not (_is_asked_to_slide(side.face, asked) or _is_symmetry(side.face, asked))]
    undecided = [side for side in others if _may_slide(side.face, asked)]
    fixed = [side for side in others if not _may_slide(side.face, asked)]
    planes = sliding_planes([side.ids for side in undecided], points, allowed.surface)
    curved = {side.number: side.ids for side, plane in zip(undecided, planes) if plane is None}
    following = following_sides(topology, blocks, points, allowed.surface, curved)
    fixed += [side for side in undecided if side.number in curved.keys() - following]
    for side, plane in zip(undecided, planes):
        if plane is not None:
            allowed.keep_in_plane(side.ids[~allowed.surface[side.ids]], plane[0])
    for slide in slides:
        unmet = [ids_of[number] for number in slide.sides if not allowed.surface[ids_of[number]].any()]
        ids = np.unique(np.concatenate([np.zeros(0, dtype=int), *unmet]))
        allowed.keep_in_plane(ids, tangent_normals(slide.surface, points[ids]))
    for side in fixed:
        allowed.fix(side.ids)
    ties = None if ties is None else allowed.tie(ties)
    ends = [(side, plane.normal, plane.offset) for side, plane in in_planes]
    ends += [(side, *plane) for side, plane in zip(undecided, planes) if plane is not None]
    mesh = MovingMesh(
        tuple(blocks),
        topology.segment_names,
        points,
        **allowed.fields(),
        parameters=parameters,
        volumes=volumes,
        planes=tuple(plane for side, plane in zip(undecided, planes) if plane and side.face.kind != "farfield"),
        obstacles=_met(fixed, allowed.surface),
        following=_met((side for side in undecided if side.number in following), allowed.surface),
        slides=(*slides, *(slide_in_plane(*end) for end in ends)) if slides else (),
        **_tied(ties, allowed.surface),
    )
    return mesh if len(mesh.copies) else replace(mesh, copies=_planes_of_section(mesh), copy_turns=None)


def _planes_of_section(mesh: MovingMesh) -> np.ndarray:
    """Rows of the surface points in both planes of a section that is one layer deep, shape (n, 2), or (0, 2)."""
    surface = mesh.points[mesh.surface_ids]
    if len(np.unique(mesh.in_plane_rows)) == len(surface):
        edges = edges_of(surface_quads(mesh))
        lines = span_lines(surface, edges, mesh.in_plane_rows, mesh.in_plane_normals)
        if lines is not None and lines.shape[1] == 2:
            return lines
    return mesh.copies


def _tied(ties: Ties | None, surface: np.ndarray) -> dict[str, Any]:
    """Return the fields of a `MovingMesh` that tie the two sides of periodic pairs."""
    if ties is None:
        return {}
    rows = np.where(surface, np.cumsum(surface) - 1, -1)
    on_surface = ties.numbered(rows)
    copies = np.stack([on_surface.originals, on_surface.copies], axis=1)
    return {"ties": ties, "copies": copies, "copy_turns": on_surface.turns}


def _curved(sides: Sequence[Side], points: np.ndarray, asked: _Requests, may_be_found: bool) -> list[Side]:
    """Sides that slide on a given surface, or that are not planar if a surface may be found."""
    found = [side for side in sides if _is_asked_to_slide(side.face, asked)]
    is_given = [side.face.patch in asked.surfaces for side in found]
    return [
        side
        for side, given, curved in zip(found, is_given, is_curved(found, points))
        if given or (curved and may_be_found)
    ]


def _asked_planes(
    others: Sequence[Side], points: np.ndarray, asked: _Requests, source: str
) -> Iterator[tuple[Side, MeanPlane]]:
    """Yield the faces that have to slide in planes, with the mean plane of each."""
    for is_wanted, reason in ((_is_asked_to_slide, ("is to slide", "fix or release it")), (_is_symmetry, ())):
        found = [side for side in others if is_wanted(side.face, asked)]
        whats = [f"{source}: patch {side.face.patch}" for side in found]
        yield from zip(found, required_planes([points[side.ids] for side in found], whats, *reason))


def _is_asked_to_slide(face: BoundaryFace, asked: _Requests) -> bool:
    return face.patch in asked.sliding


def _is_symmetry(face: BoundaryFace, asked: _Requests) -> bool:
    """Whether a face slides because of its kind."""
    return face.kind == "symmetry" and face.patch not in asked.fixed and face.patch not in asked.sliding


def _may_slide(face: BoundaryFace, asked: _Requests) -> bool:
    """Whether a face that the design surface ends on slides if it is planar, and follows if it is curved."""
    return face.kind in ("other", "farfield", "overset", None) and face.patch not in asked.fixed


def _met(sides: Iterable[Side], surface: np.ndarray) -> tuple[tuple[str, np.ndarray], ...]:
    """Gather the faces that the design surface ends on by patch: its name for messages, and its points."""
    found: dict[str, list[np.ndarray]] = {}
    for face, ids, _ in sides:
        if surface[ids].any():
            what = f"patch '{face.patch}'" if face.patch else f"the undeclared face {describe(face.window)}"
            found.setdefault(what, []).append(ids)
    return tuple((what, np.unique(np.concatenate(parts))) for what, parts in found.items())


def boundary_points(topology: Topology, blocks: Sequence[np.ndarray]) -> Iterator[tuple[BoundaryFace, np.ndarray]]:
    """Boundary faces, each with the points of every segment face on it; see `boundary_sections`."""
    for face, ids in boundary_sections(topology, blocks):
        yield face, np.unique(ids)


def symmetry_planes(model: FittedModel) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """Planes of the faces of symmetry of a model: unit normal, offset (m) and control points of each face."""
    topology = model.topology
    found = [face for face in boundary_points(topology, model.mesh.control_ids) if face[0].kind == "symmetry"]
    whats = [f"{topology.source}: patch {face.patch}" for face, _ in found]
    planes = required_planes([model.control_points[ids] for _, ids in found], whats)
    return [(plane.normal, plane.offset, ids) for plane, (_, ids) in zip(planes, found)]


def wall_patches(topology: Topology) -> tuple[str, ...]:
    """Names of all patches that are walls."""
    walls = tuple(sorted({face.patch for face in topology.boundary if face.patch and face.kind == "wall"}))
    if not walls:
        raise InputError(
            f"{topology.source}: no patch is a wall, so there is no design surface; fit the grid with patches of the "
            f"kind wall ('fit --patches FILE'), or name the patches in 'design'"
        )
    return walls


def matching_patches(topology: Topology, patterns: str | Sequence[str]) -> frozenset[str]:
    """Names of all patches that match any of the patterns (``"wing*"``)."""
    names = {face.patch for face in topology.boundary if face.patch is not None}
    return matching_names(names, patterns, topology.source)


def _names(sliding: Sliding) -> str | Sequence[str]:
    """Patterns of the patches that are to slide."""
    return list(sliding) if isinstance(sliding, Mapping) else sliding


def _split(fixed: Selection | Sequence[Selection], n_points: int) -> tuple[list[str], np.ndarray]:
    """Names of fixed patches, and numbers of fixed points."""
    items = [fixed] if isinstance(fixed, np.ndarray) or np.isscalar(fixed) else list(fixed)
    ids = [np.asarray(item).ravel() for item in items if not isinstance(item, str)]
    ids = [numbers for numbers in ids if len(numbers)]
    for numbers in ids:
        if not np.issubdtype(numbers.dtype, np.integer) or numbers.min() < 0 or numbers.max() >= n_points:
            raise InputError(f"fixed points: give numbers from 0 to {n_points - 1}")
    return [item for item in items if isinstance(item, str)], np.concatenate([np.zeros(0, dtype=int), *ids])
