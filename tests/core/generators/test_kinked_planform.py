"""Wings with kinks: straight panels, nodes and edges of blocks at kinks, and grids without inverted cells."""

import numpy as np
import pytest

from bspline_mdao import InputError, find_topology
from bspline_mdao.generators import KinkedPlanform, Planform, Wing, airfoil, hh_wing_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality

SECTION = airfoil("naca2412").section

PLANFORMS = {
    "two panels": [[0.0, 0.0, 1.6], [1.2, 0.9, 1.0], [4.0, 1.9, 0.5]],
    "three panels": [[0.0, 0.0, 1.6], [1.2, 0.9, 1.0], [2.5, 1.2, 0.8], [4.0, 1.9, 0.5]],
    "kink at the tip": [[0.0, 0.0, 1.0], [2.8, 0.3, 0.8], [3.0, 0.45, 0.5]],
    "swept forward inside": [[0.0, 0.0, 1.0], [1.5, -0.4, 0.9], [3.0, 0.2, 0.6]],
    "double delta in millimetres": [[0.0, 0.0, 3e3], [1e3, 2e3, 1.2e3], [2e3, 2.4e3, 6e2]],
}

planforms = pytest.mark.parametrize("stations", PLANFORMS.values(), ids=PLANFORMS)


def test_a_planform_of_one_panel_is_the_trapezoid():
    slope = np.degrees(np.arctan(0.25))
    one, other = KinkedPlanform([[0.0, 0.0, 1.0], [2.0, 0.5, 0.6]]), Planform(1.0, 2.0, 0.6, slope)
    for name in ("root_chord", "tip_chord", "semi_span", "aspect_ratio", "trailing_edge_sweep"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-12)
    grids = [hh_wing_grid(Wing(planform, SECTION), (6, 7, 6)).to_vector() for planform in (one, other)]
    np.testing.assert_allclose(*grids, atol=1e-12)


@planforms
@pytest.mark.parametrize("n_span", [13, (21, 9)])
def test_no_cell_is_inverted_and_blocks_meet_one_to_one(stations, n_span):
    grid = hh_wing_grid(Wing(KinkedPlanform(stations), SECTION), (9, 9, n_span))
    topology = find_topology(grid)
    cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    n_kinks = len(stations) - 2
    assert (cells.n_inverted, topology.near_misses) == (0, ())
    assert cells.min_corner > 0.3
    assert len(grid.blocks) == 12 + 6 * n_kinks
    assert len(topology.interfaces) == 19 + 12 * n_kinks
    assert {face.patch for face in topology.boundary} == {"wing_upper", "wing_lower", "symmetry", "farfield"}


@planforms
def test_lines_of_the_wing_are_straight_in_each_panel_and_bend_at_nodes(stations):
    stations = np.array(stations)
    grid = hh_wing_grid(Wing(KinkedPlanform(stations), SECTION, tip_length=1e-3 * stations[-1, 0]), (9, 9, 21))
    blocks = {block.name: block.nodes for block in grid.blocks}
    for number in range(1, len(stations)):
        (z, x, chord), (other_z, *_) = stations[number - 1], stations[number]
        for side, row in (("above", 0), ("below", -1)):
            wall = blocks[f"wing {side} panel {number}"][:, row]
            np.testing.assert_allclose(wall[[0, -1], 0], [[x, 0.0, z], [x + chord, 0.0, z]], atol=1e-9 * chord)
            edges = wall[[0, -1]]
            expected = [
                np.interp(edge[:, 2], stations[:, 0], line)
                for edge, line in zip(edges, (stations[:, 1], stations[:, 1:].sum(axis=1)))
            ]
            np.testing.assert_allclose(edges[..., 0], expected, atol=1e-9 * chord)
            np.testing.assert_allclose(wall[:, -1, 2], other_z, rtol=1e-9)


