"""Step 4: twist the wing for the least induced drag at Mach 0.5 and a lift coefficient of 0.25."""

from pathlib import Path

import openmdao.api as om

import bspline_mdao as bm


def pose(model):
    """Pose the problem on a fitted grid, and run it once."""
    wing = bm.DesignSurface.of(model)
    twist = bm.design.Twist("twist", wing.axis, stations=3)
    flow = bm.EulerFlow(model=model, reference_area=wing.planform_area, trim=True, iprint=0)

    problem = om.Problem(driver=bm.NLoptDriver(optimizer="LD_SLSQP"), reports=None)
    problem.model.add_subsystem("shape", wing.grid_movement([twist]), promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_design_var("twist", indices=[1, 2], lower=-6.0, upper=6.0, ref=3.0)  # the root stays
    problem.model.add_constraint("corner_ks", lower=0.05)  # no cell may fold
    problem.model.add_objective("CD_induced", ref=0.005)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", 0.5)
    problem.set_val("CL_target", 0.25)
    problem.run_model()
    return problem


def row(name, problem):
    """One line of the table."""
    twist = " ".join(f"{value:6.2f}" for value in problem.get_val("twist", units="deg"))
    numbers = (problem.get_val(output).item() for output in ("alpha", "CL", "CD_induced", "corner_ks"))
    print("{:8} {}   {:5.2f}   {:.4f}   {:.5f}      {:.3f}".format(name, twist, *numbers))


if __name__ == "__main__":
    model = bm.FittedModel.load("wing.h5")
    problem = pose(model)
    print("         twist (deg)            alpha   CL       CD_induced   corner_ks")
    row("before", problem)
    problem.driver.add_recorder(om.SqliteRecorder(Path("wing.sql").resolve()))
    problem.driver.recording_options["includes"] = ["*control_points", "*Cp"]
    problem.driver.options["disp"] = False
    problem.run_driver()
    row("after", problem)
    print(problem.driver.result.exit_status, "after", problem.driver.iter_count, "runs")

    grid = model.regenerate().with_vector(problem.get_val("grid"))
    bm.write_grid("optimum.xyz", grid)
    problem.model.flow.write_fields("optimum.vtm")
