"""The grid distributed over ranks: bits, products, totals and checks."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.parametrize(
    ("n", "arguments"),
    [
        (2, ("wing", "nothing")),
        (3, ("block", "rows")),
        pytest.param(2, ("wing", "subdomain", "surface"), marks=pytest.mark.slow),
        pytest.param(3, ("block", "surface"), marks=pytest.mark.slow),
        pytest.param(4, ("linear", "nothing"), marks=pytest.mark.slow),
    ],
)
def test_the_grid_and_its_totals_are_those_of_one_process(n, arguments):
    assert run_ranks("cases/grid_evaluate.py", n, *arguments, timeout=240.0) == [f"done {rank}\n" for rank in range(n)]
