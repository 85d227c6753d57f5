"""A small wing, a section, and what every design variable must pass."""

from functools import cache

import numpy as np
from cad_cases import body_of_walls

from bspline_mdao.core.cad.tied_surface import TiedSurface
from bspline_mdao.core.design.axisymmetric import RadiusFactor
from bspline_mdao.core.design.cad_variables import CadPoints, CadShapes
from bspline_mdao.core.design.coarse_net import CoarseNet
from bspline_mdao.core.design.curve_points import CurvePoints
from bspline_mdao.core.design.displacement import Local, Translation
from bspline_mdao.core.design.free_form import FreeForm
from bspline_mdao.core.design.hinge import Hinge
from bspline_mdao.core.design.lattice import Lattice
from bspline_mdao.core.design.linear_constraints import (
    EqualDisplacement,
    InPlane,
    Linked,
    Mirrored,
    Opposite,
    Pinned,
)
from bspline_mdao.core.design.of_part import OfPart
from bspline_mdao.core.design.planform import Camber, Chord, Dihedral, Span, Sweep, Taper, ThicknessFactor, Twist
from bspline_mdao.core.design.reference_axis import ReferenceAxis
from bspline_mdao.core.design.rotation import Rotation
from bspline_mdao.core.design.section_shapes import CamberModes, ClassShape, HicksHenne, ThicknessModes, ThicknessPoints
from bspline_mdao.core.design.selection import NearPlane
from bspline_mdao.core.design.tangent_continuity import TangentContinuity
from bspline_mdao.core.design.user_defined import UserVariable
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.generators import cambered_section, onera_m6_grid, section_o_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window


@cache
def wing_model():
    """Fit of a coarse M6."""
    return fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))


@cache
def section_model(places=(0.0, 0.3, 0.4, 1.1), axes=(0, 2, 1), chord=1.7, n_around=64, n_control=(21, 9, 3)):
    """Fit of an O-grid about a cambered section, its planes at places along the span and its axes in another order."""
    grid = section_o_grid(cambered_section(0.12, 0.03), n_around, far=8.0)
    nodes = chord * np.repeat(grid.blocks[0].nodes[:, :, :1], len(places), axis=2)
    nodes[..., 2] = places
    face, sides = Window.whole(0, nodes.shape[:3]).face, {"wing": (2,), "farfield": (3,), "symmetry": (4, 5)}
    patches = [Patch(each.name, each.kind, tuple(map(face, sides[each.name]))) for each in grid.patches]
    block = Block(nodes[..., list(axes)], "around the section")
    return fit_grid(Grid((block,), tuple(patches)), n_control=[n_control])


def surface_of(mesh):
    """Surface control points of the baseline."""
    return mesh.points[mesh.surface_ids]


def assert_exact(layout, variable, seed=0):
    """Compare the partials of a bound variable with complex steps, away from the baseline; their pattern is fixed."""
    design_map, random = variable.bind(layout), np.random.default_rng(seed)
    points = layout.points + 0.05 * random.normal(size=layout.points.shape)
    values = design_map.initial + 0.1 * random.normal(size=design_map.initial.shape)
    np.testing.assert_allclose(design_map.apply(layout.points, design_map.initial), layout.points, atol=1e-12)
    partials, there = design_map.partials(points, values), design_map.partials(layout.points, design_map.initial)
    for d_points, d_values, matrix, at_baseline in (
        (1.0, 0.0, partials.points, there.points),
        (0.0, 1.0, partials.values, there.values),
    ):
        by = random.normal(size=matrix.shape[1])
        step = 1e-30j * by
        moved = design_map.apply(
            points + d_points * (step.reshape(-1, 3) if d_points else 0.0), values + (step if d_values else 0.0)
        )
        np.testing.assert_allclose(matrix @ by, moved.imag.ravel() / 1e-30, rtol=1e-11, atol=1e-12)
        np.testing.assert_array_equal(matrix.tocsr().indptr, at_baseline.tocsr().indptr)
        np.testing.assert_array_equal(
            matrix.tocsr().sorted_indices().indices, at_baseline.tocsr().sorted_indices().indices
        )


def swelling(name):
    """A user's function: scales all points about a point beside the surface, and by their own heights."""
    centre = np.array([0.3, 0.1, -0.2])

    def function(points, values):
        return points + values[0] * (points - centre) + values[1] * (points - centre) ** 2

    def derivative(points, values):
        rates = 1.0 + values[0] + 2.0 * values[1] * (points - centre)
        return rates[:, :, None] * np.eye(3), np.stack([points - centre, (points - centre) ** 2], axis=-1)

    return UserVariable(name, [0.0, 0.0], function, derivative)


