"""References that look wrong are doubted with the numbers, and those of grids that fly are not."""

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.base.checks import as_axes
from bspline_mdao.flow.loads.stream import stream_axes
from bspline_mdao.flow.openfoam.case_mesh import CaseMesh
from bspline_mdao.flow.openfoam.reference_check import doubts_about_axes_and_area, doubts_about_forces
from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section, onera_m6_grid


@pytest.fixture(scope="module")
def meshes():
    """A half wing, and a section one cell deep."""
    section = infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0))
    return {
        name: CaseMesh.of(fit_grid(grid)) for name, grid in (("wing", onera_m6_grid((9, 8, 7))), ("section", section))
    }


def doubts(mesh, area, axes="xzy", degrees=3.0):
    """Doubts about a mesh."""
    rows = as_axes(axes, "test")
    stream = stream_axes(np.radians(degrees), rows)[0]
    return doubts_about_axes_and_area(mesh.patches_of("wall"), mesh.patches_of("symmetry"), rows, stream, area)


def planform(mesh):
    """Area that the walls cover seen from above."""
    walls = mesh.patches_of("wall")
    _, areas = walls.geometry()
    return 0.5 * np.abs(areas[:, 1]).sum()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wing", "section"])
def test_what_is_right_is_not_doubted(name, meshes):
    area = planform(meshes[name])
    for factor in (0.8, 1.0, 1.3):
        for degrees in (-5.0, 0.0, 12.0):
            assert doubts(meshes[name], factor * area, degrees=degrees) == []


@pytest.mark.slow
def test_the_area_of_both_halves_of_a_wing_and_one_in_square_millimetres_are_doubted(meshes):
    area = planform(meshes["wing"])
    (found,) = doubts(meshes["wing"], 1e6 * area)
    assert f"the walls cover {area:g} m^2 seen from above and" in found
    assert doubts(meshes["wing"], 2.0 * area)


@pytest.mark.slow
def test_axes_in_another_order_are_doubted_by_what_is_seen_and_by_the_plane_that_the_stream_crosses(meshes):
    found = "\n".join(doubts(meshes["wing"], planform(meshes["wing"]), "xyz"))
    assert "check the order of the axes" in found
    found = "\n".join(doubts(meshes["wing"], planform(meshes["wing"]), "zxy"))
    assert "the stream crosses the plane of symmetry 'symmetry' at 87 degrees" in found


def test_coefficients_that_openfoam_finds_to_be_others_are_doubted():
    ours = {"CL": 0.3, "CD": 0.01}
    assert doubts_about_forces(ours, {"CL": 0.3 + 1e-6, "CD": 0.01}) == []
    (found,) = doubts_about_forces(ours, {"CL": 0.3, "CD": 0.0101})
    assert found.startswith("CD is 0.01, and OpenFOAM finds 0.0101")
    assert "negative" in doubts_about_forces({"CD": -0.01}, {"CD": -0.01})[0]
    assert "wrote no coefficients" in doubts_about_forces(ours, None)[0]
