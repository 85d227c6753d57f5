"""Invalid control elements: which fits have them, what is said about them, and that the advice helps."""

import re
import warnings

import numpy as np
import pytest
from fit_cases import grid_of, lattice

from bspline_mdao import FitWarning, fit_grid, flat_plate_grid, onera_m6_grid, read_grid, write_grid
from bspline_mdao.cli.main import run


def folded_grid():
    """A thin layer over a bump that four spans cannot follow: control points on the wall pass those above it."""
    nodes = lattice(41, 15, 13, powers=(1, 3, 1))
    nodes[..., 1] *= 0.02
    nodes[..., 1] += 0.3 * np.exp(-((nodes[..., 0] - 0.43) ** 2) / 0.0008)
    nodes[..., 0] += 0.2 * nodes[..., 1] * nodes[..., 2]
    return grid_of(nodes)


def warned(grid, **options):
    """Fit a grid that folds; the model and what was said."""
    with pytest.warns(FitWarning) as record:
        model = fit_grid(grid, **options)
    (warning,) = record
    return model, warning


@pytest.mark.parametrize("make", [onera_m6_grid, flat_plate_grid])
@pytest.mark.parametrize("shape", [(5, 5, 5), (6, 5, 9), (9, 9, 7), (12, 9, 11)])
def test_small_generated_grids_have_valid_control_meshes_within_their_domain(make, shape):
    grid = make(shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error", FitWarning)
        model = fit_grid(grid)
    nodes = grid.to_vector().reshape(-1, 3)
    assert model.report.n_invalid == 0
    assert np.abs(model.control_points).max() < 1.001 * np.abs(nodes).max()
    assert model.report.relative_rms < 0.02


def test_a_fit_with_invalid_elements_says_so_once_at_the_line_that_asked_for_it():
    model, warning = warned(onera_m6_grid((9, 9, 7)), order=4)
    assert warning.filename == __file__
    assert "\n" not in str(warning.message)
    for words in (
        model.header.source,
        f"{model.report.n_invalid} of 768 control elements",
        model.report.invalid[0].name,
    ):
        assert words in str(warning.message)
    assert model.report.warnings[-1] in str(warning.message)


@pytest.mark.parametrize(
    ("shape", "options"),
    [((5, 5, 5), {"order": 4}), ((9, 9, 7), {"order": 4}), ((9, 9, 7), {"order": 4, "n_control": (9, 9, 7)})],
)
def test_leaving_out_order_and_numbers_mends_fits_of_few_nodes(shape, options):
    model, warning = warned(onera_m6_grid(shape), **options)
    assert "leave the order and the number of control points out" in str(warning.message)
    assert model.report.n_invalid > 100
    assert fit_grid(onera_m6_grid(shape)).report.n_invalid == 0


def promised(message):
    """Number of invalid elements that a warning says infinite smoothing leaves."""
    number = re.search(r"smoothing = inf \(--smoothing inf\) leaves (none|\d+)", message)[1]
    return 0 if number == "none" else int(number)


def test_infinite_smoothing_leaves_as_many_invalid_elements_as_the_warning_says():
    model, warning = warned(folded_grid(), n_control=(7, 6, 5))
    assert (
        promised(str(warning.message))
        == fit_grid(folded_grid(), n_control=(7, 6, 5), smoothing=np.inf).report.n_invalid
    )
    assert promised(str(warning.message)) < model.report.n_invalid


@pytest.mark.parametrize(
    "name", ["aither_rae2822.xyz", "cfl3d_delta_wing.fmt.gz", "cfl3d_sduct.bin", "pyhyp_m6_9blocks.xyz"]
)
def test_the_advice_for_real_grids_keeps_its_promise(real_grids, name):
    grid = read_grid(real_grids / name)
    model, warning = warned(grid)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        mended = fit_grid(grid, topology=model.topology, smoothing=np.inf)
    # elements of the delta wing are flat to round-off, and count or do not
    assert abs(mended.report.n_invalid - promised(str(warning.message))) <= 1
    assert mended.report.n_invalid <= model.report.n_invalid / 3
    assert ("invalid cells itself" in str(warning.message)) == (mended.report.n_invalid > 0)


def test_the_command_fit_ends_with_what_is_wrong_and_what_to_do(tmp_path, capsys):
    write_grid(tmp_path / "thin.xyz", folded_grid())
    command = ["fit", str(tmp_path / "thin.xyz"), "-o", str(tmp_path / "thin.h5"), "--n-control", "7", "6", "5"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", FitWarning)  # what is printed is not warned of as well
        assert run(command) == 0
    last = capsys.readouterr().out.rstrip().splitlines()[-1]
    assert last.startswith("warning: ")
    assert promised(last) == 0
    assert run([*command, "--smoothing", "inf"]) == 0
    assert "invalid" not in capsys.readouterr().out
