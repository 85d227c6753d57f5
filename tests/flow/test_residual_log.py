"""Lines of a flow that converges."""

from functools import cache

import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, fit_grid
from bspline_mdao.generators import onera_m6_grid


@cache
def wing():
    """A wing of 1,536 cells."""
    return fit_grid(onera_m6_grid((7, 5, 5)))


def run(level=None, **options):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("flow", EulerFlow(model=wing(), reference_area=1.16, **options), promotes=["*"])
    if level is not None:
        problem.set_solver_print(level=level)
    problem.setup()
    problem.run_model()
    return problem


def test_log_has_aligned_columns_and_ends_with_the_residual_lift_and_drag_of_the_flow(capsys):
    flown = run(iprint=2)
    name, head, *lines, end = capsys.readouterr().out.splitlines()
    assert name == "flow.state"
    assert head.split() == ["step", "residual", "CFL", "products", "length", "CL", "CD"]
    ends = {i for i in range(len(head)) if head[i] != " " and head[i : i + 2].rstrip() == head[i]}
    for line in lines:
        assert {i for i in range(len(line)) if line[i] != " " and line[i : i + 2].rstrip() == line[i]} == ends
    history = flown.model.flow.state.solution.history
    assert [line.split()[0] for line in lines] == [str(n) for n in range(1, len(history))]
    _, residual, _, products, _, lift, drag = lines[-1].split()
    assert residual == f"{history[-1].residual:.2e}"
    assert int(products) == history[-1].n_products
    assert float(lift) == pytest.approx(flown.get_val("CL").item(), abs=1e-6)
    assert float(drag) == pytest.approx(flown.get_val("CD").item(), abs=1e-6)
    assert end.startswith("flow.state: residual")


def test_flow_says_one_line_unless_it_is_asked_for_more(capsys):
    run()
    assert len(capsys.readouterr().out.splitlines()) == 1


@pytest.mark.parametrize("options", [{"iprint": 0}, {"iprint": -1}, {"level": -1}, {"level": 0}])
def test_flow_and_its_solvers_are_silenced(options, capsys):
    problem = run(**options)
    problem.compute_totals(["CL"], ["alpha"])
    assert capsys.readouterr().out == ""


def test_print_level_of_a_problem_is_that_of_its_flow(capsys):
    run(level=2)
    assert "products" in capsys.readouterr().out
