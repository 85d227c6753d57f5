"""Least fuel burn of a flexible wing: twist of the regenerated wing and thickness of OpenAeroStruct's tubular spar."""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from common import GRAY, figure, run
from history import COLORS
from lattice_wing import LINES, RectangularWing, started
from optimisation import DRIVERS, flow_in_one, optimise, write_n2
from totals import check_totals

from bspline_mdao.design.planform import Twist
from bspline_mdao.design.reference_axis import ReferenceAxis
from bspline_mdao.om.flow.aerostructure import Aerostructure, Spar

STATIONS = 4
"""Of the twist; its spline is too smooth to make use of what the panel forces leave out."""

THICKNESS = (0.003, 0.003, 0.003, 0.003)
"""Of the spar's wall where the optimisation starts, from the tip to the root (m)."""

GAUGE = 5e-4
"""Least thickness of the wall (m)."""

TOLERANCE = 1e-10
"""Of the objective, the fuel by 10 kg."""


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Find the least fuel burn with every driver, stress and lift constrained.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 30 strips per half wing; some 15,000 nodes and 10 strips by default.
    figures : path-like, optional
        Folder for ``wing_aerostructural.png`` and the N2 diagram ``wing_aerostructural.html``.
    drivers : dict
        Makers of drivers by name, see `optimisation.DRIVERS`.

    Returns
    -------
    dict
        ``totals``, see `totals.check_totals`; what `flight` tells of the ``initial`` wing; for each driver that
        and what `optimisation.Run.numbers` tells.
    """
    wing = RectangularWing.of(paper, n_chord=2)  # the loads on the spar are what matters
    start = started(pose(wing))
    runs = {name: optimise(lambda: pose(wing), make(TOLERANCE, 100)) for name, make in drivers.items()}
    if figures:
        write_n2(start, figures, "wing_aerostructural")
        draw(figures, {"initial": start, **{name: found.problem for name, found in runs.items()}})
    return {
        "initial": flight(start),
        "drivers": {name: flight(found.problem) | flow_in_one(found) for name, found in runs.items()},
        "totals": check_totals(twisted(start)),
    }


def pose(wing: RectangularWing) -> om.Problem:
    """Pose the problem for a wing. Not yet set up."""
    nodes = wing.lattice.evaluate(wing.lattice.surface.points).reshape(wing.lattice.shape)
    twist = Twist("twist", ReferenceAxis.of(wing.mesh, at=0.25), STATIONS)
    problem = wing.problem([twist], Aerostructure(lattice=nodes, spar=Spar(THICKNESS)))
    model = problem.model
    model.add_design_var("twist", lower=-15.0, upper=15.0, ref=5.0, units="deg")
    model.add_design_var("spar_thickness", ref=1e-3, units="m")  # a spline's control points: the wall itself is bounded
    model.add_constraint("wall_thickness", lower=GAUGE, ref=1e-3, units="m")
    model.add_constraint("failure", upper=0.0)
    model.add_constraint("lift_deficit", equals=0.0)
    model.add_objective("fuel_burn", ref=10.0, units="kg")
    return problem


def twisted(problem: om.Problem) -> om.Problem:
    """Run a problem off the symmetry of the initial wing, where some derivatives vanish."""
    problem.set_val("twist", np.linspace(2.0, -1.0, STATIONS), units="deg")
    problem.set_val("spar_thickness", np.linspace(1e-3, 2e-3, len(THICKNESS)), units="m")
    problem.run_model()
    return problem


def flight(problem: om.Problem) -> dict:
    """Collect fuel and mass (kg), coefficients, and where half a wing's lift acts by the semi-span.

    That of an elliptical load is at 4 / (3 pi) = 0.424.
    """
    y, load = load_of(problem)
    numbers = {name: problem.get_val(name).item() for name in ("fuel_burn", "structural_mass", "CL", "CD", "failure")}
    return {**numbers, "centre_of_lift": y @ load / load.sum()}


def load_of(problem: om.Problem) -> tuple[np.ndarray, np.ndarray]:
    """Places of the strips along the span, by the semi-span, and lift per length by its mean."""
    nodes, coefficients = problem.get_val("camber_surface"), problem.get_val("strip_lift")
    chords = np.linalg.norm(nodes[-1] - nodes[0], axis=1)
    load = coefficients * 0.5 * (chords[1:] + chords[:-1])
    y = nodes[0, :, 1] / nodes[0, 0, 1]
    return 0.5 * (y[1:] + y[:-1]), load / load.mean()


def draw(folder, problems: dict[str, om.Problem]) -> None:
    """Draw span load, twist and spar, before and after."""
    with figure(folder, "wing_aerostructural", size=(10.0, 3.2)) as canvas:
        load, twist, spar = canvas.subplots(1, 3)
        for name, problem in problems.items():
            style = {"color": COLORS.get(name, GRAY), "label": name, "linestyle": LINES.get(name, "-")}
            y, strips = load_of(problem)
            load.plot(y, strips, **style)
            twist.plot(np.linspace(0.0, 1.0, STATIONS), problem.get_val("twist", units="deg"), "o", **style)
            spar.step(y, problem.get_val("wall_thickness", units="mm").ravel(), where="mid", **style)
        ellipse = np.sin(np.linspace(0.0, 0.5 * np.pi, 101))
        load.plot(ellipse, 4.0 / np.pi * np.sqrt(1.0 - ellipse**2), "k--", linewidth=0.7, label="ellipse")
        load.legend(fontsize=8)
        for axes, label in ((load, "load by its mean"), (twist, "twist (deg)"), (spar, "wall of the spar (mm)")):
            axes.set(xlabel="$2 y / b$", ylabel=label, xlim=(0.0, 1.0))


if __name__ == "__main__":
    run(main, __doc__)
