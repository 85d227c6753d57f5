"""A design variable that moves a part of the design surface alone."""

import numpy as np
import pytest
from parametrization_cases import surface_of, wing_model

from bspline_mdao import DesignSurface, InputError, fit_grid
from bspline_mdao.design import Camber, FreeForm, Lattice, OfPart, Twist
from bspline_mdao.generators import brick_grid
from bspline_mdao.movers import moving_mesh


def wing_and_upper():
    wing = DesignSurface.of(wing_model())
    return wing, wing.part("*upper")


@pytest.mark.parametrize("kind", [Twist, Camber])
def test_a_part_moves_as_if_it_were_the_whole_surface_and_all_else_stays(kind):
    wing, upper = wing_and_upper()
    variable, rng = kind("v", upper.axis, stations=3), np.random.default_rng(3)
    values = {"v": rng.normal(size=3)}
    moved = wing.parametrization([OfPart(variable, upper.mesh)]).apply(surface_of(wing.mesh), values)
    alone = upper.parametrization([variable]).apply(surface_of(upper.mesh), values)
    rows = wing.mesh.surface_rows[upper.mesh.surface_ids]
    np.testing.assert_allclose(moved[rows], alone, rtol=0.0, atol=1e-13)
    others = np.setdiff1d(np.arange(len(moved)), rows)
    np.testing.assert_array_equal(moved[others], surface_of(wing.mesh)[others])
    assert np.abs(alone - surface_of(upper.mesh)).max() > 1e-3


def test_the_axis_of_a_part_goes_along_with_variables_of_the_whole():
    wing, upper = wing_and_upper()
    box = FreeForm("box", Lattice.box(wing.mesh, (2, 2, 2)), direction="xyz")
    part = OfPart(Twist("twist", upper.axis), upper.mesh)
    shape, surface = wing.parametrization([box, part]), surface_of(wing.mesh)
    twisted = shape.apply(surface, {**shape.initial, "twist": [7.0]})
    shift = np.tile([0.3, -0.2, 0.0], 8)
    both = shape.apply(surface, {"box": shift, "twist": [7.0]})
    np.testing.assert_allclose(both, twisted + [0.3, -0.2, 0.0], rtol=0.0, atol=1e-12)


def test_a_part_that_is_not_designed_is_refused():
    model = wing_model()
    wing, upper = DesignSurface.of(model, "*lower"), DesignSurface.of(model, "*upper")
    with pytest.raises(InputError, match=r"part of a design surface: point \(.*\) of block .* is not designed"):
        wing.part("*upper")
    twist = OfPart(Twist("twist", upper.axis), upper.mesh)
    with pytest.raises(InputError, match=r"part of variable 'twist': .* is not on the design surface"):
        wing.parametrization([twist])


def test_a_part_of_another_model_is_refused():
    wing, upper = wing_and_upper()
    other = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    with pytest.raises(InputError, match="part of variable 'twist': its mesh has 78 points"):
        wing.parametrization([OfPart(Twist("twist", upper.axis), other)])
    with pytest.raises(InputError, match="part of variable 'twist': the mesh is of type"):
        OfPart(Twist("twist", upper.axis), upper)
