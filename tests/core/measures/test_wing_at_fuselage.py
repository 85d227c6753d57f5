"""Sections of a wing that begins at a fuselage, where its root is curved, begin where they are whole."""

import numpy as np
import pytest
from ellipse_wing_cases import BULGE, SPAN, SWEEP, THICK, chord_at, wing

from bspline_mdao.core.design.reference_axis import chord_lines
from bspline_mdao.core.measures.edge_cuts import root_end
from bspline_mdao.core.measures.thickness import within_edges
from bspline_mdao.core.mesh.frame import surface_frame
from bspline_mdao.measures import SectionThickness, Thickness


def test_edges_are_those_of_whole_sections():
    surface = wing()
    leading, trailing = within_edges(surface, chord=(0.0, 1.0), span=(0.0, 1.0), n=5)
    at = np.linspace(0.4 + BULGE, SPAN, 5)
    np.testing.assert_allclose(leading[:, 2], at, atol=1e-12)
    np.testing.assert_allclose(leading[:, 0], SWEEP * at, atol=1e-9)
    np.testing.assert_allclose(trailing[:, 0], SWEEP * at + chord_at(at), atol=1e-9)
    ratio = SectionThickness.at(surface, [0.0, 0.3, 0.9], chordwise=[0.5]).evaluate(surface.points)
    np.testing.assert_allclose(ratio, THICK, rtol=5e-3)
    thickness = Thickness.grid(surface, 3, 3, chord=(0.25, 0.75), span=(0.0, 0.9)).evaluate(surface.points)
    np.testing.assert_allclose(thickness[0, 1], THICK * chord_at(0.4 + BULGE), rtol=5e-3)


def test_the_axis_goes_on_straight_to_the_root():
    surface = wing()
    frame = surface_frame(surface.points, surface.planes)
    assert frame.origin[2] == pytest.approx(0.4)  # where the surface begins, which does not reach the plane
    at = np.array([0.0, 0.1, 0.5, 1.0]) * frame.span
    places = frame.to_local(surface.points)[:, 2]
    lines = chord_lines(surface.points, surface.quads, places, at, frame.axes[0])
    np.testing.assert_allclose(lines.leading[:, 0], SWEEP * (0.4 + at), atol=2e-3)
    np.testing.assert_allclose(lines.chords[:, 0], chord_at(0.4 + at), atol=2e-3)


def test_one_side_of_a_wing_begins_where_it_begins():
    surface = wing()
    upper = surface.quads[(surface.points[surface.quads][..., 1] >= -1e-12).all(axis=1)]
    assert root_end(surface.quads, surface.points[:, 2]) == pytest.approx(0.4 + BULGE)
    assert root_end(upper, surface.points[:, 2]) == pytest.approx(0.4)


def test_a_closed_body_begins_where_it_begins():
    corners = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(-1, 3).astype(float)
    box = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    assert root_end(box, corners[:, 0] + 0.2) == 0.2
