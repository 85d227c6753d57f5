"""Generated H-H grids: validity, spacings, topology, geometry."""

import warnings

import numpy as np
import pytest

from bspline_mdao.core.generators import wing
from bspline_mdao.core.generators.canonical import ONERA_D_UPPER
from bspline_mdao.core.generators.stretching import geometric_last, stretch, stretch_lines
from bspline_mdao.core.generators.wing import flat_section
from bspline_mdao.errors import InputError
from bspline_mdao.generators import (
    FarField,
    Planform,
    Section,
    Spacing,
    Wing,
    flat_plate_grid,
    hh_wing_grid,
    naca_section,
    onera_d_section,
    onera_m6_grid,
    onera_m6_planform,
)
from bspline_mdao.grids.cells.hexahedron import cell_quality
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.sharing import node_sharing

SPACING = Spacing(off_wall=2e-3, leading=3e-3, trailing=4e-3, tip=5e-3)


@pytest.fixture(scope="module")
def m6():
    return onera_m6_grid((21, 25, 19), spacing=SPACING)


@pytest.fixture(scope="module")
def plate():
    return flat_plate_grid((17, 21, 19))


def qualities(grid):
    return [cell_quality(block.nodes) for block in grid.blocks]


def edges(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=-1)


def test_equal_lines_have_the_points_of_the_first_which_cannot_be_changed():
    points = stretch(7, 0.1, 0.2)
    assert stretch(7, 0.1, 0.2) is points
    with pytest.raises(ValueError, match="read-only"):
        points[1] = 0.0


@pytest.mark.parametrize(("n", "first", "last"), [(9, 1e-3, 1e-3), (45, 1e-4, 0.15), (21, 0.06, 0.01), (11, 0.1, 0.1)])
def test_stretching_meets_both_end_intervals_exactly(n, first, last):
    points = stretch(n, first, last)
    assert (points[0], points[-1]) == (0.0, 1.0)
    np.testing.assert_allclose([points[1], 1.0 - points[-2]], [first, last], rtol=1e-9)


def test_stretching_between_geometric_ends_grows_at_a_constant_ratio():
    intervals = np.diff(stretch(65, 1e-4, geometric_last(65, 1e-4)))
    ratios = intervals[1:] / intervals[:-1]
    assert np.ptp(ratios) < 1e-6


def test_stretched_lines_of_different_lengths_have_the_same_end_intervals():
    lengths = np.array([1.0, 1.3, 0.7, 1.1])
    fractions = stretch_lines(lengths, 15, 0.01, 0.02)
    np.testing.assert_allclose(fractions[:, 1] * lengths, 0.01, rtol=1e-8)
    np.testing.assert_allclose((1.0 - fractions[:, -2]) * lengths, 0.02, rtol=1e-8)


@pytest.mark.parametrize(("n", "first", "last"), [(2, 0.1, 0.1), (9, 0.6, 0.6), (9, 0.0, 0.1), (9, -1.0, 0.1)])
def test_impossible_stretching_is_refused(n, first, last):
    with pytest.raises(InputError, match="stretching"):
        stretch(n, first, last)


def test_m6_planform_figures_are_consistent():
    planform = onera_m6_planform()
    assert planform.trailing_edge_sweep == pytest.approx(15.8, abs=0.05)
    assert planform.aspect_ratio == pytest.approx(3.8, abs=0.005)
    assert Planform.from_sweeps(1.0, 1.4843, 30.0, 15.8).taper == pytest.approx(0.562, abs=2e-3)


@pytest.mark.parametrize("section", [onera_d_section(), naca_section(0.12)])
@pytest.mark.parametrize("factor", [1.0, 0.3, 1e-3, 0.0])
def test_section_is_divided_by_arc_length_at_any_thickness(section, factor):
    points = section.points(1, np.linspace(0.0, 1.0, 4001)[None], np.array([factor]))[0]
    lengths = edges(points)
    assert lengths.sum() == pytest.approx(section.length(1, np.array([factor]))[0], rel=1e-4)
    np.testing.assert_allclose(lengths[20:], lengths.mean(), rtol=1e-3)


