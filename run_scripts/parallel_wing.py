"""A million nodes on several processes.

Twist and camber of least induced drag of the M6 wing in a grid of a million nodes, on several processes. The lift is
given, as are bounds of the nose-down moment and of the worst cell. It runs as ``mpirun -n 2 python
run_scripts/parallel_wing.py``, or on one process. It takes a minute, and seconds with ``--quick``: 38 CPU seconds and
2.0 GB on one process, 36 and up to 1.9 GB on each of two, much of it for the movement, which one does while the other
waits. The output is lift, drag and moment at the start and at the optimum, the nodes, CPU seconds and peak memory of
each process, and how the optimiser ended.
"""

from __future__ import annotations

import time

import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.parallel import from_all, world
from bspline_mdao.scripts import pick_size, run

SIZES = {
    "quick": ((9, 9, 7), (6, 5, 4), (3, 9)),
    "default": ((45, 65, 33), (13, 13, 9), (5, 31)),
}
"""Nodes and control points of each of twelve blocks, and nodes of the lattice along chord and half span."""

LIFT, MOMENT, MACH = 0.35, 0.19, 0.3
"""Lift coefficient, and what the moment about the nose that turns it down may be at most."""

WORST_CORNER = 0.1
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

STATIONS = 4


def pose(model, lattice: tuple[int, int]) -> om.Problem:
    """Pose the problem of a model, or of a process's part of one. Not yet set up.

    The axis is the trailing edge, which stays straight, and so does the wake.
    """
    mesh = bm.movers.moving_mesh(model)
    axis = bm.design.ReferenceAxis.of(mesh, at=1.0)
    sections = [bm.design.Camber("camber", axis, STATIONS), bm.design.Twist("twist", axis, STATIONS)]
    geometry = bm.GridMovement(
        model=model,
        parametrization=bm.design.Parametrization(mesh, sections),
        mover=bm.movers.LinearElasticity(mesh, n_increments=1),
        fit=False,
    )
    n_chord, n_span = lattice
    flow = bm.LatticeFlow(model=model, n_chord=n_chord, n_span=n_span, reference_area=0.7532, patches="wing*")
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.set_input_defaults("Mach_number", val=MACH)
    problem.model.add_design_var("alpha", lower=0.0, upper=10.0, ref=3.0, units="deg")
    problem.model.add_design_var("twist", indices=range(1, STATIONS), lower=-8.0, upper=8.0, ref=3.0, units="deg")
    problem.model.add_design_var("camber", lower=-0.03, upper=0.03, ref=0.02)
    problem.model.add_constraint("CL", equals=LIFT, ref=LIFT)
    problem.model.add_constraint("CM", indices=[2], upper=MOMENT, ref=MOMENT)
    problem.model.add_constraint("corner_ks", lower=WORST_CORNER)
    problem.model.add_objective("CD_induced", ref=0.01)
    return problem


def main(quick: bool = False) -> dict:
    """Find the twist and the camber.

    Parameters
    ----------
    quick : bool
        Some 7,000 nodes.

    Returns
    -------
    dict
        ``n_nodes``; `aerodynamics` of the ``initial`` and the ``optimal`` wing; ``success``, ``exit_status`` and
        ``evaluations`` of the optimiser; and of ``processes``, in their order, nodes, CPU seconds and peak memory.
    """
    shape, n_control, lattice = pick_size(SIZES, quick=quick)
    comm = world()
    model = bm.splines.fit_blocks(bm.generators.onera_m6_grid(shape), comm, n_control=n_control).local_model()
    problem = pose(model, lattice)
    problem.driver = bm.NLoptDriver(optimizer="LD_SLSQP", ftol_rel=1e-6, maxeval=60)
    problem.setup(mode="rev")
    problem.run_model()
    initial = aerodynamics(problem)
    result = problem.run_driver()
    return {
        "n_nodes": model.n_nodes,
        "initial": initial,
        "optimal": aerodynamics(problem),
        "success": bool(result.success),
        "exit_status": result.exit_status,
        "evaluations": result.model_evals,
        "processes": from_all(comm, process(problem)),
    }


def aerodynamics(problem: om.Problem) -> dict:
    """Lift, induced drag, moment, angle of attack, twist and camber, and the bound of the worst cell."""
    numbers = {name: problem.get_val(name).item() for name in ("CL", "CD_induced", "corner_ks")}
    angles = {name: problem.get_val(name, units="deg").tolist() for name in ("alpha", "twist")}
    return {**numbers, "CM": problem.get_val("CM")[2], **angles, "camber": problem.get_val("camber").tolist()}


def process(problem: om.Problem) -> dict:
    """Nodes, CPU time and peak memory of this process."""
    n_nodes = problem.get_val("grid").size // 3
    return {"nodes": n_nodes, "cpu_seconds": time.process_time(), "peak_mb": peak_mb()}


def peak_mb() -> float:
    """Largest memory of this process so far (MB), on Linux."""
    with open("/proc/self/status") as status:
        (line,) = [line for line in status if line.startswith("VmHWM")]
    return int(line.split()[1]) / 1000.0


if __name__ == "__main__":
    run(main)
