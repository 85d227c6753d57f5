"""Movement on several ranks."""

import importlib.util

import pytest
from parallel_cases import run_ranks

needs_petsc = pytest.mark.skipif(not importlib.util.find_spec("petsc4py"), reason="no petsc4py")


@needs_petsc
@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3])
def test_solvers_of_petsc_share_rows(n):
    assert run_ranks("cases/petsc_solvers.py", n, timeout=100.0) == [f"done {rank}\n" for rank in range(n)]


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3])
def test_every_mover_moves_control_points_alike_everywhere(n):
    arguments = ["petsc4py"] if importlib.util.find_spec("petsc4py") else []
    printed = run_ranks("cases/control_mesh_move.py", n, *arguments, timeout=100.0)
    assert [text.splitlines()[-1] for text in printed] == [f"done {rank}" for rank in range(n)]
    assert "the control mesh tangles" in printed[0]
    assert not any("the control mesh tangles" in text for text in printed[1:])


@needs_petsc
@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3])
def test_rows_of_tied_points_are_shared(n):
    assert run_ranks("cases/tied_sides_move.py", n, timeout=100.0) == [f"done {rank}\n" for rank in range(n)]
