"""The memory of a mover's factors: predicted without a fit, bounded by what is chosen, kept for derivatives alone."""

import json
from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from fit_cases import fit_with

from bspline_mdao import ControlMeshMove, find_topology, fit_grid
from bspline_mdao.core.evaluation.family import refined_topology
from bspline_mdao.core.fit.control_counts import choose_affordable_counts, choose_counts, predict_factor_bytes
from bspline_mdao.core.fit.settings import FITTING
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import LinearElasticity, TorsionalSprings, moving_mesh
from bspline_mdao.studio.cli.main import run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def topology():
    return find_topology(onera_m6_grid((10, 14, 8)))


def test_the_predicted_factor_is_that_of_the_mover(monkeypatch):
    fit_with(monkeypatch, small_mesh=100)
    model = fit_grid(onera_m6_grid((13, 17, 14)))
    mover = LinearElasticity(moving_mesh(model), n_increments=1)
    surface = model.control_points[mover.mesh.surface_ids]
    step = mover.move(model.control_points, surface).steps[0]
    assert model.report.factor_bytes == step.factor.n_bytes > 1e6


def test_the_factor_of_knots_that_are_given_is_predicted_from_them(monkeypatch):
    fit_with(monkeypatch, small_mesh=100)
    grid = onera_m6_grid((11, 10, 9))
    chosen = fit_grid(grid, n_control=(7, 8, 6))
    given = fit_grid(grid, knots=[volume.knots for volume in chosen.mesh.volumes])
    assert given.report.factor_bytes == chosen.report.factor_bytes > fit_grid(grid).report.factor_bytes
    assert given.report.warnings == chosen.report.warnings


def test_small_control_meshes_are_not_worth_a_prediction(topology):
    assert predict_factor_bytes(topology, choose_counts(topology).n_control) is None


def test_default_numbers_of_grids_of_two_million_nodes_are_one_span_to_four_cells(topology):
    usual = refined_topology(topology, 6.0)
    assert 2.0e6 < usual.n_nodes < 2.3e6
    counts, n_bytes = choose_affordable_counts(usual)
    np.testing.assert_array_equal(counts.n_control, choose_counts(usual).n_control)
    assert FITTING.largest_factor / 8 < n_bytes < FITTING.largest_factor
    assert counts.warnings == ()


def test_default_numbers_of_large_grids_stay_within_what_movers_can_take(topology):
    large = refined_topology(topology, 9.0)
    assert large.n_nodes > 4.9e6
    counts, n_bytes = choose_affordable_counts(large)
    assert FITTING.largest_factor / 2 < n_bytes <= FITTING.largest_factor
    assert (counts.n_control < choose_counts(large).n_control).all()
    np.testing.assert_array_equal(counts.orders, 4)
    assert "instead of 4, so that movers can take its control mesh" in counts.warnings[0]


def test_numbers_that_the_user_gives_are_taken_and_predicted(topology):
    settings = replace(FITTING, largest_factor=2**26)
    larger = refined_topology(topology, 5.0)
    counts, n_bytes = choose_affordable_counts(larger, (13, 18, 10), settings=settings)
    np.testing.assert_array_equal(counts.n_control, [[13, 18, 10]] * 12)
    assert n_bytes > 2**27
    assert choose_affordable_counts(larger, settings=settings)[1] is None  # fewer than 10,000 control points


def test_the_command_fit_names_the_predicted_memory(tmp_path, monkeypatch, capsys):
    fit_with(monkeypatch, small_mesh=100)
    files = [str(tmp_path / name) for name in ("m.h5", "m.json")]
    assert run(["fit", "@onera_m6:13x17x14", "-o", files[0], "--json", files[1]]) == 0
    with open(files[1]) as file:
        n_bytes = json.load(file)["factor_bytes"]
    assert n_bytes > 1e6
    assert f"factors of {n_bytes / 1e9:.2g} GB each" in capsys.readouterr().out


def kept_factors(movement):
    return [step.factor is not None for step in movement.steps]


@pytest.mark.parametrize("kind", [LinearElasticity, TorsionalSprings])
def test_factors_are_kept_where_derivatives_will_be_asked_for_alone(kind):
    model = fit_grid(onera_m6_grid((9, 9, 7)))
    mesh = moving_mesh(model)
    surface = model.control_points[mesh.surface_ids] * [1.0, 1.0, 1.01]
    alone = kind(mesh, n_increments=3).move(model.control_points, surface)
    assert kept_factors(alone) == [True, False, False]  # the first serves the next surface
    for derivatives, mover, expected in [
        (True, kind(mesh, n_increments=3), [True, True, True]),
        (False, kind(mesh, n_increments=3), [True, False, False]),
        (True, kind(mesh, n_increments=3, keep_factors=False), [True, False, False]),
    ]:
        problem = om.Problem()
        component = problem.model.add_subsystem("move", ControlMeshMove(mover=mover), promotes=["*"])
        problem.setup(derivatives=derivatives)
        problem.set_val("surface_control_points", surface.ravel())
        problem.run_model()
        np.testing.assert_array_equal(problem.get_val("control_points"), alone.points.ravel())
        assert kept_factors(component._last.movement) == expected
