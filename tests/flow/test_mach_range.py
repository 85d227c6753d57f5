"""Mach numbers out of what was compared with others are said, once for each flow, and no others are."""

import re
import warnings
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, LatticeFlow, MachNumberWarning, fit_grid
from bspline_mdao.flow.om.mach_range import EULER, LATTICE
from bspline_mdao.generators import infinite_wing_grid, naca_section, onera_m6_grid

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def section():
    """A coarse section, whose flow takes no time at any Mach number."""
    return fit_grid(infinite_wing_grid(naca_section(0.12), (9, 5)))


def euler(section):
    problem = om.Problem(reports=None)
    flow = EulerFlow(model=section, reference_area=1.0, tolerance=1e-8, iprint=-1)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup()
    problem.set_val("alpha", 0.0)
    return problem


def lattice(_):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    problem = om.Problem(reports=None)
    flow = LatticeFlow(model=fit_grid(onera_m6_grid((9, 8, 7))), reference_area=0.75, n_chord=2, n_span=4)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    return problem.setup()


def said(problem, mach):
    """Warnings of runs at a Mach number."""
    problem.set_val("Mach_number", mach)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", MachNumberWarning)
        problem.run_model()
    return [str(each.message) for each in found if each.category is MachNumberWarning]


@pytest.mark.parametrize(("make", "known", "out"), [(euler, EULER, 0.06), (lattice, LATTICE, 0.6)])
def test_a_mach_number_out_of_the_comparisons_is_said_once_in_a_line(section, make, known, out):
    problem = make(section)
    assert said(problem, known.highest) == []
    (line,) = said(problem, out)
    assert line == (
        f"flow: Mach_number is {out}; results were compared with others only from {known.lowest:g} to "
        f"{known.highest:g}, see Validation in the documentation"
    )
    assert said(problem, out + 0.01) == []  # not in every run
    problem.setup()
    assert len(said(problem, out)) == 1


def test_a_watch_changes_no_derivative_of_the_lattice(section):
    problem = lattice(section)
    problem.set_val("Mach_number", 0.4)
    problem.run_model()
    total = problem.compute_totals(["CL"], ["Mach_number"])["CL", "Mach_number"].item()
    lifts = []
    for mach in (0.399, 0.401):
        problem.set_val("Mach_number", mach)
        problem.run_model()
        lifts.append(problem.get_val("CL").item())
    assert total == pytest.approx(np.diff(lifts).item() / 0.002, rel=1e-4)


def test_the_pages_have_the_comparisons_at_the_ends_of_the_ranges():
    pages = {
        name: (DOCS / f"{name}.rst").read_text(encoding="utf-8") for name in ("validation", "theory/euler", "flow")
    }
    assert f"At Mach {EULER.lowest} lift is" in pages["theory/euler"]
    assert float(re.search(r"Schmitt and F. Charpin.*Mach ([\d.]+),", pages["validation"])[1]) == pytest.approx(
        EULER.highest, abs=1e-3
    )
    words = " ".join((DOCS / "theory/vortex_lattice.rst").read_text(encoding="utf-8").split())
    assert re.search(rf"twist of least induced drag of this wing at M {LATTICE.highest} ", words)
    for known in (EULER, LATTICE):
        assert f"from {known.lowest:g} to {known.highest:g}" in pages["validation"]
