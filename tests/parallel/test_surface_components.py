"""Components of the surface on several ranks."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.parametrize("n", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_every_rank_has_the_surface_of_one_process(n):
    assert run_ranks("cases/surface_components.py", n, timeout=240.0) == [f"done {rank}\n" for rank in range(n)]
