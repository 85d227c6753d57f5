"""Surfaces as faces, shells and solids of OpenCascade. Its lengths are always in millimetres, whatever the file says.

OpenCascade is imported only when it is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.extras import library
from .tensor_surface import TensorSurface

__all__ = [
    "MILLIMETRES",
    "SEWING",
    "compound",
    "free_edges",
    "require_opencascade",
    "sewn_shape",
    "sub_shapes",
    "to_face",
]

MILLIMETRES = 1000.0
"""OpenCascade's own unit of length, per metre."""

SEWING = 1e-7
"""Distance at which edges coincide, relative to the size of the surface: neighbouring edges differ by round-off, and by
round-off of their knots if grids in single precision were fitted."""

COLLAPSED = 1e-9
"""Length, relative to the size of the surface, below which an edge has collapsed to a point."""

PER_EDGE = 9
"""Number of points that describe a free edge."""


def require_opencascade() -> None:
    """Refuse to continue without OpenCascade."""
    library("OCP", "CAD files need OpenCascade", "cad")


def to_face(
    surface: TensorSurface,  # the surface (m)
    size: float,  # size of all surfaces together (m)
) -> Any:
    """Make a face of a surface, with all its edges; collapsed ones are marked as degenerate."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.Geom import Geom_BSplineSurface

    poles, knots = _poles(surface.control_points * MILLIMETRES), [_knots(k.knots) for k in surface.knots]
    degrees = [k.order - 1 for k in surface.knots]
    (u, u_counts), (v, v_counts) = knots
    made = Geom_BSplineSurface(poles, u, v, u_counts, v_counts, *degrees)
    return BRepBuilderAPI_MakeFace(made, COLLAPSED * size * MILLIMETRES).Face()


def _poles(points: np.ndarray) -> Any:
    """Control points, shape (N_u, N_v, 3), one by one: OpenCascade does not take arrays."""
    from OCP.collections import Array2_gp_Pnt
    from OCP.gp import gp_Pnt

    n_u, n_v = points.shape[:2]
    poles = Array2_gp_Pnt(1, n_u, 1, n_v)
    for (i, j), point in zip(np.ndindex(n_u, n_v), points.reshape(-1, 3).tolist()):
        poles.SetValue(i + 1, j + 1, gp_Pnt(*point))
    return poles


def _knots(knots: np.ndarray) -> tuple[Any, Any]:
    """Distinct knots and their multiplicities."""
    from OCP.collections import Array1_double, Array1_int

    values, counts = np.unique(knots, return_counts=True)
    arrays = Array1_double(1, len(values)), Array1_int(1, len(values))
    for at, (value, count) in enumerate(zip(values.tolist(), counts.tolist()), start=1):
        arrays[0].SetValue(at, value)
        arrays[1].SetValue(at, count)
    return arrays


def sewn_shape(
    faces: Sequence[Any],  # the faces
    gap: float,  # distance (m) up to which edges coincide
) -> tuple[Any, list[Any]]:
    """Sew faces along their common edges: a solid if nothing is left open, otherwise shells."""
    # Returns shape: the solid, the shell, or several of them in a compound; faces: the sewn version of every face.
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Sewing

    sewing = BRepBuilderAPI_Sewing(gap * MILLIMETRES)
    for face in faces:
        sewing.Add(face)
    sewing.Perform()
    shape = sewing.SewedShape()
    sewn = [sewing.ModifiedSubShape(face) for face in faces]
    shells = sub_shapes(shape, "shell")
    if len(shells) == 1 and not free_edges(shape):
        return _solid(shells[0]), sewn
    is_shell = len(shells) == 1 and len(sub_shapes(shells[0], "face")) == len(faces)
    return (shells[0] if is_shell else compound([shape])), sewn  # a single face would have no part to name


def compound(shapes: Sequence[Any]) -> Any:
    """Combine shapes into one."""
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Compound

    builder, made = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(made)
    for shape in shapes:
        builder.Add(made, shape)
    return made


def _solid(shell: Any) -> Any:
    """Make the solid inside a closed shell."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell(shell)).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid


def sub_shapes(shape: Any, kind: str) -> list[Any]:
    """List the faces, edges, shells or solids of a shape, each once."""
    from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
    from OCP.TopExp import TopExp

    found = ShapeMap()
    TopExp.MapShapes_s(shape, _kind(kind), found)
    return [found.FindKey(number) for number in range(1, found.Extent() + 1)]


def _kind(name: str) -> Any:
    from OCP.TopAbs import TopAbs_ShapeEnum

    return getattr(TopAbs_ShapeEnum, f"TopAbs_{name.upper()}")


def free_edges(
    shape: Any,  # the shape
) -> list[np.ndarray]:
    """Points (m), shape (9, 3), of every edge that belongs to only one face; degenerate edges are ignored."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.collections import (
        IndexedDataMap_TopoDS_Shape_List_TopoDS_Shape_TopTools_ShapeMapHasher as FacesOfEdges,
    )
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp
    from OCP.TopoDS import TopoDS

    pairs, found = FacesOfEdges(), []
    TopExp.MapShapesAndUniqueAncestors_s(shape, TopAbs_ShapeEnum.TopAbs_EDGE, TopAbs_ShapeEnum.TopAbs_FACE, pairs)
    for number in range(1, pairs.Extent() + 1):
        edge, faces = TopoDS.Edge(pairs.FindKey(number)), pairs.FindFromIndex(number)
        is_seam = faces.Size() == 1 and BRep_Tool.IsClosed_s(edge, TopoDS.Face(faces.First()))
        if faces.Size() == 1 and not is_seam and not BRep_Tool.Degenerated_s(edge):
            curve = BRepAdaptor_Curve(edge)
            at = np.linspace(curve.FirstParameter(), curve.LastParameter(), PER_EDGE)
            found.append(np.array([curve.Value(t).Coord() for t in at.tolist()]) / MILLIMETRES)
    return found
