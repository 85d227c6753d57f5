"""Contents of a picture: surfaces, the field that colours them, and the viewpoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from . import block_view, mesh_view  # noqa: F401 - each registers its views
from .field_styles import SURFACES, FieldStyle
from .scenes import Camera
from .surfaces import AnySheet
from .view import View, view_of

__all__ = ["Panel", "camera_of", "sheets_of"]


TILT = 0.1
"""Slope from which a two-dimensional mesh is seen, so that its walls are visible."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One of several pictures side by side."""

    sheets: list[AnySheet]
    marks: np.ndarray  # (n, 3), points that are marked (m)
    title: str
    across: int | None = None  # axis normal to the plane of a two-dimensional mesh, which is seen along it

    @classmethod
    def of(cls, state: Snapshot, surfaces: Sequence[str], look: FieldStyle | None, worst: int) -> Panel:
        """Cut the requested surfaces out of a state."""
        view = view_of(state.grid, state)
        return cls(_found(view, surfaces, look), view.marks(look, worst), state.title, view.across)


def sheets_of(what: Any, surfaces: Sequence[str], look: FieldStyle | str | None = None) -> list[AnySheet]:
    """Cut surfaces, with a field to colour them, out of a grid, a model or a problem.

    Parameters
    ----------
    what : Grid, MixedMesh, FittedModel, MeshModel, openmdao.api.Problem or Snapshot
        What to look at.
    surfaces : sequence of str
        Keys of `SURFACES`, names of patches, and for unstructured meshes ``"slice z=0.4"``.
    look : FieldStyle or str, optional
        One of `FIELD_STYLES`, or its key.

    Returns
    -------
    list of Sheet or FacetSheet

    Raises
    ------
    InputError
        If there is no such surface or field.
    """
    state = Snapshot.of(what)
    view = view_of(state.grid, state)
    return _found(view, surfaces, view.styles[look] if isinstance(look, str) else look)


def _found(view: View, surfaces: Sequence[str], look: FieldStyle | None) -> list[AnySheet]:
    """The requested sheets among all."""
    every = view.sheets(surfaces, look)
    kinds = {kind for name in surfaces for kind in SURFACES.get(name, ())}
    found = [sheet for sheet in every if sheet.kind in kinds or sheet.name in surfaces]
    if not found:
        there = sorted({sheet.kind for sheet in every} | {sheet.name for sheet in every})
        raise InputError(f"{view.title}: nothing to see of {', '.join(surfaces)}; there is {', '.join(there)}")
    return found


def camera_of(
    panels: Sequence[Panel],
    direction: Sequence[float] | None = None,
    up: Sequence[float] | None = None,
    zoom: float = 1.0,
    size: tuple[float, float] = (1200, 800),
    focus: Sequence[float] | None = None,
) -> Camera:
    """Find a viewpoint for all panels: in front of the middle of the walls, from outside. Parameters as in `plot`."""
    sheets = [sheet for panel in panels for sheet in panel.sheets]
    inner = [s for s in sheets if s.kind in ("wall", "lattice", "control mesh")] or sheets
    points = np.concatenate([sheet.corners for sheet in inner])
    low, high = points.min(axis=0), points.max(axis=0)
    box = high - low
    across = next((panel.across for panel in panels if panel.across is not None), None)
    shortest = int(np.argmin([np.inf if axis == across else length for axis, length in enumerate(box)]))
    rise = np.eye(3)[shortest] if up is None else np.asarray(up, dtype=float)
    planes, middle = [s for s in sheets if s.kind == "symmetry"], (low + high) / 2
    if direction is not None:
        towards = np.asarray(direction, dtype=float)
    elif across is not None:  # the direction that is neither up nor across points to the right
        towards = np.cross(np.eye(3)[3 - across - int(np.argmax(np.abs(rise)))], rise) + TILT * rise
    else:
        towards = _from_outside(box, rise, planes, middle)
    camera = Camera(_three(middle), _three(towards), 1.0, _three(rise))
    seen = np.ptp(camera.project(points), axis=0)
    height = 1.25 * max(seen[1], seen[0] * size[1] / size[0], 1e-12) / zoom
    middle = middle if focus is None else np.asarray(focus, dtype=float)
    return replace(camera, height=height, focus=_three(middle))


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _from_outside(box: np.ndarray, up: np.ndarray, planes: Sequence[AnySheet], middle: np.ndarray) -> np.ndarray:
    """Direction from the nose, from above, and from the side of the body next to a plane of symmetry."""
    rise = int(np.argmax(np.abs(up)))
    along, across = [d for d in range(3) if d != rise]
    if planes:
        points = np.concatenate([sheet.corners for sheet in planes])
        thin = int(np.argmin(np.ptp(points, axis=0)))
        if np.ptp(points, axis=0)[thin] < 1e-6 * np.ptp(points, axis=0).max() and thin != rise:
            across, along = thin, 3 - rise - thin
            side = np.sign(middle[thin] - points[:, thin].mean()) or 1.0
            if box[thin] < 0.3 * box[along]:  # a section: seen along its span
                return np.eye(3)[across] * side + 0.15 * np.sign(up.sum()) * np.abs(up) - 0.1 * np.eye(3)[along]
            return side * np.eye(3)[across] - 0.75 * np.eye(3)[along] + 0.65 * up / np.linalg.norm(up)
    return np.eye(3)[across] - 0.75 * np.eye(3)[along] + 0.65 * up / np.linalg.norm(up)
