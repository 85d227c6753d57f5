"""Whatever component fails on the last rank alone fails on all of them with its words, and goes on afterwards.

The first argument is "run" or "setup".
"""

import sys
from pathlib import Path

import numpy as np
import openmdao.api as om

sys.path.append(str(Path(__file__).parents[2] / "flow"))
from test_products import COMPONENTS, VALUES, model, residual, surface

from bspline_mdao import GridMovement
from bspline_mdao.base.numerics.processes import world
from bspline_mdao.errors import InputError

comm = world()
is_last = comm.rank == comm.size - 1
SILENT = (
    *("EulerForces", "EulerWallForces", "LatticeForces", "WakeForces"),
    *("Displaced", "Renamed", "SolverLoads"),
)
"""Components that look at nothing: what is not finite has been refused upstream."""

REFUSED = ("PointSet, in the volumes",)
"""Components that one process alone can run."""


class Fed(om.Group):
    """A component whose distributed inputs, which need a source, start where it says."""

    def initialize(self):
        self.options.declare("name")

    def setup(self):
        self.add_subsystem("source", om.IndepVarComp("unused"))
        self.add_subsystem("component", COMPONENTS[self.options["name"]](), promotes=["*"])

    def configure(self):
        asked = self.component.get_io_metadata("input", ["val", "units", "distributed"])
        for name, meta in asked.items():
            if meta.pop("distributed"):
                self.source.add_output(name, val=meta["val"], units=meta["units"], distributed=True)
                self.promotes("source", outputs=[name])


def component_of(name):
    """A component that has run where it begins."""
    problem = om.Problem(Fed(name=name), reports=False)
    problem.setup()
    for variable, value in VALUES.get(name, {}).items():
        problem.set_val(variable, value)
    problem.run_model()
    return problem.model.component


def raised(task):
    """Kind and words of what a task raises, the same on all ranks."""
    found = None
    try:
        task()
    except Exception as error:
        found = type(error), str(error)
    everywhere = comm.allgather(found)
    assert all(each == everywhere[0] for each in everywhere), everywhere
    return found


def run(name):
    """A number that is not finite on one rank, then the run before."""
    if name in REFUSED:
        kind, words = raised(lambda: component_of(name))
        assert kind is InputError, words
        return
    component = component_of(name)
    point = [vector.asarray(copy=True) for vector in (component._inputs, component._outputs)]
    good = residual(component, point)
    bad = [vector.copy() for vector in point]
    if is_last:
        bad[0][:1] = np.nan

    def fail():
        component._inputs.set_val(bad[0])
        component.run_solve_nonlinear()

    found = raised(fail)
    if name in SILENT:
        assert found is None, found
    else:
        assert found[0] is om.AnalysisError, found
        assert "nan" in found[1], found
    assert np.array_equal(residual(component, point), good)


def setup(**options):
    """An option that is wrong on one rank."""

    def fail():
        problem = om.Problem(reports=None)
        problem.model.add_subsystem("chain", GridMovement(model=model(), **(options if is_last else {})))
        problem.setup()

    kind, words = raised(fail)
    assert kind is InputError, words
    print(words)


if sys.argv[1] == "run":
    for name in COMPONENTS:
        run(name)
        print(name)
else:
    setup(live=True, fit=False)
    setup(quality=["nothing"])
    setup(surface=surface(), numbers=[-1])
