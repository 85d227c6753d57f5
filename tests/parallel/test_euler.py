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


def test_files_and_loads_of_a_flow_on_ranks_are_those_of_one(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    printed = run_ranks("cases/euler_files.py", 2, str(tmp_path), timeout=150.0)
    assert all("as alone" in text for text in printed)
    for name in ("Cp", "Mach", "velocity", "entropy", "total_pressure_loss"):
        for end in ("", "_walls"):
            one, many = (pyvista.read(tmp_path / f"{who}{end}.vtm").combine() for who in ("one", "many"))
            if name in one.cell_data:
                assert abs(one.cell_data[name] - many.cell_data[name]).max() < 1e-8
            assert abs(one.point_data[name] - many.point_data[name]).max() < 1e-8
