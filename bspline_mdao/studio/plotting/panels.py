"""What a picture shows: surfaces, the field that colours them, and from where they are seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from ...grids.topology.index_space import Window
from .scenes import Camera
from .surfaces import Sheet, control_sheets, flow_sheets, grid_sheets, worst_cells

__all__ = ["FIELD_STYLES", "SURFACES", "FieldStyle", "Panel", "camera_of", "sheets_of"]

SURFACES = {
    "walls": ("wall",),
    "symmetry": ("symmetry",),
    "farfield": ("farfield",),
    "boundary": ("wall", "symmetry", "farfield", "overset", "other"),
    "control mesh": ("control mesh",),
    "lattice": ("lattice",),
}
"""Names of surfaces, and the kinds of sheets that they are."""


@dataclass(frozen=True)
class FieldStyle:
    """How a field is shown.

    Parameters
    ----------
    field : str
        Its name on sheets.
    label : str
        What the colour bar says.
    colors : str
        Colour map of matplotlib.
    is_of_flow : bool
        Whether it needs a problem that has run.
    surfaces : tuple of str
        What is coloured where no surface is named.
    """

    field: str
    label: str
    colors: str
    is_of_flow: bool = False
    surfaces: tuple[str, ...] = ("walls", "symmetry")


FIELD_STYLES = {
    "quality": FieldStyle("Q", "orthogonality Q", "viridis"),
    "corner": FieldStyle("smallest_corner", "smallest corner", "viridis"),
    "wall height": FieldStyle("wall_height", "height of the first cell (m)", "viridis", surfaces=("walls",)),
    "block": FieldStyle("block", "block", "tab20"),
    "patch": FieldStyle("patch", "patch", "tab20", surfaces=("boundary",)),
    "Cp": FieldStyle("Cp", "pressure coefficient", "RdYlBu_r", True),
    "Mach": FieldStyle("Mach", "Mach number", "turbo", True),
    "entropy": FieldStyle("entropy", "entropy", "magma", True),
    "delta_Cp": FieldStyle("delta_Cp", "pressure difference below - above", "viridis", True, ("lattice", "symmetry")),
    "total pressure loss": FieldStyle("total_pressure_loss", "loss of total pressure", "magma", True),
}
"""Fields that colour the surfaces."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One of the pictures side by side.

    Parameters
    ----------
    sheets : list of Sheet
        What is in it.
    marks : ndarray, shape (n, 3)
        Points that are marked (m).
    title : str
        What stands above it.
    """

    sheets: list[Sheet]
    marks: np.ndarray
    title: str

    @classmethod
    def of(cls, state: Snapshot, surfaces: Sequence[str], look: FieldStyle | None, worst: int) -> Panel:
        """Cut what is wanted out of a state."""
        marks = np.zeros((0, 3))
        if look is not None and look.field in ("Q", "smallest_corner") and worst:
            marks = worst_cells(state.grid, worst)
        return cls(sheets_of(state, surfaces, look), marks, state.title)


def sheets_of(what: Any, surfaces: Sequence[str], look: FieldStyle | str | None = None) -> list[Sheet]:
    """Cut surfaces out of what is looked at, with the field that colours them.

    Parameters
    ----------
    what : Grid, FittedModel, openmdao.api.Problem or Snapshot
        What is looked at.
    surfaces : sequence of str
        Keys of `SURFACES` and names of patches.
    look : FieldStyle or str, optional
        One of `FIELD_STYLES`, or its key.

    Returns
    -------
    list of Sheet

    Raises
    ------
    InputError
        If there is nothing of the kind.
    """
    state = Snapshot.of(what)
    look = FIELD_STYLES[look] if isinstance(look, str) else look
    topology = None if state.model is None else state.model.topology
    if look is not None and look.field == "delta_Cp":
        every = [*_lattice_sheets(state), *grid_sheets(state.grid, topology=topology)]
    elif look is not None and look.is_of_flow:
        if state.model is None or state.pressures is None:
            raise InputError(
                f"{state.title}: there is no flow to show; give a problem with an EulerFlow that has run, such as "
                f"plot(problem, 'Cp')"
            )
        every = flow_sheets(state.model, state.grid, state.pressures, state.states, state.mach)
    else:
        every = grid_sheets(state.grid, look is not None, topology)
    if "control mesh" in surfaces:
        if state.model is None:
            raise InputError(
                f"{state.title}: a grid has no control mesh; fit it first: fit_grid(grid).plot('control mesh')"
            )
        every = every + control_sheets(state.model, state.control_points)
    kinds = {kind for name in surfaces for kind in SURFACES.get(name, ())}
    found = [sheet for sheet in every if sheet.kind in kinds or sheet.name in surfaces]
    if not found:
        there = sorted({sheet.kind for sheet in every} | {sheet.name for sheet in every})
        raise InputError(f"{state.title}: nothing to see of {', '.join(surfaces)}; there is {', '.join(there)}")
    return found


def _lattice_sheets(state: Snapshot) -> list[Sheet]:
    """The lattice of a wing, with the pressure differences across its panels."""
    if state.lattice is None or state.panel_pressures is None:
        raise InputError(
            f"{state.title}: there is no lattice to show; give a problem with a LatticeFlow that has run, such as "
            f"plot(problem, 'delta_Cp')"
        )
    window = Window(0, (0, 0, 0), (state.lattice.shape[0] - 1, state.lattice.shape[1] - 1, 0))
    return [Sheet("lattice", "lattice", state.lattice, window, {"delta_Cp": state.panel_pressures})]


def camera_of(
    panels: Sequence[Panel],
    direction: Sequence[float] | None = None,
    up: Sequence[float] | None = None,
    zoom: float = 1.0,
    size: tuple[float, float] = (1200, 800),
) -> Camera:
    """Find a place from which all panels are seen: in front of the middle of the walls, from outside.

    Parameters
    ----------
    panels : sequence of Panel
        What is seen.
    direction, up : sequence of three float, optional
        See `plot`.
    zoom : float
        See `plot`.
    size : tuple of float
        Width and height, of which the ratio counts.

    Returns
    -------
    Camera
    """
    sheets = [sheet for panel in panels for sheet in panel.sheets]
    inner = [s for s in sheets if s.kind in ("wall", "lattice", "control mesh")] or sheets
    points = np.concatenate([sheet.points.reshape(-1, 3) for sheet in inner])
    low, high = points.min(axis=0), points.max(axis=0)
    box = high - low
    rise = np.eye(3)[int(np.argmin(box))] if up is None else np.asarray(up, dtype=float)
    planes, middle = [s for s in sheets if s.kind == "symmetry"], (low + high) / 2
    towards = _from_outside(box, rise, planes, middle) if direction is None else np.asarray(direction, dtype=float)
    camera = Camera(_three(middle), _three(towards), 1.0, _three(rise))
    seen = np.ptp(camera.project(points), axis=0)
    height = 1.25 * max(seen[1], seen[0] * size[1] / size[0], 1e-12) / zoom
    return replace(camera, height=height)


def _three(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _from_outside(box: np.ndarray, up: np.ndarray, planes: Sequence[Sheet], middle: np.ndarray) -> np.ndarray:
    """Direction from the nose, above and, beside a plane of symmetry, the side where the body is."""
    rise = int(np.argmax(np.abs(up)))
    along, across = [d for d in range(3) if d != rise]
    if planes:
        points = np.concatenate([sheet.points.reshape(-1, 3) for sheet in planes])
        thin = int(np.argmin(np.ptp(points, axis=0)))
        if np.ptp(points, axis=0)[thin] < 1e-6 * np.ptp(points, axis=0).max() and thin != rise:
            across, along = thin, 3 - rise - thin
            side = np.sign(middle[thin] - points[:, thin].mean()) or 1.0
            if box[thin] < 0.3 * box[along]:  # a section: seen along its span
                return np.eye(3)[across] * side + 0.15 * np.sign(up.sum()) * np.abs(up) - 0.1 * np.eye(3)[along]
            return side * np.eye(3)[across] - 0.75 * np.eye(3)[along] + 0.65 * up / np.linalg.norm(up)
    return np.eye(3)[across] - 0.75 * np.eye(3)[along] + 0.65 * up / np.linalg.norm(up)
