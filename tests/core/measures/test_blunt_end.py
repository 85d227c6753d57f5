"""Which end of sections is blunt is found on wings either way round, and nothing is said about other bodies."""

import numpy as np
import pytest
from geometry_cases import box, rectangular_wing, section_between_planes, sphere, surface_of, wing_sheets

from bspline_mdao.core.measures.blunt_end import is_blunt_downstream
from bspline_mdao.core.mesh.frame import surface_frame


def is_backwards(surface, matrix):
    """Whether a surface is found to lie the other way round, after a rotation by a matrix of whole numbers."""
    points = surface.points @ np.array(matrix, dtype=float).T
    return is_blunt_downstream(points, surface.quads, surface_frame(points))


RIGHT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 1], [0, -1, 0], [1, 0, 0]]
REVERSED = [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]


@pytest.mark.parametrize("sizes", [{}, {"n_chord": 7, "n_span": 3}, {"n_chord": 41, "thickness": 0.03}])
@pytest.mark.parametrize("case", [rectangular_wing, section_between_planes])
def test_a_wing_that_flies_backwards_is_found(case, sizes):
    assert [is_backwards(case(**sizes), matrix) for matrix in RIGHT] == [False, False]
    assert [is_backwards(case(**sizes), matrix) for matrix in REVERSED] == [True, True]


def wedge():
    """Sharp in front and cut off behind."""
    x, z = np.meshgrid(np.linspace(0.0, 2.0, 9), np.linspace(0.0, 3.0, 6), indexing="ij")
    upper = np.stack([x, 0.1 * x, z], axis=-1)
    base = np.stack([upper[-1] * [1, -1, 1], upper[-1]], axis=0)
    return surface_of(upper.swapaxes(0, 1), upper * [1, -1, 1], base)


@pytest.mark.parametrize("body", [box(), sphere(), wedge()], ids=["box", "sphere", "wedge"])
def test_nothing_is_said_of_bodies_alike_at_both_ends_or_cut_off(body):
    assert not any(is_backwards(body, matrix) for matrix in (*RIGHT, *REVERSED))


def test_nothing_is_said_of_several_bodies():
    slat = [sheet * [0.2, 0.2, 1.0] - [3.0, 0.0, 0.0] for sheet in wing_sheets(thickness=0.02)]
    wing = [sheet * [-1.0, -1.0, 1.0] for sheet in wing_sheets()]
    assert is_backwards(surface_of(*wing), RIGHT[0])
    assert not is_backwards(surface_of(*slat, *wing), RIGHT[0])
