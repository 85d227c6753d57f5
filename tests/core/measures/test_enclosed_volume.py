"""Volume between bilinear quads and planes of symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_cases import (
    assert_derivatives_are_exact,
    box,
    box_sheets,
    naca_area,
    rectangular_wing,
    roughened,
    sphere,
    surface_of,
    turned,
    wing_sheets,
    with_points,
)

from bspline_mdao import find_topology, fit_grid, read_grid
from bspline_mdao.core.mesh.frame import Plane
from bspline_mdao.errors import InputError
from bspline_mdao.generators import flat_plate_grid, generic_blended_wing_body, nodes_on_shape, onera_m6_grid
from bspline_mdao.grids.cells.hexahedron import cell_quality
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.measures import EnclosedVolume, ProjectedArea, SectionThickness, SurfaceArea, SurfaceGrid


@pytest.fixture(scope="module")
def m6():
    return fit_grid(onera_m6_grid((13, 9, 11)), n_control=(7, 6, 6))


def volume(surface, **options):
    return EnclosedVolume.of(surface, **options).evaluate(surface.points)[0]


def plane(axis, offset=0.0):
    return Plane(np.eye(3)[axis], offset)


def test_a_box_has_the_product_of_its_edges():
    assert volume(box()) == pytest.approx(6.0, rel=1e-14)


def test_a_twisted_cell_has_the_volume_of_its_trilinear_hexahedron():
    surface = box((2, 2, 2))
    points = roughened(surface, 0.1)
    corners = np.lexsort(surface.points.T[::1])  # x varies fastest
    cell = points[corners].reshape(2, 2, 2, 3).transpose(2, 1, 0, 3)
    assert EnclosedVolume.of(surface).evaluate(points)[0] == pytest.approx(cell_quality(cell).volume.item(), rel=1e-13)


def test_a_sphere_is_approached_with_the_square_of_the_spacing():
    errors = [4.0 / 3.0 * np.pi * 1.5**3 - volume(sphere(n)) for n in (9, 17, 33)]
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (np.abs(rates - 2.0) < 0.1).all()


def test_a_rectangular_wing_has_its_section_area_times_its_span():
    exact = naca_area() * 2.0**2 * 3.0
    errors = [exact - volume(rectangular_wing(n_chord=n)) for n in (33, 65, 129)]
    assert errors[-1] / exact < 1e-3
    assert (np.abs(np.log2(np.divide(errors[:-1], errors[1:])) - 2.0) < 0.1).all()


@pytest.mark.parametrize("make", [box, sphere, rectangular_wing])
def test_the_volume_does_not_change_with_a_rigid_motion(make):
    surface = make()
    assert volume(turned(surface)) == pytest.approx(volume(surface), rel=1e-13)


def test_the_volume_of_a_closed_body_does_not_change_when_it_is_carried_off():
    measure = EnclosedVolume.of(box())
    points = roughened(measure.surface)
    np.testing.assert_allclose(measure.evaluate(points + [3.0, -1.0, 2.0]), measure.evaluate(points), rtol=1e-13)


def test_the_volume_goes_with_the_product_of_three_stretchings():
    surface = sphere(5)
    factors = np.array([2.0, 0.5, 1.7])
    measure = EnclosedVolume.of(surface)
    np.testing.assert_allclose(measure.evaluate(surface.points * factors), 1.7 * volume(surface), rtol=1e-13)
    relative = EnclosedVolume.of(surface, relative=True)
    assert relative.units is None
    np.testing.assert_allclose(relative.evaluate(surface.points * factors), 1.7, rtol=1e-13)


@pytest.mark.parametrize("axes", [(2,), (0, 2), (0, 1, 2)])
@pytest.mark.parametrize("turn", [False, True])
def test_planes_of_symmetry_close_a_body_wherever_they_are(axes, turn):
    sheets = box_sheets(low=(1.0, 2.0, 3.0), high=(2.0, 4.0, 6.0))  # at the low and the high end of each axis in turn
    sheets = [sheet for n, sheet in enumerate(sheets) if n // 2 not in axes or n % 2]
    surface = surface_of(*sheets, planes=[plane(axis, axis + 1.0) for axis in axes])
    surface = turned(surface) if turn else surface
    assert volume(surface) == pytest.approx(6.0, rel=1e-13)
    assert_derivatives_are_exact(EnclosedVolume.of(surface))


def test_parallel_planes_of_symmetry_close_a_body_at_both_ends():
    sheets = wing_sheets()[:2]
    surface = surface_of(*sheets, planes=[plane(2), plane(2, 3.0)])
    assert volume(surface) == pytest.approx(volume(rectangular_wing()), rel=1e-13)
    assert volume(turned(surface)) == pytest.approx(volume(surface), rel=1e-13)


def test_planes_without_a_common_point_are_refused():
    sheets = [box_sheets()[n] for n in (1, 2, 3)]
    surface = surface_of(*sheets, planes=[plane(0), plane(2), plane(2, 3.0)])
    with pytest.raises(InputError, match="volume: the planes of symmetry neither have a point in common nor are"):
        EnclosedVolume.of(surface)


def test_a_body_that_is_open_elsewhere_is_refused_with_the_edge():
    surface = surface_of(*wing_sheets()[:2], planes=[plane(2)])
    with pytest.raises(InputError, match=r"open at the edge from \(.*, 3\) to \(.*, 3\) of block 1, wall"):
        EnclosedVolume.of(surface)
    with pytest.raises(InputError, match="add the patch that does"):
        EnclosedVolume.of(replace(rectangular_wing(), planes=()))


def test_a_duct_has_the_volume_of_what_flows_in_it():
    surface = surface_of(*(sheet.swapaxes(0, 1) for sheet in box_sheets()))
    assert volume(surface) == pytest.approx(6.0, rel=1e-14)
    assert volume(surface, relative=True) == 1.0


@pytest.mark.slow
def test_a_flat_plate_has_no_volume_to_be_relative_to():
    surface = SurfaceGrid.of(fit_grid(flat_plate_grid((9, 8, 7)), n_control=(5, 5, 5)))
    assert abs(volume(surface)) < 1e-15
    assert_derivatives_are_exact(EnclosedVolume.of(surface))
    with pytest.raises(InputError, match=r"volume: .* on the baseline, nothing to be relative to"):
        EnclosedVolume.of(surface, relative=True)


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("make", [box, sphere, rectangular_wing])
def test_derivatives_are_exact(make, relative):
    assert_derivatives_are_exact(EnclosedVolume.of(turned(make()), relative))


def test_derivatives_are_exact_between_parallel_planes():
    surface = surface_of(*wing_sheets()[:2], planes=[plane(2), plane(2, 3.0)])
    assert_derivatives_are_exact(EnclosedVolume.of(turned(surface)))


@pytest.mark.slow
def test_wings_of_the_paper_end_on_their_plane_of_symmetry(m6):
    surface = SurfaceGrid.of(m6)
    assert len(surface.planes) == 1
    body = with_points(surface, nodes_on_shape(m6, generic_blended_wing_body())[surface.rows])
    for wing in (surface, body):
        doubled = EnclosedVolume.of(replace(_mirrored(wing), planes=()))
        assert 2.0 * volume(wing) == pytest.approx(doubled.evaluate(doubled.surface.points)[0], rel=1e-12)
        assert_derivatives_are_exact(EnclosedVolume.of(wing), size=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "patches", "volume_of", "area_of", "planform"),
    [
        # a wing of 3 chords; a section extruded between two planes; a sphere of diameter 1 m in millimetres
        ("hh_naca0012_12blocks.xyz", None, (3.0 * naca_area(), 0.02), None, 3.0),
        ("mach_naca0012.cgns", None, (naca_area(), 0.02), None, 1.0),
        ("hopr_sphere_20blocks.cgns", "BC_sphere", (np.pi / 6.0 * 1e9, 0.05), (np.pi * 1e6, 0.03), None),
    ],
)
def test_bodies_in_real_grids_have_the_volume_and_areas_they_should(
    real_grids, name, patches, volume_of, area_of, planform
):
    surface = SurfaceGrid.of(_model(real_grids / name), patches)
    assert volume(surface) == pytest.approx(volume_of[0], rel=volume_of[1])
    if area_of is not None:
        assert SurfaceArea.of(surface).evaluate(surface.points)[0] == pytest.approx(area_of[0], rel=area_of[1])
    if planform is not None:
        assert ProjectedArea.of(surface).evaluate(surface.points)[0] == pytest.approx(planform, rel=1e-9)
    assert_derivatives_are_exact(EnclosedVolume.of(surface), size=1e-4)


@pytest.mark.slow
def test_the_surface_of_an_o_grid_about_the_m6_is_closed(real_grids):
    surface = SurfaceGrid.of(_model(real_grids / "pyhyp_m6_9blocks.xyz"))
    assert volume(surface) > 0.0
    assert ProjectedArea.of(surface).evaluate(surface.points)[0] == pytest.approx(0.7588, rel=2e-3)  # usual reference
    ratios = SectionThickness.at(surface, [0.0, 0.3, 0.7]).ratios(surface.points)
    np.testing.assert_allclose(ratios.max(axis=1), 0.0978, atol=1e-3)


def _model(path):
    """Fit of a real grid; where it declares no patches, they are guessed."""
    grid = read_grid(path)
    windows = [face.window for face in find_topology(grid).boundary]
    return fit_grid(grid if grid.patches else replace(grid, patches=guess_patches(grid, windows)))


def _mirrored(surface):
    """Both halves."""
    sheets = [surface.points[ids] for ids in surface.faces]
    return surface_of(*sheets, *(sheet.swapaxes(0, 1) * [1.0, 1.0, -1.0] for sheet in sheets))
