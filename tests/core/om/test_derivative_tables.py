"""Derivatives of every kind of variable, linear constraint and measure that there is; see the tables of cases."""

import geometry_cases
import numpy as np
import pytest
from parametrization_cases import (
    CONSTRAINTS,
    OF_SECTIONS,
    VARIABLES,
    assert_exact,
    section_model,
    surface_of,
    swelling,
    wing_model,
)

from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.core.mesh.boundary import moving_mesh


def assert_passes_the_dot_test(parametrization, seed=1):
    """Dot test to 1e-12 and complex step to 1e-10 of all derivatives, away from the baseline."""
    random, surface = np.random.default_rng(seed), surface_of(parametrization.mesh)
    surface = surface + 0.02 * random.normal(size=surface.shape)
    values = {name: v + 0.1 * random.normal(size=v.shape) for name, v in parametrization.initial.items()}
    partials, bar = parametrization.partials(surface, values), random.normal(size=surface.size)
    for name, matrix in {None: partials.initial, **partials.values}.items():
        direction = random.normal(size=matrix.shape[1])
        step = 1e-40j * direction
        at = (surface, values | {name: values[name] + step}) if name else (surface + step.reshape(-1, 3), values)
        exact, forward = parametrization.apply(*at).imag.ravel() / 1e-40, matrix @ direction
        np.testing.assert_allclose(forward, exact, rtol=1e-10, atol=1e-10 * np.abs(exact).max())
        off = abs(bar @ forward - (matrix.T @ bar) @ direction)
        assert off <= 1e-12 * np.linalg.norm(bar) * np.linalg.norm(forward)


@pytest.mark.parametrize("kind", [*VARIABLES, *OF_SECTIONS], ids=lambda kind: kind.__name__)
def test_derivatives_of_every_variable_are_exact(kind):
    mesh = moving_mesh(section_model() if kind in OF_SECTIONS else wing_model())
    variable = (VARIABLES | OF_SECTIONS)[kind](mesh)
    assert type(variable) is kind
    assert_exact(Layout(mesh, tuple(variable.auxiliary)), variable)
    assert_passes_the_dot_test(Parametrization(mesh, [variable]))


@pytest.mark.parametrize("kind", CONSTRAINTS, ids=lambda kind: kind.__name__)
def test_derivatives_under_every_constraint_are_exact_and_satisfy_it(kind):
    mesh, constraint = moving_mesh(wing_model()), CONSTRAINTS[kind]()
    assert type(constraint) is kind
    parametrization = Parametrization(mesh, [swelling("swelling")], [constraint])
    assert_passes_the_dot_test(parametrization)
    equations = constraint.equations(mesh, surface_of(mesh)).matrix
    assert equations.nnz
    values = {"swelling": np.array([0.3, -0.4])}
    displacement = parametrization.apply(surface_of(mesh), values) - surface_of(mesh)
    assert np.abs(equations @ displacement.ravel()).max() <= 1e-13
    assert np.abs(equations @ parametrization.partials(surface_of(mesh), values).values["swelling"]).max() <= 1e-13


@pytest.mark.parametrize("kind", geometry_cases.MEASURES, ids=lambda kind: kind.__name__)
def test_derivatives_of_every_measure_are_exact(kind):
    measure = geometry_cases.MEASURES[kind](geometry_cases.rectangular_wing())
    assert type(measure) is kind
    geometry_cases.assert_derivatives_are_exact(measure, size=0.001)


@pytest.mark.parametrize("kind", geometry_cases.OF_SECTIONS, ids=lambda kind: kind.__name__)
def test_derivatives_of_every_measure_of_sections_are_exact(kind):
    measure = geometry_cases.OF_SECTIONS[kind](geometry_cases.section_between_planes())
    assert type(measure) is kind
    geometry_cases.assert_derivatives_are_exact(measure, size=0.001)