def test_published_section_is_reproduced_less_its_trailing_edge_thickness():
    x, y = onera_d_section().points(1, np.linspace(0.0, 1.0, 4001)[None], np.ones(1))[0].T
    ours = np.interp(ONERA_D_UPPER[5:, 0], x, y)
    np.testing.assert_allclose(ours, ONERA_D_UPPER[5:, 1] - 0.0007052 * ONERA_D_UPPER[5:, 0], atol=2e-6)


def test_section_that_does_not_close_is_refused():
    with pytest.raises(InputError, match="trailing edge"):
        Section.symmetric(ONERA_D_UPPER)


@pytest.fixture
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.slow
@pytest.mark.usefixtures("no_warnings")
@pytest.mark.parametrize("n", [3, 4, 5, 17, 53, 105, 401, 1001])
def test_stretching_is_found_over_a_wide_range_of_sizes_and_spacings(n):
    spacings = [1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.3, 0.9]
    for first in spacings:
        fitting = [last for last in (*spacings, geometric_last(n, first)) if first + last < 1.0]
        for last in fitting if n > 3 else [1.0 - first]:
            points = stretch(n, first, last)
            assert points[-1] == 1.0
            assert np.diff(points).min() > 0.0
            assert points[1] == pytest.approx(first, rel=1e-8)
            assert 1.0 - points[-2] == pytest.approx(last, rel=1e-8, abs=3e-16)


@pytest.mark.usefixtures("no_warnings")
@pytest.mark.parametrize("n", [3, 6, 54, 105, 1001])
def test_intervals_in_geometric_progression_fill_the_length(n):
    for first in (1e-9, 1e-5, 1e-3, 0.5 / n, (1.0 - 1e-8) / (n - 1), (1.0 - 1e-12) / (n - 1)):
        ratio = (geometric_last(n, first) / first) ** (1.0 / (n - 2))
        assert first * np.sum(ratio ** np.arange(n - 1)) == pytest.approx(1.0, rel=1e-7)


@pytest.mark.slow
@pytest.mark.usefixtures("no_warnings")
@pytest.mark.parametrize(
    ("shape", "spacing"),
    [
        ((5, 105, 5), Spacing()),  # as away from the wing in 73 x 105 x 53
        ((73, 5, 53), Spacing()),
        ((9, 41, 7), Spacing(1e-9, 1e-6, 1e-6, 1e-6)),
        ((9, 7, 15), Spacing(1e-2, 1e-2, 1e-3, 1e-6)),
    ],
)
@pytest.mark.parametrize("make", [onera_m6_grid, flat_plate_grid])
def test_grids_of_any_size_and_spacing_are_made_without_a_warning(make, shape, spacing):
    grid = make(shape, spacing)
    assert grid.shapes == (shape,) * 12
    assert all(np.isfinite(block.nodes).all() for block in grid.blocks)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(9, 9, 9), (9, 17, 11), (17, 13, 9), (33, 29, 21)])
@pytest.mark.parametrize("make", [onera_m6_grid, flat_plate_grid])
def test_all_cells_are_valid_and_right_handed_at_any_resolution(make, shape):
    for quality in qualities(make(shape)):
        assert quality.handedness == 1
        assert quality.min_corner.min() > 0.45


@pytest.mark.slow
def test_blocks_may_have_different_counts():
    grid = onera_m6_grid(((9, 17, 13), (11, 15), (13, 9)))
    assert grid.shapes[4] == (17, 15, 13)
    assert grid.shapes[6] == (9, 11, 9)
    assert min(quality.min_corner.min() for quality in qualities(grid)) > 0.4
    assert len(find_topology(grid).interfaces) == 19


@pytest.mark.slow
@pytest.mark.parametrize(
    "wing",
    [
        Wing(Planform(1.0, 3.0), naca_section(0.12)),
        Wing(Planform(1.0, 2.0, taper=0.5, leading_edge_sweep=20.0), naca_section(0.18), naca_section(0.1)),
        Wing(Planform(2.0, 3.0, taper=1.0, leading_edge_sweep=-20.0), naca_section(0.12), tip_length=0.2),
        Wing(Planform(1.0, 2.0, taper=0.4, leading_edge_sweep=35.0), flat_section()),
    ],
    ids=["rectangular", "two sections", "swept forward", "swept plate"],
)
def test_other_wings_have_valid_grids_and_the_same_topology(wing):
    grid = hh_wing_grid(wing, (15, 17, 13), Spacing(2e-3, 4e-3, 4e-3, 4e-3), FarField(distance=12.0))
    assert min(quality.min_corner.min() for quality in qualities(grid)) > 0.3
    assert len(find_topology(grid).interfaces) == 19


