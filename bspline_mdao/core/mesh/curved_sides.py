"""Non-planar sides that slide: the surface of each patch, given or recognised from its nodes.

Control points of such a side slide in the tangent planes of its surface. Where the design surface ends on the side they
are free: its edge leaves these planes as it slides, and points next to it that did not would fold the cells of a
boundary layer. The nodes are put on the surface itself, whatever the control points do, see
`bspline_mdao.core.sliding.sliding_nodes`.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...base.numerics.mean_planes import mean_planes, near_enough
from ...errors import InputError
from ...grids.topology.sharing import boundary_sections
from ...grids.topology.topology import BoundaryFace, Topology
from ..sliding.closest import closest_on
from ..sliding.fixed_surface import FixedSurface, Plane, require_near
from ..sliding.recognition import recognised_surface
from ..sliding.sliding_nodes import Slide

__all__ = [
    "Side",
    "Sliding",
    "curved_slides",
    "given_surfaces",
    "is_curved",
    "require_off_design",
    "slide_in_plane",
    "tangent_normals",
]

Sliding = str | Sequence[str] | Mapping[str, FixedSurface | None]
"""Patches by name or pattern, or each with the surface that it slides on; None has the surface found."""

_LOGGER = logging.getLogger(__name__)


class Side(NamedTuple):
    """Side of a segment on the boundary: its face, its points, and its number among all sides."""

    face: BoundaryFace
    ids: np.ndarray
    number: int


def given_surfaces(sliding: Sliding) -> dict[str, FixedSurface]:
    """Given surfaces, by the patterns of their patches."""
    pairs = sliding.items() if isinstance(sliding, Mapping) else ()
    for pattern, surface in pairs:
        if surface is not None and not isinstance(surface, FixedSurface):
            raise InputError(
                f"sliding: '{pattern}' is to slide on {surface!r}; give a Cylinder, Cone, Sphere, Revolution, "
                f"SplineSurface or PatchedSurface, or None to have it found"
            )
    return {pattern: surface for pattern, surface in pairs if surface is not None}


def is_curved(sides: Sequence[Side], points: np.ndarray) -> list[bool]:
    """Whether the control points of sides that are to slide leave the planes that they are in together."""
    parts = [points[side.ids] for side in sides]
    return [plane.roughness > near_enough(parts) for plane in mean_planes(parts)]


def curved_slides(
    topology: Topology,
    sides: Sequence[Side],  # sides that slide and are not planar, or whose surface is given
    given: Mapping[str, FixedSurface],  # surfaces by patch
    # all nodes (m), shape (n_nodes, 3); None if a process has a part of them and all surfaces are given
    nodes: Callable[[], np.ndarray] | None,
) -> list[Slide]:
    """Find the surface of each patch; `InputError` if its nodes are not on it, or on none."""
    by_patch: dict[str, list[int]] = {}
    for side in sides:
        by_patch.setdefault(str(side.face.patch), []).append(side.number)
    if not by_patch:
        return []
    numbers = topology.layout.numbers
    rows = [
        of_side for _, of_side in boundary_sections(topology, [numbers[s.block][s.slices] for s in topology.segments])
    ]
    points = None if nodes is None else nodes()
    slides = []
    for patch, found in by_patch.items():
        what, surface = f"{topology.source}: patch {patch}", given.get(patch)
        if points is not None:
            faces = [points[rows[n]] for n in found]
            near = near_enough([face.reshape(-1, 3) for face in faces])
            if surface is None:
                surface = recognised_surface(faces, near, what)
            else:
                _require_near(surface, points, np.concatenate([rows[n].ravel() for n in found]), near, what, topology)
        if surface is not None:
            slides.append(Slide(f"patch '{patch}'", surface, tuple(found)))
    return slides


def slide_in_plane(side: Side, normal: np.ndarray, offset: float) -> Slide:
    """Keep nodes of a side in its plane if a curved side ends on it."""
    return Slide(f"patch '{side.face.patch}'", Plane(normal, offset), (side.number,))


def tangent_normals(surface: FixedSurface, points: np.ndarray) -> np.ndarray:
    """Unit normals of a surface, shape (n, 3), at the places nearest to points."""
    gradients = surface.levels(closest_on([surface], points, what="sliding: control points").points).gradients
    return gradients / np.linalg.norm(gradients, axis=1)[:, None]


def require_off_design(sides: Iterable[Side], what: str) -> None:
    """Refuse to let patches of the design surface slide."""
    for side in sides:
        raise InputError(
            f"{what}: patch '{side.face.patch}' is to slide and is of the design surface; name the patches that are "
            f"designed (design=..., --design)"
        )


def _require_near(
    surface: FixedSurface, points: np.ndarray, rows: np.ndarray, near: float, what: str, topology: Topology
) -> None:
    """Refuse a given surface if nodes are far from it, and log smaller distances."""

    def place_of(number: int) -> str:
        (block,), (index,) = topology.layout.unravel(rows[number : number + 1])
        return f"node ({', '.join(str(n + 1) for n in index)}) of block {block + 1}"

    cure = "leave it out to have it found (sliding='...')"
    worst, off = require_near(surface, points[rows], place_of, what, "the patch's size", cure)
    if off > near:
        values = what, off, type(surface).__name__, place_of(worst)
        _LOGGER.warning("%s: nodes are up to %.3g m off the given %s, %s most; each keeps its distance", *values)
