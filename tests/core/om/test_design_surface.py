"""One object to start from: what it hands out is what one would make by hand."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import DesignSurface, GridMovement, fit_grid
from bspline_mdao.design import Parametrization, ReferenceAxis, Sweep, Twist
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid, onera_m6_planform
from bspline_mdao.measures import EnclosedVolume, SurfaceGrid, Thickness
from bspline_mdao.movers import moving_mesh


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))


def run(group):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("shape", group, promotes=["*"])
    problem.setup()
    problem.set_val("twist", [1.0, -2.0, 3.0])
    problem.run_model()
    return problem


@pytest.mark.slow
def test_what_it_hands_out_is_what_is_made_by_hand(model):
    wing, mesh, surface = DesignSurface.of(model), moving_mesh(model), SurfaceGrid.of(model)
    assert wing.model is model
    assert np.array_equal(wing.mesh.surface_ids, mesh.surface_ids)
    assert np.array_equal(wing.surface.points, surface.points)
    assert np.array_equal(wing.axis.points, ReferenceAxis.of(mesh).points)
    assert np.array_equal(wing.axis_at(1.0, n=4).points, ReferenceAxis.of(mesh, at=1.0, n=4).points)
    by_hand = GridMovement(
        model=model,
        parametrization=Parametrization(mesh, [Twist("twist", ReferenceAxis.of(mesh), stations=3)]),
        measures=[EnclosedVolume.of(surface), Thickness.grid(surface, 3, 2)],
    )
    measures = [EnclosedVolume.of(wing.surface), Thickness.grid(wing.surface, 3, 2)]
    made = wing.grid_movement([Twist("twist", wing.axis, stations=3)], measures=measures)
    problems = run(by_hand), run(made)
    for name in ("grid", "volume", "thickness", "corner_ks"):
        assert np.array_equal(*(problem.get_val(name) for problem in problems)), name
    assert problems[1].get_val("thickness").shape == (2, 3)


def test_variables_share_its_axis_so_that_they_follow_each_other(model):
    wing = DesignSurface.of(model)
    parametrization = wing.parametrization([Sweep("sweep", wing.axis), Twist("twist", wing.axis, stations=2)])
    assert parametrization.mesh is wing.mesh
    assert len(parametrization.layout.auxiliary) == 1


def test_patches_choose_mesh_and_surface_together(model):
    wing = DesignSurface.of(model, "wing_upper", fixed="wing_lower")
    assert set(wing.surface.patches) == {"wing_upper"}
    assert np.array_equal(wing.mesh.surface_ids, moving_mesh(model, "wing_upper", "wing_lower").surface_ids)
    with pytest.raises(InputError, match="no patch is called 'fin'"):
        DesignSurface.of(model, "fin")


def test_its_edges_and_area_are_those_of_the_planform(model):
    wing, planform = DesignSurface.of(model), onera_m6_planform()
    for part, edge in ((0.0, wing.leading_edge), (1.0, wing.trailing_edge)):
        np.testing.assert_allclose(edge[:, 0], planform.x(part, edge[:, 2]), atol=0.01)
        assert edge[[0, -1], 2] == pytest.approx(planform.semi_span * np.array([0.02, 0.98]), rel=0.02)
    assert wing.planform_area == pytest.approx(2.0 * planform.semi_span**2 / planform.aspect_ratio, rel=0.01)