@pytest.mark.slow
def test_topology_is_twelve_blocks_with_nineteen_interfaces_and_no_cut(m6, plate):
    for grid in (m6, plate):
        topology = find_topology(grid)
        assert (len(topology.interfaces), len(topology.boundary), len(topology.segments)) == (19, 34, 12)
        assert not topology.near_misses
        kinds = [face.kind for face in topology.boundary]
        assert [kinds.count(kind) for kind in ("wall", "symmetry", "farfield")] == [2, 6, 26]


@pytest.mark.slow
@pytest.mark.parametrize("off_wall", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("make", [onera_m6_grid, flat_plate_grid])
def test_nodes_that_blocks_share_have_equal_bits(make, off_wall):
    grid = make((8, 15, 9), Spacing(off_wall=off_wall))
    topology = find_topology(grid)
    assert (len(topology.interfaces), len(topology.segments), topology.near_misses) == (19, 12, ())
    copies, points = node_sharing(topology).copies, grid.to_vector().view(np.int64).reshape(-1, 3)
    assert len(copies) > 1000
    np.testing.assert_array_equal(points[copies[:, 0]], points[copies[:, 1]])


@pytest.mark.slow
def test_spacings_next_to_the_wing_are_as_asked(m6):
    upstream, wing, downstream, outboard = (m6.blocks[n].nodes for n in (3, 4, 5, 10))
    surface = wing[:, 0]
    np.testing.assert_allclose(np.linalg.norm(surface[1, 0] - surface[0, 0]), SPACING.leading, rtol=5e-3)
    np.testing.assert_allclose(np.linalg.norm(surface[-1, 0] - surface[-2, 0]), SPACING.trailing, rtol=5e-3)
    np.testing.assert_allclose(np.linalg.norm(surface[:, -1] - surface[:, -2], axis=-1), SPACING.tip, rtol=5e-2)
    np.testing.assert_allclose(np.linalg.norm(upstream[-1, 0] - upstream[-2, 0], axis=-1), SPACING.leading, rtol=1e-6)
    np.testing.assert_allclose(downstream[1, 0, :, 0] - downstream[0, 0, :, 0], SPACING.trailing, rtol=1e-6)
    np.testing.assert_allclose(outboard[:, 0, 1, 2] - outboard[:, 0, 0, 2], SPACING.tip, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(wing[:, 1] - surface, axis=-1), SPACING.off_wall, rtol=5e-2)


@pytest.mark.slow
def test_default_spacings_are_the_papers_at_its_size_and_wider_on_coarser_grids():
    fine = onera_m6_grid((45, 65, 33)).blocks[4].nodes
    np.testing.assert_allclose(np.linalg.norm(fine[10:, 1, 0] - fine[10:, 0, 0], axis=-1), 1e-3, rtol=3e-2)
    coarse = onera_m6_grid((12, 17, 9)).blocks[4].nodes
    np.testing.assert_allclose(np.linalg.norm(coarse[6:, 1, 0] - coarse[6:, 0, 0], axis=-1), 4e-3, rtol=1e-1)


@pytest.mark.parametrize("chord", [0.4, 12.0])
def test_default_grids_scale_with_the_chord(chord):
    one, wing = (Wing(Planform(c, 3.0 * c, 0.7, 20.0), naca_section(0.12)) for c in (1.0, chord))
    unit = hh_wing_grid(one, (9, 13, 9)).to_vector()
    np.testing.assert_allclose(hh_wing_grid(wing, (9, 13, 9)).to_vector(), chord * unit, atol=1e-9 * chord)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(13, 17, 13), (17, 25, 13)])
