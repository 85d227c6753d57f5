"""O-grids about sections: on the section, orthogonal and square, closed behind it, and exact where the mapping is."""

import numpy as np
import pytest

from bspline_mdao import find_topology
from bspline_mdao.core.generators.wing import flat_section
from bspline_mdao.errors import InputError
from bspline_mdao.generators import Section, cambered_section, naca_section, section_o_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality


def circle(n=401):
    """Section whose corner at the trailing edge is a straight line: nothing is to be mapped."""
    angle = np.linspace(np.pi, 0.0, n)
    points = 0.5 * np.stack([1.0 + np.cos(angle), np.sin(angle)], axis=1)
    points[[0, -1]] = [[0.0, 0.0], [1.0, 0.0]]
    return Section.symmetric(points, nose_radius=0.5)


SECTIONS = {"NACA 0012": naca_section(0.12), "cambered": cambered_section(0.1, 0.02), "circle": circle()}

sections = pytest.mark.parametrize("section", SECTIONS.values(), ids=SECTIONS)


def plane(section, n_around=64, **options):
    """Complex nodes of the plane z = 0, shape (n_around + 1, n_away + 1)."""
    nodes = section_o_grid(section, n_around, **options).blocks[0].nodes
    np.testing.assert_array_equal(nodes[:, :, 1], nodes[:, :, 0] + [0.0, 0.0, 1.0])
    return nodes[:, :, 0, :2] @ [1.0, 1.0j]


@sections
def test_the_block_is_valid_right_handed_closed_and_has_its_patches(section):
    grid = section_o_grid(section, 32)
    topology = find_topology(grid)
    cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    assert (len(topology.interfaces), topology.near_misses) == (1, ())
    assert cells.n_inverted == 0
    assert {face.patch for face in topology.boundary} == {"wing", "farfield", "symmetry"}
    i, j = np.diff(grid.blocks[0].nodes[:2, 0, 0], axis=0)[0], np.diff(grid.blocks[0].nodes[0, :2, 0], axis=0)[0]
    assert np.cross(i, j)[2] > 0.0


@sections
def test_wall_nodes_are_on_the_section_to_a_millionth_of_the_chord(section):
    nodes, fractions = plane(section)[:, 0], np.linspace(0.0, 1.0, 4001)[None] ** 2
    sides = [section.points(side, fractions, np.ones(1))[0] @ [1.0, 1.0j] for side in (1, -1)]
    starts, steps = (np.concatenate(parts) for parts in ([s[:-1] for s in sides], [np.diff(s) for s in sides]))
    place = (nodes[:, None] - starts) / steps
    gaps = np.abs(place - np.clip(place.real, 0.0, 1.0)) * np.abs(steps)
    assert gaps.min(axis=1).max() < 1e-6
    assert nodes[0] == nodes[-1] == 1.0


@sections
def test_lines_cross_at_right_angles_and_cells_are_square(section):
    nodes = plane(section, 256)
    along, away = nodes[2:, 1:-1] - nodes[:-2, 1:-1], nodes[1:-1, 2:] - nodes[1:-1, :-2]
    off_corner = slice(8, -8)  # the corner of the trailing edge is mapped to a straight line
    angle, ratio = np.angle(away / along)[off_corner], np.abs(away / along)[off_corner]
    np.testing.assert_allclose(angle, np.pi / 2, atol=0.02)
    np.testing.assert_allclose(ratio, 1.0, rtol=0.02)


@sections
def test_the_outer_boundary_is_a_circle_of_the_radius_asked_for(section):
    outer = plane(section, far=40.0, n_away=20)[:, -1]
    middle = 0.5 * (outer.real.max() + outer.real.min())
    np.testing.assert_allclose(np.abs(outer - middle), 40.0, rtol=1e-3)
    assert plane(section, far=40.0, n_away=20).shape == (65, 21)


def test_every_second_node_is_the_grid_of_half_the_cells():
    fine, coarse = (plane(naca_section(0.12), n, n_away=n // 2) for n in (64, 32))
    np.testing.assert_allclose(fine[::2, ::2], coarse, atol=1e-9)


def test_a_grid_of_the_default_radius_has_as_many_cells_away_as_around():
    assert plane(naca_section(0.12), 64).shape == (65, 65)


def test_a_symmetric_section_has_a_symmetric_grid():
    nodes = plane(naca_section(0.12))
    np.testing.assert_allclose(nodes[::-1], nodes.conj(), atol=1e-12)


@sections
def test_first_cells_have_the_height_asked_for_on_every_ray_and_grow_evenly(section):
    nodes = plane(section, 48, far=30.0, n_away=40, off_wall=2e-5)
    lengths = np.abs(np.diff(nodes, axis=1))
    growth = lengths[:, 1:-1] / lengths[:, :-2]
    np.testing.assert_allclose(lengths[:, 0], 2e-5, rtol=1e-3)
    assert 1.0 < growth.min() < growth.max() < 1.5
    assert np.ptp(growth[:, :20], axis=0).max() < 0.01


def test_rays_and_outer_cells_are_those_of_the_grid_without_a_height():
    section = cambered_section(0.1, 0.02)
    asked, plain = (plane(section, 48, far=30.0, n_away=n, off_wall=height) for n, height in ((40, 1e-5), (400, None)))
    np.testing.assert_allclose(asked[:, [0, -1]], plain[:, [0, -1]], atol=1e-12)
    chords, offsets = np.diff(plain, axis=1)[:, None], asked[:, 1:-1, None] - plain[:, None, :-1]
    place = offsets / chords
    distances = np.abs(place - np.clip(place.real, 0.0, 1.0)) * np.abs(chords)
    assert (distances.min(axis=2) / np.abs(asked[:, 1:-1] - 0.5)).max() < 1e-3
    np.testing.assert_allclose(np.abs(np.diff(asked, axis=1)[:, -1]), 2.0 * np.pi / 48 * 30.0, rtol=0.15)


@pytest.mark.parametrize(
    ("section", "options", "words"),
    [
        (flat_section(), {}, "the nose is sharp"),
        (naca_section(), {"n_around": 7}, "7 cells around it; give"),
        (naca_section(), {"n_away": 3}, "64 cells around it and 3 away"),
        (naca_section(), {"far": 0.4}, "the far field at 0.4 chords cuts it"),
        (naca_section(), {"off_wall": -1.0}, "stretching: 65 points with end intervals"),
    ],
)
def test_what_makes_no_grid_is_refused(section, options, words):
    with pytest.raises(InputError, match=words):
        section_o_grid(section, **options)
