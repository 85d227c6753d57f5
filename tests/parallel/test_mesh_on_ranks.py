"""A mesh without structure whose nodes are dealt out to ranks."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3])
def test_a_mesh_moves_on_ranks_as_on_one_process(n):
    assert run_ranks("cases/mesh_movement.py", n, timeout=240.0) == [f"done {rank}\n" for rank in range(n)]
