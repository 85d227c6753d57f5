"""C-grids about sections: three blocks and a cut, on the section, along the bisector, growing behind, with layers."""

import numpy as np
import openmdao.api as om
import pytest
from scipy.spatial import cKDTree

from bspline_mdao import EulerFlow, find_topology, fit_grid
from bspline_mdao.core.generators.wing import flat_section
from bspline_mdao.errors import InputError
from bspline_mdao.flow import run_flow
from bspline_mdao.generators import (
    Airfoil,
    airfoil,
    airfoil_grid,
    cambered_section,
    naca_airfoil,
    naca_section,
    section_c_grid,
)
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality

SECTIONS = {
    "NACA 0012": naca_section(0.12),
    "cambered": cambered_section(0.1, 0.03),
    "thick": airfoil("naca4440").section,
    "cusped": airfoil("cst:0.17,0.16,0.3/-0.17,-0.1,0.3").section,
}

sections = pytest.mark.parametrize("section", SECTIONS.values(), ids=SECTIONS)


def planes(grid):
    """Complex nodes of the plane z = 0 of each block."""
    return [block.nodes[:, :, 0, :2] @ [1.0, 1.0j] for block in grid.blocks]


def problem_of(model):
    """Pose a flow about a section at Mach 0.5 and 1.25 degrees."""
    problem = om.Problem(EulerFlow(model=model, reference_area=1.0), reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", 0.5)
    problem.set_val("alpha", 1.25, units="deg")
    return problem


@sections
@pytest.mark.parametrize("layers", [{}, {"off_wall": 2e-6, "n_away": 100}], ids=["inviscid", "layers"])
def test_blocks_meet_one_to_one_at_the_cut_and_no_cell_is_inverted(section, layers):
    grid = section_c_grid(section, 64, **layers)
    topology = find_topology(grid)
    cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    assert (len(topology.interfaces), topology.near_misses) == (3, ())
    assert {face.patch for face in topology.boundary} == {"wing", "farfield", "symmetry"}
    assert cells.n_inverted == 0
    assert cells.min_corner > (0.2 if layers else 0.5)
    below, _, above = planes(grid)
    np.testing.assert_array_equal(below[::-1, 0], above[:, 0])


@sections
def test_first_cells_at_the_wall_are_as_high_as_asked_and_stand_upright(section):
    _, around, _ = planes(section_c_grid(section, 64, off_wall=1e-5, n_away=80))
    np.testing.assert_allclose(np.abs(around[:, 1] - around[:, 0]), 1e-5, rtol=2e-3)
    angles = np.abs(np.angle((around[1:-1, 1] - around[1:-1, 0]) / (around[2:, 0] - around[:-2, 0])))
    np.testing.assert_allclose(angles[2:-2], 0.5 * np.pi, atol=0.04)
    assert around[0, 0] == around[-1, 0] == 1.0


def test_wall_nodes_are_those_of_the_o_grid():
    c_grid, o_grid = (airfoil_grid("naca4412", 48, 12, topology=topology) for topology in "CO")
    np.testing.assert_allclose(c_grid.blocks[1].nodes[:, 0], o_grid.blocks[0].nodes[:, 0], atol=1e-12)


@sections
def test_the_cut_leaves_along_the_bisector_with_the_intervals_of_the_wall_and_grows_by_a_sixth(section):
    _, around, above = planes(section_c_grid(section, 256, n_away=16))
    wall, steps = np.abs(np.diff(around[:, 0]))[[0, -1]].mean(), np.abs(np.diff(above[:, 0]))
    assert steps[0] == pytest.approx(wall, rel=0.01)
    assert (steps[1:] / steps[:-1]).max() < 1.17
    ends = np.angle([1.0 - around[1, 0], 1.0 - around[-2, 0]])  # downstream along both sides
    assert np.angle(above[1, 0] - 1.0) == pytest.approx(ends.mean(), abs=0.02)


def test_the_outer_boundary_is_as_far_away_as_asked_at_the_least():
    grid = section_c_grid(naca_section(0.12), 32, 30.0, 16)
    below, around, above = planes(grid)
    outside = np.concatenate([around[:, -1], below[:, -1], above[:, -1], above[-1], below[0]])
    assert np.abs(outside).min() > 29.0
    assert np.abs(outside).max() < 62.0


def test_a_symmetric_section_has_a_symmetric_grid():
    below, around, above = planes(section_c_grid(naca_section(0.12), 32, n_away=12))
    np.testing.assert_allclose(around, np.conj(around[::-1]), atol=1e-10)
    np.testing.assert_allclose(below, np.conj(above[::-1]), atol=1e-8)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_around": 9}, "C-grid about a section: 9 cells around it and 48 away"),
        ({"n_wake": 3}, "3 cells along the cut; give 4 or more"),
        ({"far": 0.2}, "the far field at 0.2 chords cuts it"),
        ({"section": flat_section()}, "the nose is sharp"),
    ],
)
def test_grids_that_cannot_be_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        section_c_grid(**{"section": naca_section(0.12), **options})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"topology": "H"}, "topology 'H'; give one of O, C"),
        ({"n_wake": 20}, "20 cells along a wake, which a C-grid has"),
    ],
)
def test_an_airfoil_has_one_of_the_topologies(options, message):
    with pytest.raises(InputError, match=message):
        airfoil_grid("naca0012", 32, **options)


