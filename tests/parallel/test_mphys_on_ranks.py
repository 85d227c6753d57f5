"""Solvers on several ranks, through MPhys, with our geometry and grid movement."""

import pytest
from parallel_cases import run_ranks

pytest.importorskip("mphys", reason="MPhys is not installed")


@pytest.mark.slow
@pytest.mark.parametrize(("solver", "generation", "n"), [("ADflow", 2, 3), ("DAFoam", 1, 2)])
def test_a_solver_on_several_ranks_gets_its_own_nodes_and_the_totals_of_one_process(solver, generation, n):
    printed = run_ranks("cases/mphys_solver.py", n, solver, str(generation), timeout=240.0)
    n_walls = [int(text.split()[0]) for text in printed]
    assert len(set(n_walls)) > 1
    assert n_walls[-1] == 0


@pytest.mark.slow
def test_a_flow_of_ours_has_the_totals_of_one_process_on_several():
    assert run_ranks("cases/mphys_flow.py", 2, timeout=240.0) == ["done\n"] * 2


@pytest.mark.slow
def test_wrong_nodes_of_one_rank_are_refused_on_all_and_the_next_run_goes_on():
    assert run_ranks("cases/mphys_failures.py", 2, timeout=240.0) == ["done\n"] * 2
