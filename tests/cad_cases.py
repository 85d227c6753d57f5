"""A CAD file of a stranger, made with OpenCascade itself: in millimetres, unnamed, trimmed; and faces without it."""

import importlib.util

import numpy as np
import pytest

from bspline_mdao.core.cad.cad_body import CadBody
from bspline_mdao.core.cad.nurbs_surface import NurbsSurface
from bspline_mdao.core.cad.tensor_surface import tensor_surface
from bspline_mdao.core.cad.trimmed_face import TrimmedFace
from bspline_mdao.core.mesh.spline_sides import spline_sides

needs_opencascade = pytest.mark.skipif(
    importlib.util.find_spec("OCP") is None,
    reason='OpenCascade is not installed: pip install "bspline_mdao[cad]"',
)

CYLINDER = np.array([3.0, 0.0, 0.0]), 0.2, 0.7
"""Foot, radius and height (m) of the cylinder, along z."""

BALL = np.array([5.0, 0.0, 0.0]), 0.3
"""Middle and radius (m)."""


def body_of_walls(model, tolerance):
    """Walls of a model as faces without OpenCascade, refitted on straight knots to a tolerance (m)."""
    boundary = np.linspace(0.0, 1.0, 33)
    lines = [np.stack([boundary, 0.0 * boundary + end], axis=1) for end in (0.0, 1.0)]
    edges = (*lines, *(line[:, ::-1] for line in lines))
    faces = []
    for side in spline_sides(model, model.control_points, None):
        surface = tensor_surface(side.surface, tolerance, side.name)
        degrees = tuple(knots.order - 1 for knots in surface.knots)
        weights = np.ones(surface.control_points.shape[:2])
        spline = NurbsSurface(tuple(k.knots for k in surface.knots), degrees, surface.control_points, weights)
        faces.append(TrimmedFace(side.patch, spline, edges, 1e-9))
    return CadBody("walls", tuple(faces))


def section(z, chord, x0):
    """A closed wing section as a wire of one spline (mm)."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeWire
    from OCP.collections import Array1_gp_Pnt
    from OCP.GeomAPI import GeomAPI_PointsToBSpline
    from OCP.gp import gp_Pnt

    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 21)))
    y = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    around = np.stack([np.concatenate([x[::-1], x[1:]]), np.concatenate([y[::-1], -y[1:]])], axis=1) * chord
    points = Array1_gp_Pnt(1, len(around))
    for number, (a, b) in enumerate(around.tolist(), start=1):
        points.SetValue(number, gp_Pnt(x0 + a, b, z))
    return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(GeomAPI_PointsToBSpline(points).Curve()).Edge()).Wire()


def foreign_file(path, sweep=350.0):
    """Write a lofted wing whose tip a cylinder has trimmed, a cylinder and a ball."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepOffsetAPI import BRepOffsetAPI_ThruSections
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeSphere
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    from bspline_mdao.core.cad.files import quiet
    from bspline_mdao.core.cad.opencascade import compound

    loft = BRepOffsetAPI_ThruSections(True, False)
    for z, chord, x0 in ((0.0, 1000.0, 0.0), (800.0, 800.0, 0.4 * sweep), (1500.0, 600.0, sweep)):
        loft.AddWire(section(z, chord, x0))
    loft.Build()
    knife = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0.0, -500.0, 1500.0), gp_Dir(0.0, 1.0, 0.0)), 600.0, 1000.0)
    (foot, radius, height), (middle, of_ball) = CYLINDER, BALL
    axis = gp_Ax2(gp_Pnt(*(1000.0 * foot).tolist()), gp_Dir(0.0, 0.0, 1.0))
    parts = [
        BRepAlgoAPI_Cut(loft.Shape(), knife.Shape()).Shape(),
        BRepPrimAPI_MakeCylinder(axis, 1000.0 * radius, 1000.0 * height).Shape(),
        BRepPrimAPI_MakeSphere(gp_Pnt(*(1000.0 * middle).tolist()), 1000.0 * of_ball).Shape(),
    ]
    with quiet():
        writer = STEPControl_Writer()
        Interface_Static.SetCVal_s("write.step.unit", "MM")
        writer.Transfer(compound(parts), STEPControl_StepModelType.STEPControl_AsIs)
        writer.Write(str(path))
    return path
