"""Surfaces that move in time: grids and exact grid velocities."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from test_docs import code_blocks

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.design.deformation import Translate
from bspline_mdao.core.design.motion import Oscillation, SurfaceMotion, UnsteadyGrid, flapping, pitching
from bspline_mdao.core.movement.transfinite import Transfinite
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import LinearElasticity, moving_mesh


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((11, 9, 9)), n_control=(6, 5, 5))


@pytest.fixture(scope="module")
def mesh(model):
    return moving_mesh(model)


def both(mesh):
    """Pitch, then flap with another frequency about a bent mean."""
    flap = flapping(mesh, 0.3, 3.0, mean=0.2).oscillations
    return SurfaceMotion(mesh, pitching(mesh, 0.2, 2.0, mean=0.1).oscillations + flap)


def growing(time, surface):
    """A user's own motion: the surface swells in an exponential way."""
    return surface * [1.0, np.exp(time), 1.0], surface * [0.0, np.exp(time), 0.0]


def difference(f, steps):
    """Central differences, extrapolated."""
    table = [(f(h) - f(-h)) / (2 * h) for h in steps]
    for factor in 4.0 ** np.arange(1, len(steps)):
        table = [(factor * b - a) / (factor - 1) for a, b in zip(table, table[1:])]
    return table[0]


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["pitching", "flapping", "both", "growing"])
@pytest.mark.parametrize("make", [Transfinite, lambda mesh: LinearElasticity(mesh, n_increments=2)])
def test_velocities_are_the_rate_of_the_grid_to_a_converged_difference(model, mesh, motion, make):
    motions = {"pitching": pitching(mesh, 0.3, 2.0), "flapping": flapping(mesh, 0.5, 2.0)}
    motions |= {"both": both(mesh), "growing": growing}
    unsteady = UnsteadyGrid(model, make(mesh), motions[motion])
    state = unsteady.at(0.06)
    steps = (4e-3, 2e-3, 1e-3, 5e-4)
    for name, velocities in (("nodes", state.velocities), ("control_points", state.control_velocities)):
        rate = difference(lambda h, name=name: getattr(unsteady.at(0.06 + h), name), steps)
        np.testing.assert_allclose(velocities, rate, atol=1e-8 * np.abs(rate).max())
    assert np.abs(state.velocities).max() > 0.04


@pytest.mark.slow
def test_pitching_surface_turns_as_a_rigid_body(mesh):
    surface = mesh.points[mesh.surface_ids]
    points, velocities = pitching(mesh, 0.4, 1.5)(0.05, surface)
    lengths = [np.linalg.norm(p[:, None] - p, axis=-1) for p in (surface, points)]
    np.testing.assert_allclose(*lengths, atol=1e-13)
    rate = 0.4 * 2 * np.pi * 1.5 * np.cos(2 * np.pi * 1.5 * 0.05)
    relative = points - points[0]
    turning = np.cross([0.0, 0.0, -rate], relative)  # nose up about the span
    np.testing.assert_allclose(velocities - velocities[0], turning, atol=1e-12)


@pytest.mark.slow
def test_flapping_wing_keeps_its_root_and_turns_its_tip_by_the_amplitude(mesh):
    surface = mesh.points[mesh.surface_ids]
    points, _ = flapping(mesh, 0.6, 1.0)(0.25, surface)
    root = mesh.in_plane_rows
    np.testing.assert_allclose(points[root], surface[root], atol=1e-15)
    rim = np.argsort(surface[:, 2])[-1]
    radius = surface[rim, 2] / 0.6
    np.testing.assert_allclose(points[rim, 1:], [radius * (1 - np.cos(0.6)), radius * np.sin(0.6)], atol=1e-3)


@pytest.mark.slow
def test_boundaries_that_do_not_move_have_no_velocity(model, mesh):
    state = UnsteadyGrid(model, Transfinite(mesh), both(mesh)).at(0.31)
    held, rest = mesh.fixed_ids, mesh.points
    assert np.abs(state.control_velocities[held]).max() == 0.0
    on_plane = np.flatnonzero(mesh.is_free.any(axis=1) & ~mesh.is_free[:, 2])
    assert len(on_plane) > 10
    assert np.abs(state.control_velocities[on_plane, 2]).max() == 0.0
    np.testing.assert_array_equal(state.control_points[held], rest[held])


@pytest.mark.slow
def test_grid_at_rest_is_the_baseline_and_a_period_later_the_same(model, mesh):
    unsteady = UnsteadyGrid(model, Transfinite(mesh), pitching(mesh, 0.3, 2.0))
    baseline = model.regenerate().to_vector().reshape(-1, 3)
    np.testing.assert_allclose(unsteady.at(0.0).nodes, baseline, atol=1e-13)
    np.testing.assert_allclose(unsteady.at(0.1).nodes, unsteady.at(0.6).nodes, atol=1e-13)
    np.testing.assert_allclose(unsteady.at(0.1).velocities, unsteady.at(0.6).velocities, atol=1e-12)


def test_phase_and_mean_shift_the_amount():
    oscillation = Oscillation(Translate(np.array([1.0, 0.0, 0.0])), 2.0, 0.25, mean=3.0, phase=0.5 * np.pi)
    assert oscillation.map_at(0.0).amount == pytest.approx(5.0)
    assert oscillation.map_at(1.0).amount == pytest.approx(3.0)
    assert oscillation.rate_at(1.0) == pytest.approx(-np.pi)


def test_motion_out_of_the_symmetry_plane_is_refused(mesh):
    sideways = Oscillation(Translate(np.array([0.0, 0.0, 1.0])), 0.2, 1.0)
    with pytest.raises(InputError, match="plane of symmetry"):
        SurfaceMotion(mesh, (sideways,))(0.1, mesh.points[mesh.surface_ids])


@pytest.mark.slow
def test_motions_of_other_surfaces_and_movers_of_other_meshes_are_refused(model, mesh):
    with pytest.raises(InputError, match=r"the motion gives points of shape \(\d+, 3\) and velocities of shape \(3,\)"):
        UnsteadyGrid(model, Transfinite(mesh), lambda time, surface: (surface, np.zeros(3))).at(0.0)
    other = moving_mesh(fit_grid(onera_m6_grid((9, 9, 9)), n_control=(5, 5, 5)))
    with pytest.raises(InputError, match="make the mesh of this model"):
        UnsteadyGrid(model, Transfinite(other), growing)


@pytest.mark.slow
@pytest.mark.parametrize("page", ["deformations", "unsteady"])
def test_the_example_of_the_theory_page_runs(page):
    (example,) = code_blocks(f"theory/{page}.rst", "python")
    contents = {}
    exec(example, contents)
    assert np.isfinite(contents["surface"] if page == "deformations" else contents["state"].velocities).all()


@pytest.mark.slow
def test_unsteady_wing_has_exact_velocities_and_valid_grids(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "run_scripts"))
    numbers = importlib.import_module("unsteady_wing").main(figures=tmp_path)
    assert set(numbers) == {"pitching", "flapping"}
    for results in numbers.values():
        assert results["rate"] == pytest.approx(2.0, abs=0.01)
        assert results["velocity_error"] < 1e-9
        assert results["n_inverted"] == 0
        assert min(results["min_corner"]) > 0.1
    assert (tmp_path / "unsteady_wing.png").stat().st_size > 50_000
