"""The component that judges a grid, on several ranks of MPI."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.parametrize("n", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_quality_on_several_ranks_is_that_of_one(n):
    assert run_ranks("cases/quality.py", n, timeout=150.0) == [f"done {rank}\n" for rank in range(n)]
