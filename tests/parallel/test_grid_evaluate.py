"""The grid distributed over ranks: bits, products, totals and checks."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.parametrize(("n", "kind"), [(2, "wing"), (3, "block"), (4, "linear")])
def test_the_grid_and_its_totals_are_those_of_one_process(n, kind):
    assert run_ranks("cases/grid_evaluate.py", n, kind, timeout=180.0) == [f"done {rank}\n" for rank in range(n)]
