"""Fits, model files and local models on several ranks."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.parametrize(
    ("n", "grids"), [(2, ["two blocks", "a fold"]), pytest.param(3, [], marks=pytest.mark.slow)], ids=str
)
def test_a_fit_and_its_file_are_those_of_one_process(n, grids):
    assert all("done" in text for text in run_ranks("cases/fit.py", n, *grids, timeout=120.0))


@pytest.mark.parametrize("n", [2, 3])
def test_a_topology_is_that_of_one_process(n):
    assert all("done" in text for text in run_ranks("cases/topology.py", n))


@pytest.mark.parametrize("n", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_fits_frozen_and_live_have_the_totals_of_one_process(n):
    assert all("done" in text for text in run_ranks("cases/live_fit.py", n, timeout=120.0))