def test_lift_and_drag_are_those_on_the_o_grid_within_what_both_are_off_by():
    flows = []
    for options in ({}, {"topology": "C", "n_wake": 28}):
        flows.append(run_flow(problem_of(fit_grid(airfoil_grid("naca0012", 64, 32, **options)))))
    assert flows[1]["CL"] == pytest.approx(flows[0]["CL"], rel=0.01)
    assert flows[1]["CD"] == pytest.approx(flows[0]["CD"], abs=1e-4)


BLUNT = {
    "NACA 0012": naca_airfoil("0012", blunt=True),
    "NACA 23012": naca_airfoil("23012", blunt=True),
    "flat back": airfoil("cst:0.2,0.2,0.2/-0.2,-0.2,-0.2/0.1"),
    "slanted": Airfoil(naca_airfoil("4412", blunt=True).points[3:]),
}
"""The last one has three points less on its upper side, and a base that is not across."""

blunt = pytest.mark.parametrize("section", BLUNT.values(), ids=BLUNT)


@blunt
@pytest.mark.parametrize("layers", [{}, {"first_cell": 2e-6}], ids=["inviscid", "layers"])
def test_a_blunt_base_is_a_wall_with_a_block_behind_it_and_first_cells_as_high(section, layers):
    grid = airfoil_grid(section, 64, topology="C", **layers)
    topology = find_topology(grid)
    cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    assert [block.name for block in grid.blocks][-1] == "behind the base"
    assert (len(topology.interfaces), topology.near_misses) == (4, ())
    assert {face.patch for face in topology.boundary} == {"airfoil", "base", "farfield", "symmetry"}
    assert cells.n_inverted == 0
    assert cells.min_corner > (0.1 if layers else 0.5)
    _, around, _, behind = planes(grid)
    corners = section.points[[-1, 0]] @ [1.0, 1.0j]
    np.testing.assert_allclose(behind[0, [0, -1]], corners, atol=1e-9)
    np.testing.assert_allclose(around[[0, -1], 0], corners, atol=1e-9)
    if layers:
        heights = np.concatenate([np.abs(around[:, 1] - around[:, 0]), np.abs(behind[1] - behind[0])])
        np.testing.assert_allclose(heights, 2e-6, rtol=0.01)


@blunt
def test_wall_nodes_are_on_the_blunt_outline(section):
    wall = airfoil_grid(section, 96, 12, topology="C").blocks[1].nodes[:, 0, 0, :2]
    outline = section._curve(np.linspace(0.0, section._curve.x[-1], 200_001))
    gaps = cKDTree(outline).query(wall)[0]
    assert gaps.max() < 1e-5


def test_a_base_is_closed_when_asked_and_sections_of_nacas_are_blunt_when_asked():
    shapes = [len(airfoil_grid("naca0012", 32, 8, topology="C", base=base).blocks) for base in (None, "wall", "closed")]
    assert shapes == [3, 4, 3]
    section = BLUNT["NACA 0012"]
    shapes = [len(airfoil_grid(section, 32, 8, topology="C", base=base).blocks) for base in (None, "wall", "closed")]
    assert shapes == [4, 4, 3]
    with pytest.raises(InputError, match="base 'wall' of O-grids; give 'closed', or 'wall' and topology 'C'"):
        airfoil_grid(section, 32, base="wall")
    with pytest.raises(InputError, match="its trailing edge is sharp"):
        airfoil_grid(naca_airfoil("0012"), 32, topology="C", base="wall")
