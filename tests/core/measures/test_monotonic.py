"""Differences of neighbouring values, as a kernel and as a linear constraint."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao.constraints import Monotonic
from bspline_mdao.core.measures.monotonic import neighbour_differences
from bspline_mdao.errors import InputError


@pytest.mark.parametrize("n", [2, 5, 6])
def test_differences_are_those_of_numpy(n):
    values = np.random.default_rng(n).normal(size=n)
    np.testing.assert_array_equal(neighbour_differences(n).apply(values), np.diff(values))
    np.testing.assert_array_equal(neighbour_differences(n, decreasing=True).apply(values), -np.diff(values))


def test_the_entries_are_the_matrix():
    rows, cols, entries = differences = neighbour_differences(4)
    matrix = np.zeros((3, 4))
    matrix[rows, cols] = entries
    np.testing.assert_array_equal(matrix, np.diff(np.eye(4), axis=0))
    assert differences.apply(np.array([1j, 0.0, 2j, 0.0])).tolist() == [-1j, 2j, -2j]


def problem(decreasing, size=5):
    found = om.Problem(reports=False)
    found.model.add_subsystem("twist", om.IndepVarComp("twist", np.zeros(size), units="deg"), promotes=["*"])
    options = {"variable": "twist", "size": size, "units": "deg", "decreasing": decreasing}
    found.model.add_subsystem("monotonic", Monotonic(**options), promotes=["*"])
    return found


@pytest.mark.parametrize("decreasing", [False, True])
def test_partials_are_exact_and_constant(decreasing):
    found = problem(decreasing)
    found.setup(force_alloc_complex=True)
    found.set_val("twist", np.random.default_rng(3).normal(size=5))
    found.run_model()
    checked = found.check_partials(out_stream=None, method="cs")["monotonic"]["twist_differences", "twist"]
    np.testing.assert_allclose(checked["J_fwd"], checked["J_fd"], atol=1e-15)
    assert checked["J_fwd"].any()
    before = found.get_val("twist_differences").copy()
    totals = found.compute_totals("twist_differences", "twist")["twist_differences", "twist"]
    sign = -1.0 if decreasing else 1.0
    np.testing.assert_array_equal(totals, sign * np.diff(np.eye(5), axis=0))
    np.testing.assert_allclose(totals @ found.get_val("twist"), before, atol=1e-15)


def test_an_optimiser_finds_the_nearest_monotonic_distribution():
    found, target = problem(decreasing=True), np.array([3.0, 3.5, 1.0, 1.2, -1.0])
    found.model.add_subsystem("miss", om.ExecComp("miss = sum((twist - target)**2)", twist={"shape": 5, "units": "deg"},
                                                  target=target), promotes=["*"])  # fmt: skip
    found.model.add_design_var("twist")
    found.model.add_constraint("twist_differences", lower=0.0, linear=True)
    found.model.add_objective("miss")
    found.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-12, disp=False)
    found.setup()
    found.run_driver()
    # neighbours that violate the order are pooled
    np.testing.assert_allclose(found.get_val("twist"), [3.25, 3.25, 1.1, 1.1, -1.0], atol=1e-6)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="1 stations; give 2 at least"):
        neighbour_differences(1)
    found = problem(decreasing=False)
    found.setup()
    found.set_val("twist", np.nan, indices=2)
    with pytest.raises(om.AnalysisError, match=r"twist\[2\] is nan"):
        found.run_model()
