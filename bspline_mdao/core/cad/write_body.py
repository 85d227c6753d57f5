"""Moved faces of a CAD file written to a file: topology, trimming and names are preserved, control points are new.

Control points are replaced in a copy of the shape that OpenCascade read. The spatial edges of moved faces are rebuilt
from their edges in (u, v), which stay; vertices move to their ends.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ...base.numerics.vectors import lengths
from ...errors import InputError
from ...grids.io.disk import replaced_file
from .cad_body import NUMBERED, CadBody
from .files import CadShape, check_cad_name, read_shape, write_shape
from .opencascade import MILLIMETRES, require_opencascade
from .read_faces import edges_of, placed_surface

__all__ = ["write_cad_body"]

STAYS = 1e-12
"""Moves of control points, relative to the size of the body, that count as zero."""

PROJECTED = 100
"""Number of points projected on the shape read back."""

SAME = 1e-6
"""Largest distance of these points from the body, relative to its size: edges are rebuilt to 1e-5 mm."""


def write_cad_body(path: str | os.PathLike, body: CadBody, units: str | None = None) -> CadShape:
    """Write the moved faces of a CAD file, with their names, edges and topology, to another file.

    Parameters
    ----------
    path : path-like
        File to make or replace: ``.step`` or ``.stp``, ``.iges`` or ``.igs``.
    body : CadBody
        The faces, from `CadShape.body`, moved by `CadBody.at`, or by the values of a variable: `CadPoints.body_at`.
    units : {"m", "mm", "in", "ft"}, optional
        Unit of length of the file; by default the unit of the file that was read.

    Returns
    -------
    CadShape
        The shape OpenCascade reads back: whether it is valid, and which edges are open.

    Raises
    ------
    InputError
        If OpenCascade is not installed, a name or unit is invalid, a moved face belongs to a part that occurs twice or
        crosses the start of a period, or the shape read back is elsewhere. Nothing is left half-written.

    Examples
    --------
    >>> from bspline_mdao.files import read_cad, write_cad_body
    >>> body = read_cad("wing.step").body  # doctest: +SKIP
    >>> shape = write_cad_body("thick.step", body.at(body.control_points * [1.0, 1.1, 1.0]))  # doctest: +SKIP
    >>> shape.names, shape.is_valid  # doctest: +SKIP
    (('wing_lower', 'wing_upper'), True)
    """
    units = body.units if units is None else units
    form = check_cad_name(path, units)
    require_opencascade()
    if body.origin is None:
        raise InputError(f"{path}: the faces of {body.source} are of no file; take the faces of read_cad(file).body")
    shape, faces = _moved(body, str(path))
    named = [n for n, name in enumerate(body.names) if not name.startswith(NUMBERED)]
    parts, names = [faces[n] for n in named], [body.names[n] for n in named]
    with replaced_file(path) as part:
        write_shape(part, form, shape, parts, names, Path(body.source).stem, units)
        found = read_shape(part, form)
        points = _samples(body)
        distance = float(found.distances(points / body.scale).max()) * body.scale
        if distance > SAME * body.size + 2.0 * max(face.slack for face in body.faces):
            raise InputError(f"{path}: read back, it is {distance:.2g} m off; check the moved control points")
    return found


def _samples(body: CadBody) -> np.ndarray:
    """Points of the faces, shape (n, 3)."""
    random, each = np.random.default_rng(0), max(PROJECTED // len(body.faces), 4)
    return np.concatenate([face.points[random.integers(len(face.points), size=each)] for face in body.faces])


def _moved(body: CadBody, what: str) -> tuple[Any, list[Any]]:
    """Copy of the shape with the control points of a body, and its faces, in the body's order."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
    from OCP.BRepLib import BRepLib
    from OCP.gp import gp_Pnt
    from OCP.TopoDS import TopoDS

    copied = BRepBuilderAPI_Copy(body.origin, True, False)
    shape, faces = copied.Shape(), [TopoDS.Face(copied.ModifiedShape(face.origin)) for face in body.faces]
    changed = []
    for face, ours in zip(faces, body.faces):
        (surface, motion), net = placed_surface(face), ours.surface.control_points / body.scale
        n_u, n_v = ours.surface.weights.shape
        pairs = [(i, j) for i in range(1, n_u + 1) for j in range(1, n_v + 1)]
        if (surface.NbUPoles(), surface.NbVPoles()) != (n_u, n_v):
            raise InputError(
                f"{what}: face '{ours.name}' of {body.source} goes over the beginning of a period of its surface; cut "
                f"it there in CAD"
            )
        before = np.array([surface.Pole(i, j).Transformed(motion).Coord() for i, j in pairs]) / MILLIMETRES
        if lengths(net.reshape(-1, 3) - before).max() <= STAYS * body.size:
            continue
        twin = next((number for number, other in enumerate(faces) if other is not face and other.IsPartner(face)), None)
        if twin is not None:
            raise InputError(
                f"{what}: faces '{ours.name}' and '{body.names[twin]}' of {body.source} are one part that is there "
                f"twice, and cannot move alone; write that file without instances of parts"
            )
        back = motion.Inverted()
        for (i, j), point in zip(pairs, (net * MILLIMETRES).reshape(-1, 3).tolist()):
            surface.SetPole(i, j, gp_Pnt(*point).Transformed(back))
        changed.append(face)
    _remake_edges(changed)
    BRepLib.UpdateTolerances_s(shape)
    return shape, faces


def _remake_edges(faces: list[Any]) -> None:
    """Make the spatial edges and vertices of moved faces from edges in (u, v)."""
    from OCP.BRep import BRep_Builder, BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Curve2d
    from OCP.BRepLib import BRepLib
    from OCP.TopExp import TopExp

    builder = BRep_Builder()
    for face in faces:
        surface = BRep_Tool.Surface_s(face)
        for edge in edges_of(face):
            curve = BRepAdaptor_Curve2d(edge, face)
            ends = TopExp.FirstVertex_s(edge), TopExp.LastVertex_s(edge)
            for vertex, at in zip(ends, (curve.FirstParameter(), curve.LastParameter())):
                u, v = curve.Value(at).Coord()
                builder.UpdateVertex(vertex, surface.Value(u, v), BRep_Tool.Tolerance_s(vertex))
            if not BRep_Tool.Degenerated_s(edge):
                builder.UpdateEdge(edge, None, BRep_Tool.Tolerance_s(edge))
                BRepLib.BuildCurve3d_s(edge)
                BRepLib.SameParameter_s(edge)
