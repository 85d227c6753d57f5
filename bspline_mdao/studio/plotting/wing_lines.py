"""Lines of wings by the kind of their grid: both sides from the leading to the trailing edge, and sections.

Grids of blocks with patches ``wing_upper`` and ``wing_lower`` have lines of their own. In other grids and in meshes
without structure, walls whose names begin with ``wing`` are cut, or all walls if there are none. x points downstream, y
up, z along the span.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...core.measures.edge_cuts import root_end
from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...flow.loads.span_strips import SpanStrips
from .cuts import cut_lines
from .pressures import wall_quads

__all__ = ["section_of", "sides_of", "strips_of"]

N_CHORD, N_SPAN = 65, 41
"""Points of lines of meshes, along the chord and along the span."""

TIP = 0.998
"""Fraction of the span up to which walls of meshes are cut: a round tip ends in a point."""


@singledispatch
def sides_of(
    model: Any,
    nodes: np.ndarray,  # (n_nodes, 3), nodes (m)
) -> tuple[np.ndarray, np.ndarray]:  # each (n_chord, n_span, 3)
    """Upper and lower side from the leading to the trailing edge, and from root to tip (m)."""
    raise InputError(f"a wing of a {type(model).__name__} is not known; give a FittedModel or a MeshModel")


@singledispatch
def section_of(
    model: Any,
    nodes: np.ndarray,  # (n_nodes, 3), nodes (m)
    part: float,  # fraction of the half span
) -> np.ndarray:  # (n, 3)
    """Points along the upper side of a section, and back along the lower one (m)."""
    raise InputError(f"a wing of a {type(model).__name__} is not known; give a FittedModel or a MeshModel")


@singledispatch
def strips_of(model: Any) -> SpanStrips:
    """Strips of the span load of a flow about a grid."""
    raise InputError("an unstructured mesh has no strips of a flow; a LatticeFlow in the problem gives its span load")


@sides_of.register(FittedModel)
def _sides_of_blocks(model: FittedModel, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    grid = model.header.grid(model.topology.shapes, nodes)
    windows = {patch.name: patch.windows[0] for patch in grid.patches}
    sides = [windows[name] for name in ("wing_upper", "wing_lower")]
    upper, lower = (grid.blocks[side.block].nodes[side.slices][:, 0] for side in sides)
    return upper, lower


@section_of.register(FittedModel)
def _section_of_blocks(model: FittedModel, nodes: np.ndarray, part: float) -> np.ndarray:
    """The section along the nearest grid line, or a cut of walls that have no upper and lower side."""
    if not {"wing_upper", "wing_lower"} <= {patch.name for patch in model.header.patches}:
        return _section_of_walls(model, nodes, part)
    upper, lower = sides_of(model, nodes)
    nearest = np.argmin(np.abs(upper[0, :, 2] - part * upper[0, -1, 2]))
    return np.concatenate([upper[:, nearest], lower[::-1, nearest]])


@strips_of.register(FittedModel)
def _strips_of_blocks(model: FittedModel) -> SpanStrips:
    return SpanStrips.of(wall_quads(model), model.regenerate().to_vector().reshape(-1, 3), np.eye(3)[[0, 2, 1]])


@sides_of.register(MeshModel)
def _sides_of_mesh(model: MeshModel, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cuts of the walls with planes across the span, at equal fractions of the length of a side, closer at its ends."""
    surface, points = _wing(model, nodes)
    root, tip = max(root_end(surface.quads, points[:, 2]), 0.0), points[:, 2].max()
    places = root + (tip - root) * np.linspace(1.0 - TIP, TIP, N_SPAN)
    parts = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, N_CHORD))
    sides: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for place in places:
        line = _around(surface, points, place)
        trailing = int(np.argmax(line[:, 0]))
        for side, way in zip(sides, (line[: trailing + 1], np.concatenate([line[trailing:], line[:1]])[::-1])):
            lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
            side.append(np.stack([np.interp(parts * lengths[-1], lengths, values) for values in way.T], axis=1))
    upper, lower = (np.stack(side, axis=1) for side in sides)
    return upper, lower


@section_of.register(MeshModel)
def _section_of_walls(model: FittedModel | MeshModel, nodes: np.ndarray, part: float) -> np.ndarray:
    surface, points = _wing(model, nodes)
    line = _around(surface, points, part * points[:, 2].max())
    return np.concatenate([line, line[:1]])


def _wing(model: FittedModel | MeshModel, nodes: np.ndarray) -> tuple[SurfaceGrid, np.ndarray]:
    """Walls of the wing, and their nodes."""
    surface = SurfaceGrid.of(model)
    names = [name for name in dict.fromkeys(surface.patches) if name.lower().startswith("wing")]
    surface = SurfaceGrid.of(model, names) if names else surface
    return surface, nodes[surface.rows]


def _around(surface: SurfaceGrid, points: np.ndarray, place: float) -> np.ndarray:
    """The longest line at a station along the span, from the leading edge over the upper side and back, (n, 3)."""
    lines = cut_lines(points, surface.quads, 2, place)
    if not lines:
        raise InputError(f"no wall is at z = {place:g} m; take another part of the span")
    line = max(lines, key=lambda each: np.ptp(each[:, 0]))
    line = line[: -1 if (line[0] == line[-1]).all() else None]
    trailing = line[np.argmax(line[:, 0])]
    line = np.roll(line, -int(np.argmax(np.linalg.norm(line - trailing, axis=1))), axis=0)
    x, y = line[:, :2].T
    is_clockwise = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0
    return line if is_clockwise else np.roll(line[::-1], 1, axis=0)
