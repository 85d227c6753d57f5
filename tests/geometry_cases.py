"""Surfaces with known measures, and what every measure must pass."""

from dataclasses import replace

import numpy as np
from mover_cases import rotation

from bspline_mdao.core.measures.area import ProjectedArea, SurfaceArea
from bspline_mdao.core.measures.camber_surface import CamberSurface
from bspline_mdao.core.measures.clearance import Clearance, PlaneClearance
from bspline_mdao.core.measures.curvature import Curvature
from bspline_mdao.core.measures.section_area import SectionArea
from bspline_mdao.core.measures.section_thickness import SectionThickness
from bspline_mdao.core.measures.thickness import Thickness
from bspline_mdao.core.measures.volume import EnclosedVolume
from bspline_mdao.core.measures.wing_edges import LeadingEdgeRadius, TrailingEdgeAngle
from bspline_mdao.core.mesh.frame import Plane
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.generators import naca_section


def surface_of(*sheets, planes=()):
    """Surface of sheets of nodes, each of shape (ni, nj, 3); nodes at one place are one."""
    nodes = np.concatenate([sheet.reshape(-1, 3) for sheet in sheets])
    _, first, number = np.unique(np.round(nodes, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    number = np.split(number.ravel(), np.cumsum([sheet[..., 0].size for sheet in sheets])[:-1])
    faces = tuple(ids.reshape(sheet.shape[:2]) for ids, sheet in zip(number, sheets))
    names = tuple(f"block {n}, wall" for n in range(1, len(sheets) + 1))
    return SurfaceGrid(nodes[first], np.arange(len(first)), faces, names, ("wall",) * len(sheets), tuple(planes))


def box_sheets(counts=(4, 5, 6), low=(0.0, 0.0, 0.0), high=(1.0, 2.0, 3.0)):
    """Six sheets about a box, their normals outwards, with uneven nodes."""
    axes = [a + (b - a) * np.linspace(0.0, 1.0, n) ** 1.2 for a, b, n in zip(low, high, counts)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    sheets = []
    for d in range(3):
        first, second = np.take(nodes, 0, axis=d), np.take(nodes, -1, axis=d)
        sheets += [first, second.swapaxes(0, 1)] if d == 1 else [first.swapaxes(0, 1), second]
    return sheets


def box(counts=(4, 5, 6)):
    """Box of 1 m x 2 m x 3 m."""
    return surface_of(*box_sheets(counts))


def sphere(n=8, radius=1.5):
    """Sphere of six blocks."""
    sheets = box_sheets((n, n, n), low=(-1.0,) * 3, high=(1.0,) * 3)
    sheets = [np.tan(0.25 * np.pi * sheet) for sheet in sheets]
    return surface_of(*(radius * sheet / np.linalg.norm(sheet, axis=-1, keepdims=True) for sheet in sheets))


def wing_sheets(n_chord=17, n_span=5, chord=2.0, span=3.0, thickness=0.12):
    """Upper and lower side of a rectangular wing of NACA sections, and its flat tip; normals outwards."""
    section, z = naca_section(thickness), np.linspace(0.0, span, n_span) ** 1.1 * span**-0.1
    fractions = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n_chord))
    sides = [chord * section.points(side, fractions[None], np.ones(1))[0] for side in (1, -1)]
    upper, lower = (
        np.stack([np.tile(side[:, :1], n_span), np.tile(side[:, 1:], n_span), np.tile(z, (n_chord, 1))], axis=-1)
        for side in sides
    )
    tip = np.stack([lower[:, -1], 0.5 * (lower[:, -1] + upper[:, -1]), upper[:, -1]], axis=1)
    return [upper.swapaxes(0, 1), lower, tip]


def rectangular_wing(**sizes):
    """Rectangular NACA wing with a flat tip that ends on the symmetry plane z = 0."""
    return surface_of(*wing_sheets(**sizes), planes=[Plane(np.array([0.0, 0.0, 1.0]), 0.0)])


def section_between_planes(span=3.0, **sizes):
    """Rectangular NACA wing without a tip, that ends on the symmetry planes z = 0 and z = span."""
    planes = [Plane(np.array([0.0, 0.0, 1.0]), place) for place in (0.0, span)]
    return surface_of(*wing_sheets(span=span, **sizes)[:2], planes=planes)


def naca_area(thickness=0.12):
    """Area of a NACA section of unit chord with its trailing edge closed."""
    coefficients = np.array([-0.1036, 0.2843, -0.3516, -0.1260])
    return 10.0 * thickness * (0.2969 / 1.5 + coefficients @ (1.0 / np.array([5.0, 4.0, 3.0, 2.0])))


def with_points(surface, points):
    """The same surface at other places."""
    return replace(surface, points=points)


def turned(surface, seed=3, offset=(0.3, -2.0, 1.1)):
    """Surface and its planes turned and moved."""
    turn = rotation(seed)
    planes = tuple(Plane(turn @ plane.normal, plane.offset + turn @ plane.normal @ offset) for plane in surface.planes)
    return replace(surface, points=surface.points @ turn.T + offset, planes=planes)


def roughened(surface, size=0.02, seed=4):
    """Nodes of a surface, each moved at random by this part of its diagonal."""
    return surface.points + size * surface.size * np.random.default_rng(seed).normal(size=surface.points.shape)


def assert_derivatives_are_exact(measure, size=0.01, seed=5):
    """Complex step to 1e-10, dot test to 1e-12, one pattern, at random nodes that have no symmetry."""
    rng = np.random.default_rng(seed)
    points = roughened(measure.surface, size, seed)
    change, bar = rng.normal(size=points.shape), rng.normal(size=int(np.prod(measure.shape)))
    jacobian = measure.partials(points)
    values = measure.evaluate(points + 1e-40j * change)
    exact = values.imag.ravel() / 1e-40
    forward, reverse = jacobian @ change.ravel(), jacobian.T @ bar
    assert values.shape == tuple(measure.shape)
    assert jacobian.shape == (bar.size, points.size)
    assert np.abs(exact).max() > 0.0
    np.testing.assert_allclose(forward, exact, rtol=1e-10, atol=1e-10 * np.abs(exact).max())
    scale = np.linalg.norm(bar) * np.linalg.norm(forward)
    assert abs(bar @ forward - reverse @ change.ravel()) <= 1e-12 * scale
    pattern = measure.partials(measure.surface.points)
    assert np.array_equal(pattern.indices, jacobian.indices)
    assert np.array_equal(pattern.indptr, jacobian.indptr)


MEASURES = {
    CamberSurface: lambda wing: CamberSurface.of(wing, 4, 5),
    Clearance: lambda wing: Clearance.from_points(wing, "wall", [[1.0, 2.0, 1.0], [0.5, -1.0, 2.0]]),
    Curvature: lambda wing: Curvature.integral(wing),
    EnclosedVolume: lambda wing: EnclosedVolume.of(wing, relative=True),
    LeadingEdgeRadius: lambda wing: LeadingEdgeRadius.at(wing, [0.2, 0.7], relative_to="chord"),
    PlaneClearance: lambda wing: PlaneClearance.of(wing, "wall", (0.0, -1.0, 0.0), (0.1, 1.0, 0.0)),
    ProjectedArea: lambda wing: ProjectedArea.of(wing),
    SectionThickness: lambda wing: SectionThickness.at(wing, [0.2, 0.6]),
    SurfaceArea: lambda wing: SurfaceArea.of(wing),
    Thickness: lambda wing: Thickness.at(wing, [[0.6, 0.0, 0.5], [1.1, 0.0, 2.0]]),
    TrailingEdgeAngle: lambda wing: TrailingEdgeAngle.at(wing, [0.2, 0.7]),
}
"""Every measure, on a `rectangular_wing`: all of them pass the same tests of their derivatives."""

OF_SECTIONS = {SectionArea: lambda section: SectionArea.of(section)}
"""Those of sections alone, on one `section_between_planes`."""
