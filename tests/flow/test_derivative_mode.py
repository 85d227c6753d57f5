"""A hint where gradients take more linear solves of the flow than the other mode would."""

import warnings

import numpy as np
import openmdao.api as om
import pytest
from test_spurious_drag import section

from bspline_mdao import DerivativeModeWarning, EulerFlow, NLoptDriver, SpuriousDragWarning
from bspline_mdao.flow.om.derivative_mode import flow_solves


def problem(n_angles, pressures, mode, n_thicknesses=0, objective="CL"):
    """Flow about a section whose angle is the mean of some, with pressures and measures of no flow as constraints."""
    problem = om.Problem(reports=False, driver=om.ScipyOptimizeDriver(disp=False, maxiter=1))
    mean = om.ExecComp(
        f"alpha = sum(angles) / {n_angles}",
        do_coloring=False,
        angles={"val": np.ones(n_angles)},
        alpha={"units": "deg"},
    )
    problem.model.add_subsystem("mean", mean, promotes=["*"])
    flow = EulerFlow(model=section((17, 11)), reference_area=1.0, iprint=0)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_design_var("angles", lower=-2.0, upper=2.0)
    problem.model.add_objective(objective)
    if pressures:
        problem.model.add_constraint("Cp", indices=range(pressures), upper=1.0)
    if n_thicknesses:
        shape = om.ExecComp(
            "thickness = width + 0 * angles[0]",
            do_coloring=False,
            angles=np.ones(n_angles),
            width=np.ones(n_thicknesses),
            thickness=np.ones(n_thicknesses),
        )
        problem.model.add_subsystem("shape", shape, promotes=["*"])
        problem.model.add_constraint("thickness", lower=0.5)
    problem.setup(mode=mode)
    problem.set_val("Mach_number", 0.3)
    return problem


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n_angles", "pressures", "mode", "words"),
    [
        (2, 8, "rev", r"in reverse, by 9 linear solves .* 2 forward .* setup\(mode='fwd'\)"),
        (6, 1, "fwd", r"forward, by 6 linear solves .* 2 in reverse .* setup\(mode='rev'\)"),
    ],
)
def test_the_mode_that_takes_more_solves_of_the_flow_is_told_once(n_angles, pressures, mode, words):
    run = problem(n_angles, pressures, mode)
    run.run_model()
    with pytest.warns(DerivativeModeWarning, match=words):
        run.compute_totals()
    with warnings.catch_warnings():
        warnings.simplefilter("error", DerivativeModeWarning)
        run.compute_totals()


@pytest.mark.parametrize(
    ("n_angles", "pressures", "mode"), [(2, 8, "fwd"), (6, 1, "rev"), (3, 2, "rev"), (2, 8, "auto")]
)
def test_a_mode_that_is_right_or_nearly_so_is_not_told(n_angles, pressures, mode):
    run = problem(n_angles, pressures, mode)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DerivativeModeWarning)
        run.run_model()
        run.compute_totals()


def test_responses_without_flow_count_for_nothing():
    run = problem(4, 0, "auto", n_thicknesses=50)
    run.run_model()
    assert flow_solves(run.model.flow.state, "states") == {"fwd": 4, "rev": 1}
    with pytest.warns(DerivativeModeWarning, match=r"mode='rev'"):  # OpenMDAO counts 51 responses and goes forward
        run.compute_totals()


@pytest.mark.parametrize(
    "driver",
    [om.ScipyOptimizeDriver(disp=False, maxiter=1), NLoptDriver(disp=False, maxiter=1)],
    ids=["SciPy", "NLopt"],
)
def test_spurious_drag_is_told_by_every_driver(driver):
    run = problem(2, 0, "rev", objective="CD")
    run.driver = driver
    run.setup(mode="rev")
    run.set_val("Mach_number", 0.3)
    with pytest.warns(SpuriousDragWarning, match="CD is optimised"):
        run.run_driver()
