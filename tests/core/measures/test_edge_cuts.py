"""Sections of surfaces: points on the edges of quads."""

import numpy as np
import pytest
from geometry_cases import box, sphere

from bspline_mdao.core.measures.camber_surface import CamberSurface
from bspline_mdao.core.measures.edge_cuts import cut_edges, edges_of_quads
from bspline_mdao.errors import InputError


def test_every_edge_is_there_once_and_collapsed_ones_are_not():
    quads = np.array([[0, 1, 2, 3], [1, 4, 2, 2]])
    assert edges_of_quads(quads).tolist() == [[0, 1], [0, 3], [1, 2], [1, 4], [2, 3], [2, 4]]


@pytest.mark.parametrize("height", [0.0, 0.3, 1.0])
def test_a_box_is_cut_on_its_outline_also_at_its_ends(height):
    surface = box((4, 5, 6))
    cuts = cut_edges(edges_of_quads(surface.quads), surface.points[:, 0] - height)
    places = cuts.at(surface.points)
    np.testing.assert_allclose(places[:, 0], height, atol=1e-15)
    assert (np.isclose(places[:, 1] % 2.0, 0.0) | np.isclose(places[:, 2] % 3.0, 0.0) | (height != 0.3)).all()
    np.testing.assert_allclose(cuts.matrix(surface.n_points) @ surface.points, places, atol=1e-15)
    np.testing.assert_allclose(cuts.weights.sum(axis=1), 1.0, atol=1e-15)


def test_nodes_within_the_tolerance_are_on_the_section():
    edges, heights = np.array([[0, 1], [1, 2]]), np.array([1e-12, 1.0, 2.0])
    assert len(cut_edges(edges, heights).nodes) == 0
    assert cut_edges(edges, heights, 1e-9).weights.tolist() == [[1.0, 0.0]]


def test_a_camber_surface_cannot_end_where_a_round_tip_has_no_chord():
    with pytest.raises(
        InputError, match=r"no chord at 1\.48463 along the span, .* from -1\.48463 to 1\.48463; give ends"
    ):
        CamberSurface.of(sphere(9), 4, 5)
    assert CamberSurface.of(sphere(9), 4, 5, ends=(0.0, 1.2)).shape == (4, 5, 3)