def test_cells_of_coarse_default_grids_grow_less_than_with_the_spacings_of_the_papers_size(shape):
    def growth(*spacing):
        nodes = hh_wing_grid(Wing(Planform(1.0, 3.0), naca_section(0.12)), shape, *spacing).blocks[4].nodes
        along, off = (np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (nodes[:, 0, 0], nodes[0, :, 0]))
        return [np.exp(np.abs(np.diff(np.log(steps))).max()) for steps in (along, off)]

    default = np.array(growth())
    assert (default < 2.8).all()
    assert (default < np.subtract(growth(Spacing()), 0.05)).all()


@pytest.mark.slow
def test_surface_nodes_lie_on_the_wing(m6):
    surface = m6.blocks[4].nodes[:, 0]
    planform, (x, y, z) = onera_m6_planform(), np.moveaxis(surface, -1, 0)
    chord = planform.x(1.0, z) - planform.x(0.0, z)
    curve = onera_d_section().points(1, np.linspace(0.0, 1.0, 20001)[None], np.ones(1))[0]
    factor = Wing(planform, onera_d_section()).thickness_factor(z)
    expected = np.interp((x - planform.x(0.0, z)) / chord, *curve.T) * factor * chord
    np.testing.assert_allclose(y[3:], expected[3:], atol=2e-6)
    np.testing.assert_array_equal(y[[0, -1]], 0.0)
    np.testing.assert_array_equal(z[:, -1], planform.semi_span)


@pytest.mark.slow
def test_lower_side_mirrors_the_upper(m6):
    for below, above in ((0, 3), (1, 4), (2, 5), (6, 9), (7, 10), (8, 11)):
        np.testing.assert_array_equal(m6.blocks[below].nodes[:, ::-1] * [1.0, -1.0, 1.0], m6.blocks[above].nodes)


@pytest.mark.slow
def test_symmetry_plane_and_outer_boundaries_are_exactly_planar(m6, plate):
    for grid in (m6, plate):
        for n, block in enumerate(grid.blocks):
            above, outboard = (n // 3) % 2, n // 6
            outer = [(block.nodes[:, -1 if above else 0, :, 1], 10.0 if above else -10.0)]
            if n % 3 == 0:
                outer.append((block.nodes[0, ..., 0], -10.0))
            if not outboard:
                outer.append((block.nodes[:, :, 0, 2], 0.0))
            for values, expected in outer:
                np.testing.assert_allclose(values, expected, rtol=1e-14, atol=0.0)


def test_lines_leave_the_blunt_leading_edge_half_way_between_tangent_and_stagnation_line(m6):
    line = m6.blocks[4].nodes[0, :2, 9]
    x, y, z = line[1] - line[0]
    assert x / y == pytest.approx(-1.0, abs=0.1)
    assert abs(z / y) < 0.1


@pytest.mark.slow
def test_plate_has_curved_lines_and_q_like_the_papers():
    grid = flat_plate_grid((45, 45, 45))
    assert 0.74 < min(quality.q.min() for quality in qualities(grid)) < 0.9
    lines = grid.blocks[9].nodes.swapaxes(0, 1)
    away = lines - lines[0]
    across = np.cross(away, away[-1]) / np.linalg.norm(away[-1], axis=-1, keepdims=True)
    assert np.linalg.norm(across, axis=-1).max() > 0.05


def test_too_few_nodes_are_refused():
    with pytest.raises(InputError, match="give 5 at least"):
        onera_m6_grid((9, 4, 9))


@pytest.mark.parametrize("changes", [{"taper": 0.0}, {"semi_span": -1.0}, {"leading_edge_sweep": 89.0}])
def test_impossible_planforms_are_refused(changes):
    with pytest.raises(InputError, match="planform"):
        Planform(**changes)


def test_arc_lengths_of_a_section_are_found_once(monkeypatch):
    grid = onera_m6_grid((7, 9, 7))
    fresh = hh_wing_grid(Wing(onera_m6_planform(), onera_d_section()), (7, 9, 7))
    arcs, n_curves = wing._arcs, []

    def counted(curve, factors):
        n_curves.append(len(factors))
        return arcs(curve, factors)

    monkeypatch.setattr(wing, "_arcs", counted)
    again = onera_m6_grid((7, 9, 7))
    assert n_curves == [1, 1]  # of the plates within
    for other in (fresh, again):
        assert other.to_vector().tobytes() == grid.to_vector().tobytes()
