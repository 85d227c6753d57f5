"""OpenCascade faces as trimmed rational B-splines of this package, in metres; planes, cylinders etc. are converted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .nurbs_surface import NurbsSurface
from .opencascade import MILLIMETRES, sub_shapes
from .trimmed_face import TrimmedFace

__all__ = ["edges_of", "placed_surface", "spline_faces", "surface_of_face", "trimmed_face"]

STRAIGHT, CURVED, PER_KNOT, MOST_ON_EDGE = 33, 129, 16, 801
"""Number of points of a straight edge; of a curved edge at least, for each of its knots, and at most; odd."""

PERIOD = 1e-9
"""Fraction of a period by which edges may leave it."""


def spline_faces(shape: Any) -> tuple[Any, list[Any]]:
    """Convert a shape to B-splines, and list its faces, in their order."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
    from OCP.TopoDS import TopoDS

    converted = BRepBuilderAPI_NurbsConvert(shape, True)
    return converted.Shape(), [TopoDS.Face(converted.ModifiedShape(face)) for face in sub_shapes(shape, "face")]


def placed_surface(face: Any) -> tuple[Any, Any]:
    """Surface of a face itself, not a copy, and the motion that places it at the face."""
    from OCP.BRep import BRep_Tool
    from OCP.TopLoc import TopLoc_Location

    location = TopLoc_Location()
    surface = BRep_Tool.Surface_s(face, location)
    return surface, location.Transformation()


def surface_of_face(face: Any) -> tuple[Any, np.ndarray]:
    """B-spline surface of a face, not periodic and with open knots, and the ranges of u and v, (2, 2)."""
    from OCP.Geom import Geom_BSplineSurface
    from OCP.GeomConvert import GeomConvert

    surface, _ = placed_surface(face)
    if not isinstance(surface, Geom_BSplineSurface):
        surface = GeomConvert.SurfaceToBSplineSurface_s(surface)
    if surface.IsUPeriodic() or surface.IsVPeriodic():
        points = np.concatenate([_samples(edge, face) for edge in edges_of(face)])
        low, high = points.min(axis=0), points.max(axis=0)
        bounds = np.array(surface.Bounds()).reshape(2, 2)
        slack = PERIOD * (bounds[:, 1] - bounds[:, 0])
        if (low >= bounds[:, 0] - slack).all() and (high <= bounds[:, 1] + slack).all():
            surface.SetUNotPeriodic()  # in place, so that the face has the same surface
            surface.SetVNotPeriodic()
        else:  # the face goes over the beginning of a period
            is_periodic = np.array([surface.IsUPeriodic(), surface.IsVPeriodic()])
            (u, v), (u_end, v_end) = np.where(is_periodic, low, bounds[:, 0]), np.where(is_periodic, high, bounds[:, 1])
            surface = surface.Copy()
            surface.Segment(u, u_end, v, v_end)
    if not _is_open(surface):
        surface.Segment(*surface.Bounds())
    return surface, np.array(surface.Bounds()).reshape(2, 2)


def _is_open(surface: Any) -> bool:
    """Whether the multiplicity of its first and last knots equals its order."""
    ends = [(surface.UMultiplicity(n), surface.UDegree()) for n in (1, surface.NbUKnots())]
    ends += [(surface.VMultiplicity(n), surface.VDegree()) for n in (1, surface.NbVKnots())]
    return all(count == degree + 1 for count, degree in ends)


def trimmed_face(
    face: Any,  # a face of B-splines
    name: str,  # its name
) -> TrimmedFace:
    """Take its surface and edges."""
    from OCP.BRep import BRep_Tool

    surface, ranges = surface_of_face(face)
    low, width = ranges[:, 0], ranges[:, 1] - ranges[:, 0]
    n_u, n_v = surface.NbUPoles(), surface.NbVPoles()
    pairs = [(i, j) for i in range(1, n_u + 1) for j in range(1, n_v + 1)]
    motion = placed_surface(face)[1]
    net = np.array([surface.Pole(i, j).Transformed(motion).Coord() for i, j in pairs]) / MILLIMETRES
    weights = np.array([surface.Weight(i, j) for i, j in pairs]).reshape(n_u, n_v)
    knots = [np.array(list(sequence)) for sequence in (surface.UKnotSequence(), surface.VKnotSequence())]
    u, v = ((sequence - start) / length for sequence, start, length in zip(knots, low, width))
    edges = edges_of(face)
    lines = tuple(np.clip((_samples(edge, face) - low) / width, 0.0, 1.0) for edge in edges)
    tolerance = max(BRep_Tool.Tolerance_s(face), *(BRep_Tool.Tolerance_s(edge) for edge in edges)) / MILLIMETRES
    ours = NurbsSurface((u, v), (surface.UDegree(), surface.VDegree()), net.reshape(n_u, n_v, 3), weights)
    return TrimmedFace(name, ours, lines, tolerance, face)


def edges_of(face: Any) -> Sequence[Any]:
    """Edges of a face; edges along which it closes on itself occur twice."""
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    explorer, found = TopExp_Explorer(face, TopAbs_ShapeEnum.TopAbs_EDGE), []
    while explorer.More():
        found.append(TopoDS.Edge(explorer.Current()))
        explorer.Next()
    return found


def _samples(edge: Any, face: Any) -> np.ndarray:
    """Points of an edge in (u, v) of its face, shape (m, 2), m odd."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve2d
    from OCP.GeomAbs import GeomAbs_CurveType

    curve, kinds = BRepAdaptor_Curve2d(edge, face), GeomAbs_CurveType
    n = STRAIGHT if curve.GetType() == kinds.GeomAbs_Line else CURVED
    if curve.GetType() == kinds.GeomAbs_BSplineCurve:
        n = min(max(n, PER_KNOT * curve.NbKnots() + 1), MOST_ON_EDGE)
    at = np.linspace(curve.FirstParameter(), curve.LastParameter(), n)
    return np.array([curve.Value(t).Coord() for t in at.tolist()])
