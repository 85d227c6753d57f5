"""Valid control meshes: that a fit has one wherever its grid allows, what it costs, and what is said about it."""

import warnings

import numpy as np
import pytest
from fit_cases import ALL_SHAPES, FOLDING, bent_block, folded_block, grid_of, lattice, two_blocks

from bspline_mdao import FittedModel, FitWarning, fit_grid, read_grid, write_grid
from bspline_mdao.core.fit.problem import problem_of_mesh
from bspline_mdao.core.fit.quasi_interpolant import QuasiInterpolant, parametric_places
from bspline_mdao.core.fit.validity import _fade, elements_with, first_marked
from bspline_mdao.core.model.records import CANDIDATES
from bspline_mdao.core.splines.greville import greville_abscissae
from bspline_mdao.generators import Spacing, flat_plate_grid, onera_m6_grid
from bspline_mdao.studio.cli.main import run


def quietly(grid, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        return fit_grid(grid, **options)


def warned(grid, **options):
    """Fit a grid that folds; the model and what was said."""
    with pytest.warns(FitWarning) as record:
        model = fit_grid(grid, **options)
    (warning,) = record
    return model, warning


def candidates_of(model):
    """All candidates but least squares for the grid of a model."""
    problem = problem_of_mesh(model.topology, model.mesh)
    quasi = QuasiInterpolant.of(model.mesh, problem.sharing, model.parameters)
    return quasi.candidates(model.regenerate().to_vector().reshape(-1, 3))


# the quasi-interpolant


@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_control_points_are_sampled_where_the_nodes_have_their_greville_parameters(shape):
    model = fit_grid(ALL_SHAPES[shape]())
    for volume, parameters in zip(model.mesh.volumes, model.parameters):
        places = parametric_places(volume, parameters)
        low = np.minimum(places.astype(int), np.maximum(np.array(parameters.shape[:3]) - 2, 0))
        found = np.zeros_like(places)
        for corner in np.ndindex(2, 2, 2):
            i, j, k = np.moveaxis(np.minimum(low + corner, np.array(parameters.shape[:3]) - 1), -1, 0)
            weight = np.where(corner, places - low, 1 - (places - low)).prod(axis=-1)
            found += weight[..., None] * parameters[i, j, k]
        np.testing.assert_allclose(found, greville_abscissae(volume), atol=1e-9)


def test_what_is_linear_in_the_parameters_is_reproduced_by_all_iterations():
    nodes = lattice(9, 13, 11) @ np.array([[1.0, 0.3, -0.2], [0.1, 2.0, 0.4], [0.0, -0.5, 1.5]])
    model = fit_grid(grid_of(nodes))
    assert model.report.n_invalid == 0
    for points in candidates_of(model)[:-1]:
        np.testing.assert_allclose(points, model.control_points, atol=1e-13)


def test_more_iterations_come_closer_to_the_grid():
    grid = bent_block()
    model = fit_grid(grid)
    nodes = grid.to_vector().reshape(-1, 3)
    errors = [np.linalg.norm(nodes - model.evaluator().forward(points)) for points in candidates_of(model)]
    assert np.all(np.diff(errors) > 0)


def test_points_that_blocks_share_need_the_nodes_that_blocks_share_alone():
    model = fit_grid(two_blocks())
    problem = problem_of_mesh(model.topology, model.mesh)
    quasi = QuasiInterpolant.of(model.mesh, problem.sharing, model.parameters)
    shared = np.intersect1d(*(ids.ravel() for ids in model.mesh.control_ids))
    bar = np.zeros((model.mesh.n_control_points, 3))
    bar[shared] = 1.0
    needed = np.flatnonzero(np.any(quasi.adjoint(bar, np.full((len(bar), 6), 1 / 6)), axis=1))
    rows = [np.unique(problem.sharing.source_rows()[rows]) for rows in problem.sharing.rows]
    assert len(shared) > 0
    assert np.isin(needed, np.intersect1d(*rows)).all()


# validity


@pytest.mark.slow
@pytest.mark.parametrize("make", [onera_m6_grid, flat_plate_grid])
@pytest.mark.parametrize("shape", [(5, 5, 5), (6, 5, 9), (9, 9, 7), (12, 9, 11)])
def test_small_generated_grids_have_valid_control_meshes_within_their_domain(make, shape):
    grid = make(shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error", FitWarning)
        model = fit_grid(grid)
    nodes = grid.to_vector().reshape(-1, 3)
    assert model.report.n_invalid == 0
    assert model.candidate_weights is None
    assert np.abs(model.control_points).max() < 1.001 * np.abs(nodes).max()
    assert model.report.relative_rms < 0.02


VALID_GRIDS = {
    "folded": (folded_block, FOLDING),
    "order 4": (lambda: onera_m6_grid((5, 5, 5)), {"order": 4}),
    "a control point for every node": (lambda: onera_m6_grid((9, 9, 7)), {"order": 4, "n_control": (9, 9, 7)}),
    "boundary layer": (lambda: onera_m6_grid((9, 17, 9), Spacing(off_wall=1e-5)), {"order": 4, "n_control": (6, 8, 6)}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", VALID_GRIDS)
@pytest.mark.parametrize("method", ["valid", "quasi_interpolant"])
def test_a_valid_grid_has_a_valid_control_mesh_however_least_squares_fold(case, method):
    make, options = VALID_GRIDS[case]
    grid = make()
    least_squares = quietly(grid, method="least_squares", **options)
    model = fit_grid(grid, method=method, **options)
    assert least_squares.report.n_invalid > 0
    assert model.report.n_invalid == 0
    np.testing.assert_allclose(model.candidate_weights.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(model.regenerate().to_vector(), grid.to_vector(), atol=1e-12)
    fallback = model.report.fallback
    assert sum(fallback.n_points) == model.report.n_control_points
    if method == "valid":
        assert fallback.least_squares_invalid == least_squares.report.n_invalid
        assert fallback.least_squares_rms == least_squares.report.rms
        assert fallback.least_squares_max == pytest.approx(least_squares.report.worst.error, rel=1e-14)
        alone = model.candidate_weights[:, 0] == 1.0
        assert fallback.n_moved == np.sum(~alone)
        np.testing.assert_array_equal(model.control_points[alone], least_squares.control_points[alone])
    else:
        assert not model.candidate_weights[:, 0].any()


def test_where_least_squares_are_valid_nothing_changes_to_the_last_bit():
    grid = bent_block()
    first, second = (fit_grid(grid, method=method) for method in ("valid", "least_squares"))
    assert first.candidate_weights is None
    assert first.report.fallback is None
    np.testing.assert_array_equal(first.control_points, second.control_points)


def test_the_fallback_turns_and_grows_with_its_grid():
    grid = folded_block()
    model = fit_grid(grid, **FOLDING)
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    nodes = 1.7 * grid.to_vector().reshape(-1, 3) @ turn + [1.0, 2.0, 3.0]
    points = (
        problem_of_mesh(model.topology, model.mesh).operator(model.parameters, model.candidate_weights).forward(nodes)
    )
    np.testing.assert_allclose(points, 1.7 * model.control_points @ turn + [1.0, 2.0, 3.0], atol=1e-12)


@pytest.mark.parametrize("corrections", [0, 2])
def test_the_frozen_operator_gives_back_the_control_points_of_the_model(corrections):
    grid = folded_block()
    model = fit_grid(grid, corrections=corrections, **FOLDING)
    assert model.candidate_weights is not None
    operator = problem_of_mesh(model.topology, model.mesh).operator(model.parameters, model.candidate_weights)
    np.testing.assert_allclose(operator.forward(grid.to_vector().reshape(-1, 3)), model.control_points, atol=1e-13)


def test_how_far_points_move_falls_by_a_quarter_from_each_to_its_neighbours_across_interfaces_too():
    mesh = fit_grid(two_blocks(), n_control=[(6, 5, 4), (4, 7, 5)]).mesh
    first, second = mesh.control_ids
    (shared,) = {first[-1, 0, 0]} & {second[0, -1, 0]}
    towards = np.zeros(mesh.n_control_points)
    towards[shared], towards[second[-1, 0, -1]] = 1.0, 0.1  # less than a quarter reaches no neighbour
    found = _fade(mesh, towards, 0.25)
    for ids, place in ((first, (5, 0, 0)), (second, (0, 6, 0))):
        steps = np.abs(np.moveaxis(np.indices(ids.shape), 0, -1) - place).max(axis=-1)
        expected = np.maximum(1.0 - 0.25 * steps, 0.0)
        np.testing.assert_array_equal(found[ids], np.maximum(expected, towards[ids]))


def flattened():
    """A block that least squares fold, with a folded cell of its own."""
    grid = folded_block()
    nodes = grid.blocks[0].nodes.copy()
    nodes[-1, -1, -1, 0] -= 0.5
    return grid_of(nodes)


def test_what_the_grid_itself_folds_is_named_by_its_cell():
    model, warning = warned(flattened(), **FOLDING)
    assert model.report.n_invalid > 0
    assert {element.folded_cell for element in model.report.invalid} == {(40, 7, 5)}
    assert "the grid itself is folded or flat there, at cell (40, 7, 5) of block 1" in str(warning.message)


def test_elements_cover_the_cells_between_their_corners():
    rng = np.random.default_rng(4)
    axes = [np.concatenate([[0.0], np.sort(rng.uniform(0, n, 3)), [n]]) for n in (7, 5, 6)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    is_marked = rng.random((7, 5, 6)) < 0.03
    (found,) = elements_with([places], [is_marked])
    for element in np.ndindex(found.shape):
        box = places[tuple(slice(n, n + 2) for n in element)]
        cell = first_marked(box, is_marked)
        assert found[element] == (cell is not None)
        if cell is not None:
            assert is_marked[cell]
            assert np.all(np.floor(box.min(axis=(0, 1, 2))) <= cell)
            assert np.all(cell < np.ceil(box.max(axis=(0, 1, 2))))


REAL_GRIDS = {
    "aither_rae2822.xyz": 2.0,
    "cfl3d_ejector_nozzle.p3dfmt": 1.1,
    "cfl3d_naca0012_cgrid.fmt": 1.1,
    "cfl3d_rotorstator.fmt": 2.0,
    "mach_naca0012.cgns": 1.1,
    "pyhyp_m6_9blocks.xyz": 1.3,
}
"""Valid grids that least squares fold, and by how much the RMS error may grow."""


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL_GRIDS)
def test_valid_real_grids_have_valid_control_meshes_close_to_least_squares(real_grids, name):
    model = fit_grid(read_grid(real_grids / name))
    assert model.report.n_invalid == 0
    assert model.report.fallback.least_squares_invalid > 0
    assert model.report.rms < REAL_GRIDS[name] * model.report.fallback.least_squares_rms


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cfl3d_delta_wing.fmt.gz", "cfl3d_sduct.bin"])
def test_real_grids_with_folded_cells_keep_invalid_elements_there_alone(real_grids, name):
    model, warning = warned(read_grid(real_grids / name))
    assert model.report.n_invalid < model.report.fallback.least_squares_invalid / 2
    assert all(element.folded_cell for element in model.report.invalid)
    assert "the grid itself is folded or flat there" in str(warning.message)


# what is said


@pytest.mark.slow
def test_a_fit_with_invalid_elements_says_so_once_at_the_line_that_asked_for_it():
    model, warning = warned(onera_m6_grid((9, 9, 7)), order=4, method="least_squares")
    assert warning.filename == __file__
    assert "\n" not in str(warning.message)
    for words in (
        model.header.source,
        f"{model.report.n_invalid} of 768 elements of the control mesh invalid",
        model.report.invalid[0].name,
        "leave the order and the number of control points out",
    ):
        assert words in str(warning.message)
    assert model.report.warnings[-1] in str(warning.message)


def test_least_squares_that_fold_are_told_of_the_method_that_does_not():
    _, warning = warned(folded_block(), method="least_squares", order=3, **FOLDING)
    assert 'the method "valid" (--method valid) mends what the grid allows' in str(warning.message)


def test_the_command_fit_tells_what_control_points_are_and_what_least_squares_would_be(tmp_path, capsys):
    write_grid(tmp_path / "thin.xyz", folded_block())
    command = ["fit", str(tmp_path / "thin.xyz"), "-o", str(tmp_path / "thin.h5"), "--n-control", "9x5x4"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", FitWarning)  # what is printed is not warned of as well
        assert run([*command, "--method", "least_squares"]) == 0
        assert "elements of the control mesh invalid" in capsys.readouterr().err
        assert run([*command, "--overwrite"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    fallback = FittedModel.load(tmp_path / "thin.h5").report.fallback
    assert f"{fallback.n_moved} of 180 control points are placed otherwise to avoid these" in out
    n_invalid = fallback.least_squares_invalid
    assert f"leave {n_invalid} invalid elements, RMS error {fallback.least_squares_rms:.3e} m" in out
    assert f"{fallback.n_points[0]} least squares" in out


def test_a_file_holds_the_shares(tmp_path):
    model = fit_grid(folded_block(), **FOLDING)
    model.save(tmp_path / "model.h5")
    loaded = FittedModel.load(tmp_path / "model.h5")
    np.testing.assert_array_equal(loaded.candidate_weights, model.candidate_weights)
    assert loaded.report == model.report
    assert loaded.candidate_weights.shape == (model.report.n_control_points, len(CANDIDATES))
