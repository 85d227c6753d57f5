"""The flow by the Euler equations on several ranks."""

import pytest
from parallel_cases import run_ranks


@pytest.mark.parametrize(("n", "n_holders"), [(2, 2), (3, 2), pytest.param(3, 3, marks=pytest.mark.slow)])
def test_the_flow_and_its_totals_on_ranks_are_those_on_one(n, n_holders):
    printed = run_ranks("cases/euler.py", n, str(n_holders), timeout=150.0)
    assert all("as alone" in text for text in printed)
    assert all("flow.state" not in text for text in printed[1:])


def test_totals_with_control_points_checks_and_failures_on_ranks():
    printed = run_ranks("cases/euler_chain.py", 2, timeout=150.0)
    assert all("done" in text for text in printed)
    assert "flow.state" in printed[0]
    assert "check on one process, where the derivatives are the same" in printed[0]
    assert printed[1] == "done\n"