def twisted_upper_side(name):
    """Twist of the upper side alone."""
    upper = moving_mesh(wing_model(), "*upper")
    return OfPart(Twist(name, ReferenceAxis.of(upper), stations=3), upper)


@cache
def tied_wing():
    """The wing's walls, tied to faces of their own."""
    return TiedSurface.of(wing_model(), body_of_walls(wing_model(), 1e-3))


def swollen_wing():
    """The same faces, thicker."""
    body = tied_wing().body
    return body.at(body.control_points * [1.0, 1.3, 1.0])


VARIABLES = {
    HicksHenne: lambda mesh: HicksHenne("bumps", (0.2, 0.6, 0.7), sides="upper", stations=2, order=2),
    CamberModes: lambda mesh: CamberModes("camber", 2, leading=True, trailing=True, stations=(0.1, 0.4, 0.9)),
    ClassShape: lambda mesh: ClassShape("weights", 2, trailing=True, axis=ReferenceAxis.of(mesh)),
    ThicknessModes: lambda mesh: ThicknessModes("thickness", 3, stations=2),
    ThicknessPoints: lambda mesh: ThicknessPoints("thickness", 4, stations=2),
    CadPoints: lambda mesh: CadPoints("points", tied_wing(), where=np.s_[3:90:7], direction="yx"),
    CadShapes: lambda mesh: CadShapes("thicker", tied_wing(), [swollen_wing()]),
    CoarseNet: lambda mesh: CoarseNet.of(wing_model(), mesh, Local("bump", direction="normal"), n=4),
    Camber: lambda mesh: Camber("camber", ReferenceAxis.of(mesh), stations=3),
    Chord: lambda mesh: Chord("chord", ReferenceAxis.of(mesh), stations=3),
    Dihedral: lambda mesh: Dihedral("dihedral", ReferenceAxis.of(mesh), stations=3),
    FreeForm: lambda mesh: FreeForm("shape", Lattice.box(mesh, n=(4, 2, 3)), direction="xy"),
    Local: lambda mesh: Local("bump", ~NearPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), "normal"),
    OfPart: lambda mesh: twisted_upper_side("part"),
    RadiusFactor: lambda mesh: RadiusFactor("radius", [(0.1, 0.3, 0.0), (0.4, -0.2, 1.0)], stations=4),
    Rotation: lambda mesh: Rotation("flap", Hinge((0.6, 0.0, 0.2), (0.9, 0.1, 1.1)), [3, 8], blend=0.2),
    Span: lambda mesh: Span("span", ReferenceAxis.of(mesh), stations=3),
    Sweep: lambda mesh: Sweep("sweep", ReferenceAxis.of(mesh), stations=3),
    Taper: lambda mesh: Taper("taper", ReferenceAxis.of(mesh)),
    ThicknessFactor: lambda mesh: ThicknessFactor("thickness", ReferenceAxis.of(mesh), stations=3),
    Translation: lambda mesh: Translation("position", "yx"),
    Twist: lambda mesh: Twist("twist", ReferenceAxis.of(mesh, at=0.4), stations=3),
    UserVariable: lambda mesh: swelling("swelling"),
}
"""Every kind of variable, on a mesh of `wing_model`: all of them pass the same tests of their derivatives."""

OF_SECTIONS = {CurvePoints: lambda mesh: CurvePoints("points", direction="xz", edges=True)}
"""Those of sections alone, on a mesh of `section_model`."""

CONSTRAINTS = {
    TangentContinuity: lambda: TangentContinuity(max_kink=80.0),
    InPlane: lambda: InPlane(NearPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), normal=(0.2, 1.0, 0.3)),
    Linked: lambda: Linked([3, 8, 5], [11, 2, 14], directions=(1.0, 2.0, 0.5)),
    Mirrored: lambda: Mirrored((0.0, 1.0, 0.0)),
    Opposite: lambda: Opposite([3, 8, 5], [11, 2, 14]),
    Pinned: lambda: Pinned([4, 9], "xy"),
    EqualDisplacement: lambda: EqualDisplacement([3, 8, 5, 17], "yz"),
}
"""Every kind of linear constraint, on the same mesh."""
