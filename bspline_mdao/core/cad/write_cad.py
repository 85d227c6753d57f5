"""Walls of a model as a CAD file, checked by reading it back with OpenCascade.

Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.checks import as_finite_points, require_kind
from ...base.display import OneLine
from ...errors import InputError
from ...grids.io.disk import replaced_file
from ...grids.topology.length_unit import metres_of
from ..mesh.spline_sides import SplineSide, spline_sides
from ..mesh.surface import SurfaceGrid
from ..model.fitted_model import FittedModel
from .common_knots import with_common_knots
from .files import check_cad_name, read_shape, write_shape
from .opencascade import SEWING, require_opencascade, sewn_shape, to_face
from .side_knots import starting_knots
from .tensor_surface import tensor_surface

__all__ = ["TOLERANCE", "CadFace", "CadReport", "write_cad"]

TOLERANCE = 1e-6
"""Default tolerance, relative to the size of the walls."""

ON_PLANE = 1e-6
"""Distance, relative to the size of the walls, at which an edge is on a symmetry plane."""

PROJECTED = 200
"""Number of points projected on the surfaces read back."""


@dataclass(frozen=True, eq=False)
class CadFace(OneLine):
    """One face of a CAD file."""

    # name, patch: block and side, and the patch, which is its name in the file
    name: str
    patch: str
    # control points in u and v; first of the wall, second of the face in the file
    n_control: tuple[tuple[int, int], tuple[int, int]]
    is_exact: bool  # whether it is the wall itself, whose knots are straight
    error: float  # largest distance to the wall, at equal parameters (m)
    angle: float  # largest angle between the normals of both (deg)


@dataclass(frozen=True, eq=False)
class CadReport(OneLine):
    """The contents of a written CAD file, and its distance from the walls.

    Parameters
    ----------
    path : str
        The file.
    faces : tuple of CadFace
        Its faces.
    tolerance : float
        Largest distance allowed (m).
    distance : float
        Largest distance (m) of wall points from the file as read back by OpenCascade, by projection.
    is_valid : bool
        Whether OpenCascade finds no error in the shape it reads back.
    n_solids, n_open, n_on_symmetry : int
        Numbers of solids, of edges that belong to only one face, and of such edges on symmetry planes.
    missed : float or None
        Largest distance (m) of a wall node of the fitted grid from the splines, which the file does not include; None
        if control points were given, or the model has no residual.
    n_bytes : int
        Size of the file.
    seconds : float
        CPU time.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.files import write_cad
    >>> from bspline_mdao.generators import ball_grid
    >>> report = write_cad("ball.igs", fit_grid(ball_grid((9, 9, 9, 9))), units="mm")  # doctest: +SKIP
    >>> report.n_exact, report.is_closed, report.distance < 1e-9  # doctest: +SKIP
    (6, True, True)
    """

    path: str
    faces: tuple[CadFace, ...]
    tolerance: float
    distance: float
    is_valid: bool
    n_solids: int
    n_open: int
    n_on_symmetry: int
    missed: float | None
    n_bytes: int
    seconds: float

    @property
    def error(self) -> float:
        """Largest distance of a face from its wall, at equal parameters (m)."""
        return max(face.error for face in self.faces)

    @property
    def n_exact(self) -> int:
        """Number of faces that are the walls themselves."""
        return sum(face.is_exact for face in self.faces)

    @property
    def is_closed(self) -> bool:
        """Whether all edges are shared by two faces, except edges on symmetry planes."""
        return self.n_open == self.n_on_symmetry


def write_cad(
    path: str | os.PathLike,
    model: FittedModel,
    control_points: np.ndarray | None = None,
    patches: str | Sequence[str] | None = None,
    tolerance: float | None = None,
    units: str = "m",
) -> CadReport:
    """Write the walls of a model as B-spline surfaces to a STEP or IGES file, sewn along their edges.

    Sides of blocks with straight knots are written exactly. CAD does not support curved knots: such a side is refitted
    on straight ones, its edges exactly and the rest to the tolerance. OpenCascade reads the file back.

    Parameters
    ----------
    path : path-like
        File to make or replace: ``.step`` or ``.stp``, ``.iges`` or ``.igs``.
    model : FittedModel
        The model.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points, in the unit of the model; the fitted ones by default.
    patches : str or sequence of str, optional
        Patches by name or pattern (``"wing*"``); all walls by default.
    tolerance : float, optional
        Largest distance (m) of a refitted face from the wall; by default 1e-6 of the diagonal of the walls' box.
    units : {"m", "mm", "in", "ft"}
        Unit of length of the file; the model's unit is its grid's, metres if unspecified.

    Returns
    -------
    CadReport

    Raises
    ------
    InputError
        If OpenCascade is not installed, a name, patch, unit or tolerance is invalid, the tolerance is not reached with
        400 control points in a direction, or the shape read back is further away. Nothing is left half-written.

    Examples
    --------
    >>> import tempfile
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.files import write_cad
    >>> from bspline_mdao.generators import ball_grid
    >>> model = fit_grid(ball_grid((9, 9, 9, 9)))
    >>> with tempfile.TemporaryDirectory() as folder:  # doctest: +SKIP
    ...     report = write_cad(f"{folder}/ball.step", model)
    >>> len(report.faces), report.n_solids, report.is_valid  # doctest: +SKIP
    (6, 1, True)
    """
    start = time.process_time()
    require_kind(model, FittedModel, "the model of a CAD file", "make it with fit_grid(grid)")
    form = check_cad_name(path, units)
    require_opencascade()
    moved, metres = model.control_points, metres_of(model.header.length_unit)
    if control_points is not None:
        moved = as_finite_points(control_points, len(moved), f"{model.header.source}: control points")
    moved = metres * moved
    sides = spline_sides(model, moved, patches)
    if not sides:
        raise InputError(f"{model.header.source}: the patches have no face with an extent; name others")
    size = float(np.linalg.norm(np.ptp(np.concatenate([moved[side.ids.ravel()] for side in sides]), axis=0)))
    wanted = TOLERANCE * size if tolerance is None else float(tolerance)
    if not wanted > 0.0:
        raise InputError(f"{path}: tolerance {wanted:g} m; give a positive length in metres")
    surfaces = [
        tensor_surface(side.surface, wanted, f"{path}: {side.name}", known=known)
        for side, known in zip(sides, starting_knots(sides, wanted / size))
    ]
    surfaces = with_common_knots(sides, surfaces)
    made = [to_face(surface, size) for surface in surfaces]
    shape, faces = sewn_shape(made, min(SEWING * size, wanted))
    title = Path(model.header.source).stem
    with replaced_file(path) as part:
        write_shape(part, form, shape, faces, [side.patch for side in sides], title, units)
        found = read_shape(part, form)
        distance = float(found.distances(_samples(sides)).max())
        if distance > wanted:
            raise InputError(
                f"{path}: read back, it is {distance:.2g} m off, more than the tolerance of {wanted:.2g} m; raise it"
            )
    on_symmetry = [edge for edge in found.free_edges if _is_on_symmetry(model, edge / metres, size / metres)]
    return CadReport(
        path=str(path),
        faces=tuple(
            CadFace(
                side.name,
                side.patch,
                (side.ids.shape, surface.control_points.shape[:2]),
                surface.is_exact,
                surface.error,
                surface.angle,
            )
            for side, surface in zip(sides, surfaces)
        ),
        tolerance=wanted,
        distance=distance,
        is_valid=found.is_valid,
        n_solids=found.n_solids,
        n_open=len(found.free_edges),
        n_on_symmetry=len(on_symmetry),
        missed=_missed(model, patches, metres) if control_points is None else None,
        n_bytes=Path(path).stat().st_size,
        seconds=time.process_time() - start,
    )


def _samples(sides: Sequence[SplineSide]) -> np.ndarray:
    """Points of the walls themselves, shape (n, 3), at parameters not used by a fit."""
    each = max(PROJECTED // len(sides), 4)
    u, v = np.random.default_rng(0).random((2, each))
    return np.concatenate([side.surface.points(u, v) for side in sides])


def _is_on_symmetry(model: FittedModel, edge: np.ndarray, size: float) -> bool:
    """Whether an edge, points of shape (n, 3), is on a symmetry plane of the model."""
    planes = SurfaceGrid.of(model).planes
    return any(np.abs(edge @ plane.normal - plane.offset).max() <= ON_PLANE * size for plane in planes)


def _missed(model: FittedModel, patches: str | Sequence[str] | None, metres: float) -> float | None:
    """Largest distance (m) of wall nodes from the splines; None if the model has no residual."""
    residual = model.residual_at(SurfaceGrid.of(model, patches).rows)
    return None if residual is None else metres * float(np.linalg.norm(residual, axis=1).max())