@pytest.mark.parametrize(
    ("stations", "message"),
    [
        ([[0.0, 0.0, 1.0]], r"stations of shape \(1, 3\); give two or more"),
        ([[0.0, 0.0, 1.0], [2.0, np.nan, 1.0]], "two or more of finite span"),
        ([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 0.0, 1.0]], "give spans ascending from 0"),
        ([[0.5, 0.0, 1.0], [2.0, 0.0, 1.0]], "give spans ascending from 0"),
        ([[0.0, 0.0, 1.0], [2.0, 0.0, 0.0]], "positive chords"),
    ],
)
def test_stations_that_are_no_planform_are_refused(stations, message):
    with pytest.raises(InputError, match=message):
        KinkedPlanform(stations)


def test_too_few_nodes_for_the_panels_are_refused():
    wing = Wing(KinkedPlanform(PLANFORMS["three panels"]), SECTION)
    with pytest.raises(InputError, match="9 nodes along 3 panels; give 10 at least"):
        hh_wing_grid(wing, (9, 9, 9))


def test_sections_between_are_those_of_their_stations_and_blended_in_the_panels():
    planform = KinkedPlanform([[0.0, 0.0, 1.6], [1.2, 0.9, 1.0], [2.5, 1.2, 0.8], [4.0, 1.9, 0.5]])
    names = {0.0: "naca2414", 1.2: "naca4412", 2.5: "naca0010", 4.0: "naca2308"}
    root, *between, tip = ((place, airfoil(name).section) for place, name in names.items())
    wing = Wing(planform, root[1], tip[1], sections_between=between)
    grid = hh_wing_grid(wing, (17, 9, 19))
    cells = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    assert (cells.n_inverted, len(find_topology(grid).near_misses)) == (0, 0)
    blocks = {block.name: block.nodes for block in grid.blocks}
    for number, (place, section) in enumerate([root, *between], 1):
        _, x, chord = planform.stations[number - 1]
        for side, sign, row in (("above", 1, 0), ("below", -1, -1)):
            wall = blocks[f"wing {side} panel {number}"][:, row, 0]
            assert wall[:, 2] == pytest.approx(place, abs=1e-12)
            dense = section.points(sign, np.linspace(0.0, 1.0, 20001)[None] ** 2, np.ones(1))[0]
            heights = np.interp((wall[:, 0] - x) / chord, *dense.T)
            np.testing.assert_allclose(wall[:, 1] / chord, heights, atol=2e-6)
    fractions = np.broadcast_to(np.linspace(0.0, 1.0, 12), (len(wing.stations), 12))
    at = np.argmin(np.abs(wing.stations - 0.6))
    weight = wing.stations[at] / 1.2
    expected = sum(
        part * section.points(1, fractions[:1], np.ones(1))[0, :, 1]
        for part, section in ((1.0 - weight, root[1]), (weight, between[0][1]))
    )
    chord = planform.x(1.0, wing.stations[at]) - planform.x(0.0, wing.stations[at])
    np.testing.assert_allclose(wing.sections(1, fractions)[at, :, 1] / chord, expected, atol=1e-12)


def test_without_a_section_at_the_tip_the_last_one_stays():
    planform, other = KinkedPlanform(PLANFORMS["two panels"]), airfoil("naca0009").section
    wing = Wing(planform, SECTION, sections_between=[(1.2, other)])
    assert wing.outer_section is other
    fractions = np.broadcast_to(np.linspace(0.0, 1.0, 9), (len(wing.stations), 9))
    expected = Wing(planform, other).sections(1, fractions)[wing.stations >= 1.2]
    np.testing.assert_allclose(wing.sections(1, fractions)[wing.stations >= 1.2], expected, atol=1e-12)


@pytest.mark.parametrize("places", [(1.0,), (2.5, 1.2), (1.2, 1.2)])
def test_sections_away_from_kinks_or_out_of_order_are_refused(places):
    between = [(place, SECTION) for place in places]
    with pytest.raises(InputError, match=r"one of the kinks of the planform, \[1.2, 2.5\], from the root on"):
        Wing(KinkedPlanform(PLANFORMS["three panels"]), SECTION, sections_between=between)
