"""A surrogate with gradients.

A surrogate of designs, by kriging with values and gradients, which SMT makes from a file of designs.
`bspline_mdao.sampling` makes wings from a plan, as it does for networks: here the ONERA M6 with different twists, and a
file of the bound of the Q of their cells. Totals of the problem give the gradients of each. The surrogate is SMT's
gradient-enhanced kriging with partial least squares; it is compared, on designs that it has not seen, with one made
only from values. It takes half a minute. The output is the errors of both, relative to the range of the values.

M. A. Bouhlel and J. R. R. A. Martins, "Gradient-enhanced kriging for high-dimensional problems", Engineering with
Computers 35, 2019.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import openmdao.api as om
from smt.surrogate_models import GEKPLS, KPLS

import bspline_mdao as bm
from bspline_mdao.plotting import BLUE, GRAY, figure
from bspline_mdao.sampling import Designs, LatinHypercube, Sobol, sample
from bspline_mdao.scripts import run

OF = "quality_ks"
"""What the surrogate is of."""

LARGEST = 15.0
"""Largest twist of a station (degrees)."""


def pose() -> tuple[om.Problem, bm.FittedModel]:
    """Pose a problem whose designs are sampled; the model that it moves."""
    wing = bm.DesignSurface.of(bm.fit_grid(bm.generators.onera_m6_grid((9, 8, 7)), n_control=(6, 5, 4)))
    twist = bm.design.Twist("twist", wing.axis, stations=4)
    group = wing.grid_movement([twist], quality=[OF], require_valid=False, fit=False)
    problem = om.Problem(group, reports=None)
    problem.model.add_design_var("twist", lower=-LARGEST, upper=LARGEST, units="deg")
    problem.setup(mode="rev")
    return problem, wing.model


def gradients(problem: om.Problem, values: np.ndarray) -> np.ndarray:
    """Gradients at designs, one row for each."""
    rows = []
    for twist in values:
        problem.set_val("twist", twist, units="deg")
        problem.run_model()
        rows.append(problem.compute_totals([OF], ["twist"])[OF, "twist"].ravel())
    return np.array(rows)


def fitted(designs: Designs, slopes: np.ndarray | None = None):
    """Surrogate of designs: of their values, and of their gradients where these are given."""
    points = designs.values
    limits = np.array([designs.ranges[name][:2] for name in designs.ranges])
    common = {"theta0": [1e-2], "n_comp": 2, "print_global": False}
    if slopes is None:
        surrogate = KPLS(**common)
    else:
        surrogate = GEKPLS(**common, xlimits=limits, delta_x=1e-2, extra_points=points.shape[1])
        for k, slope in enumerate(slopes.T):
            surrogate.set_training_derivatives(points, slope[:, None], k)
    surrogate.set_training_values(points, designs.outputs[OF])
    surrogate.train()
    return surrogate


def main(figures=None, n: int = 16, n_unseen: int = 32) -> dict:
    """Make both surrogates.

    Parameters
    ----------
    figures : path-like, optional
        Folder for ``surrogate_of_designs.png``.
    n, n_unseen : int
        Designs that the surrogates are made of, and those that they are compared at.

    Returns
    -------
    dict
        ``errors`` of the surrogate ``with_gradients`` and ``without``: root mean square by the range of the values; the
        number of ``designs``, and of those ``refused``.
    """
    problem, model = pose()
    with tempfile.TemporaryDirectory() as folder:
        options = {"outputs": [OF], "store": ""}
        seen = sample(problem, model, LatinHypercube(n, seed=1), Path(folder) / "seen.h5", **options)
        unseen = sample(problem, model, Sobol(n_unseen, seed=2), Path(folder) / "unseen.h5", **options)
        slopes = gradients(problem, seen.values)
        surrogates = {"with_gradients": fitted(seen, slopes), "without": fitted(seen)}
        exact, points = unseen.outputs[OF].ravel(), unseen.values
        numbers = {"designs": len(seen), "refused": len(seen.refused) + len(unseen.refused)}
    predicted = {name: surrogate.predict_values(points).ravel() for name, surrogate in surrogates.items()}
    numbers["errors"] = {
        name: float(np.sqrt(np.mean((found - exact) ** 2)) / np.ptp(exact)) for name, found in predicted.items()
    }
    if figures is not None:
        with figure(figures, "surrogate_of_designs", (4.1, 4.1)) as canvas:
            axes = canvas.subplots()
            axes.axline((exact.min(), exact.min()), slope=1.0, color="black", linewidth=0.7)
            styles = (BLUE, "o", "values and gradients"), (GRAY, "x", "values alone")
            for found, (color, marker, label) in zip(predicted.values(), styles):
                axes.plot(exact, found, marker, color=color, markersize=4.5, label=label)
            axes.set(xlabel="bound of the smallest Q of a wing", ylabel="by the surrogate", aspect="equal")
            axes.legend(title=f"kriging of {n} wings", alignment="left")
    return numbers


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/thumbnails/surrogate_of_designs.png'
