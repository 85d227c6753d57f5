"""Parameter correction."""

from dataclasses import replace

import numpy as np
import pytest
from fit_cases import ALL_SHAPES, bend, bent_block, grid_of, lattice, two_blocks

from bspline_mdao.core.fit import correction
from bspline_mdao.core.fit.correction import project
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.fit.problem import problem_of_mesh
from bspline_mdao.core.fit.settings import FITTING
from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.core.splines.volume import Volume, evaluate


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_more_cycles_never_raise_the_error(shape):
    errors = [fit_grid(ALL_SHAPES[shape](), corrections=n).report.rms for n in (0, 1, 2, 4)]
    assert errors == sorted(errors, reverse=True)


def test_a_cycle_that_raises_the_error_is_not_taken(monkeypatch):
    grid = bent_block()
    plain = fit_grid(grid)
    monkeypatch.setattr(correction, "_move", lambda problem, followers, parameters, *_: [p**1.5 for p in parameters])
    kept = fit_grid(grid, corrections=3)
    np.testing.assert_array_equal(kept.control_points, plain.control_points)
    np.testing.assert_array_equal(kept.parameters[0], plain.parameters[0])


@pytest.mark.slow
def test_the_same_control_points_fit_five_times_better():
    grid = grid_of(bend(lattice(33, 29, 25)))
    plain, corrected = (fit_grid(grid, n_control=(7, 7, 6), corrections=n) for n in (0, 2))
    assert corrected.report.n_control_points == plain.report.n_control_points
    assert corrected.report.rms < plain.report.rms / 5


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_parameters_stay_increasing_along_grid_lines(shape):
    for parameters in fit_grid(ALL_SHAPES[shape](), corrections=3).parameters:
        for d in range(3):
            assert (np.diff(parameters[..., d], axis=d) > 0).all()


def test_parameters_of_shared_nodes_agree_on_both_sides():
    model = fit_grid(two_blocks(), corrections=2)
    first, second = model.parameters
    # face imax of block 1 is face jmax of block 2, turned: j runs along k, and k along i
    face, other = first[-1], second[:, -1].transpose(1, 0, 2)
    np.testing.assert_allclose(face[..., 1], other[..., 2], atol=1e-15)
    np.testing.assert_allclose(face[..., 2], other[..., 0], atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_the_residual_belongs_to_the_corrected_parameters(shape):
    grid = ALL_SHAPES[shape]()
    model = fit_grid(grid, corrections=1)
    fitted = grid.to_vector().reshape(-1, 3) - model.residual
    sharing = problem_of_mesh(model.topology, model.mesh).sharing
    nets = model.mesh.nets(model.control_points)
    for volume, net, x, r, own in zip(model.mesh.volumes, nets, model.parameters, sharing.rows, sharing.is_evaluated):
        np.testing.assert_allclose(evaluate(volume, net, x[own]), fitted[r[own]], atol=1e-12)


def several_steps(n):
    return replace(FITTING, close=0.0, correction_steps=n)


def test_newton_finds_the_parameters_of_points_inside():
    model = fit_grid(bent_block(), n_control=(6, 7, 5))
    volume, net = model.mesh.volumes[0], model.mesh.nets(model.control_points)[0]
    start = model.parameters[0]
    target = start.copy()
    target[1:-1, 1:-1, 1:-1] += (0.08 * start * (1 - start) * np.sin(9 * start[..., [1, 2, 0]]))[1:-1, 1:-1, 1:-1]
    points = evaluate(volume, net, target[1:-1, 1:-1, 1:-1].reshape(-1, 3))
    found, reached = project(volume, net, start, (True, True, True), points, several_steps(8))
    np.testing.assert_allclose(reached, points, atol=1e-12)
    np.testing.assert_allclose(found, target, atol=1e-10)


def test_a_point_off_a_curve_goes_to_its_foot():
    volume = Volume.of(ConstantKnots.uniform(4, 4))
    net = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], dtype=float)[:, None, None]
    parameters = np.zeros((3, 1, 1, 3))
    parameters[:, 0, 0, 0] = [0, 0.5, 1]
    found, reached = project(
        volume, net, parameters, (True, False, False), np.array([[1.8, 4.0, -2.0]]), several_steps(6)
    )
    np.testing.assert_allclose(reached, [[1.8, 0, 0]], atol=1e-12)
    assert found[1, 0, 0, 0] == pytest.approx(0.6)
