"""Flows that are solved again on a finer member of their grid, and summaries that show them."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, InputError, design_summary, fit_grid
from bspline_mdao.flow.om.finer_flow import solved_on_finer_grid
from bspline_mdao.generators import airfoil_grid

FACTOR = 1.5


@pytest.fixture(scope="module")
def model():
    return fit_grid(airfoil_grid("naca2412", 32, 12, far=8.0))


def flown(model, trim, moved=None):
    """A flow about the grid of a model, or about moved control points."""
    flow = EulerFlow(model=model, reference_area=0.9, axes="xzy", trim=trim, iprint=0)
    problem = om.Problem(flow, reports=None)
    problem.setup()
    problem.set_val("Mach_number", 0.45)
    problem.set_val("CL_target" if trim else "alpha", 0.31 if trim else 1.3)
    if moved is not None:
        problem.set_val("grid", moved.ravel())
    problem.run_model()
    return problem


@pytest.mark.parametrize("trim", [False, True])
def test_a_flow_on_a_finer_grid_is_that_about_the_member_of_the_model(model, trim):
    problem, member = flown(model, trim), flown(model.member(FACTOR), trim)
    found = solved_on_finer_grid(problem.model, FACTOR)
    for name, value in found.items():
        np.testing.assert_allclose(value, member.get_val(name).item(), rtol=1e-7, atol=1e-9)
    assert abs(found["CD"] - problem.get_val("CD").item()) > 1e-4
    assert abs(found["CL"] - 0.31) < 1e-9 or not trim
    assert abs(found["alpha"] - 1.3) < 1e-12 or trim


def test_it_is_moved_as_the_grid_is(model):
    def pitched(nodes):
        turned = nodes.copy()
        turned[:, 1] -= 0.02 * nodes[:, 0]
        return turned

    nodes, finer = (each.regenerate().to_vector().reshape(-1, 3) for each in (model, model.member(FACTOR)))
    found = solved_on_finer_grid(flown(model, False, pitched(nodes)).model, FACTOR)
    member = flown(model.member(FACTOR), False, pitched(finer))
    # displacements are interpolated in the index, not in place
    assert found["CL"] == pytest.approx(member.get_val("CL").item(), abs=2e-4)
    assert found["CL"] > 0.1 + flown(model, False).get_val("CL").item()


def test_summaries_have_what_was_solved_of_both_designs(model, tmp_path):
    problem = flown(model, True)
    before = design_summary(problem, ["CL", "CD", "alpha"], solved_on=FACTOR)
    problem.set_val("Mach_number", 0.5)
    problem.run_model()
    after = design_summary(problem, ["CL", "CD", "alpha"], solved_on=FACTOR)
    assert set(after.solved) == {"CL", "CD", "alpha"}
    table = after.table(before)
    assert "finer before  finer after" in table
    assert "finer: flows solved on a grid of 1.5 times the cells per direction" in table
    after.write_csv(tmp_path / "summary.csv", before)
    head, *rows = (row.split(",") for row in (tmp_path / "summary.csv").read_text().splitlines())
    drag = dict(zip(head, next(row for row in rows if row[1] == "CD")))
    assert float(drag["finer_before"]) == before.solved["CD"] != float(drag["finer_after"]) == after.solved["CD"]
    assert after.numbers()["alpha"]["solved_finer"] == after.solved["alpha"]
    assert "solved finer" in str(after)


def test_a_grid_that_is_not_finer_is_refused(model):
    problem = flown(model, False)
    with pytest.raises(InputError, match=r"summary: solved_on is 1\.0; give a number above 1"):
        design_summary(problem, ["CL"], solved_on=1.0)
    with pytest.raises(InputError, match=r"a finer member of factor 0\.5"):
        solved_on_finer_grid(problem.model, 0.5)
