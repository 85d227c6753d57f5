"""Smooth seams between patches.

A ball that swells on one of its six sides: with and without one tangent plane across the seams around it. The body has
least area at a larger volume, and only the control points inside one side may move. Without a constraint the side
becomes a cap on the ball, like a soap film on a ring, with a kink all around. With linear equations among control
points the seams follow and stay smooth: nearly, if only the points on them follow, and all along them if some of the
adjacent points follow too. Bounds keep the curvature from jumping there. It takes some fifteen seconds. The output is
kinks and curvatures across the seams before and after, areas, a check of the totals, STEP files of all bodies with what
OpenCascade reads back, if it is installed, and a picture of the section and of kinks and jumps along the seams.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import nlopt, recorded
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, PURPLE, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals, perturb_design

LARGER = 1.15
"""Volume of the body relative to the ball's."""

TOLERANCE = 1e-12
"""Of the area (m^2)."""

SIZES = {False: (17, 7), True: (33, 11)}
"""Nodes and control points along the edges of each side, at the larger size (True) and small."""

WAYS = {"free": (None, None), "nearly": (0.1, None), "smooth": (1e-3, None), "fair": (1e-3, 0.3)}
"""Tolerance of tangent continuity of each body, and the bound of its jumps of curvature (1/m); None without."""

COLORS = {"free": ORANGE, "nearly": GREEN, "smooth": BLUE, "fair": PURPLE}


class Ball:
    """A ball whose seams are smooth to round-off: ``model``, ``mesh``, ``surface`` and the ``inside`` of its top."""

    def __init__(self, n_nodes: int, n_control: int):
        fitted = bm.fit_grid(
            bm.generators.ball_grid((n_nodes, n_nodes, n_nodes, 5)), n_control=(n_control, n_control, 4)
        )
        mesh = bm.movers.moving_mesh(fitted)
        self.kink = bm.measures.seam_continuity(fitted)[0].max_kink
        points = fitted.control_points.copy()
        points[mesh.surface_ids] = bm.constraints.TangentContinuity().snapped(mesh, points[mesh.surface_ids])
        self.model = replace(fitted, control_points=points, residual=None)
        self.mesh, self.surface = bm.movers.moving_mesh(self.model), bm.measures.SurfaceGrid.of(self.model)
        self.points = self.mesh.points[self.mesh.surface_ids]
        longest = np.abs(self.points).max(axis=1)
        self.inside = np.flatnonzero(self.points[:, 2] > np.sort(np.abs(self.points), axis=1)[:, 1] * (1.0 + 1e-6))
        self.rays = (self.points / longest[:, None])[self.inside]

    def problem(self, tolerance: float | None, bound: float | None = None) -> om.Problem:
        """Least area at the larger volume, not set up."""
        outside = np.setdiff1d(np.arange(len(self.points)), self.inside)
        constraints = [bm.constraints.TangentContinuity(tolerance=tolerance, followers=outside)] if tolerance else []
        swelling = bm.design.Local("swelling", self.inside, direction=self.rays)
        parametrization = bm.design.Parametrization(self.mesh, [swelling], constraints=constraints)
        problem = om.Problem(reports=None)
        evaluate = bm.SurfaceEvaluate(model=self.model, mesh=self.mesh, surface=self.surface)
        area, volume = bm.measures.SurfaceArea.of(self.surface), bm.measures.EnclosedVolume.of(self.surface)
        problem.model.add_subsystem("control", bm.SurfaceControl(parametrization=parametrization), promotes=["*"])
        problem.model.add_subsystem("evaluate_surface", evaluate, promotes=["*"])
        problem.model.add_subsystem("area", bm.SurfaceMeasure(measure=area), promotes=["*"])
        problem.model.add_subsystem("volume", bm.SurfaceMeasure(measure=volume), promotes=["*"])
        if bound is not None:
            jumps = bm.measures.SeamSmoothness.curvature_jumps(self.model, self.mesh)
            problem.model.add_subsystem("jumps", bm.measures.SeamMeasure(measure=jumps), promotes=["*"])
            problem.model.add_constraint(jumps.name, lower=-bound, upper=bound)
        problem.model.add_design_var("swelling", ref=0.2)
        problem.model.add_objective("surface_area", ref=10.0)
        problem.model.add_constraint("volume", equals=LARGER * volume.evaluate(self.surface.points), ref=4.0)
        return problem

    def control_points(self, problem: om.Problem) -> np.ndarray:
        """All control points of a body; those inside of the volumes stay."""
        points = self.model.control_points.copy()
        points[self.mesh.surface_ids] = problem.get_val("surface_control_points").reshape(-1, 3)
        return points


def main(paper: bool = False, figures=None, folder=None) -> dict:
    """Let the ball swell in all ways.

    Parameters
    ----------
    paper : bool
        More nodes and control points.
    figures : path-like, optional
        Folder for ``smooth_seams.png``.
    folder : path-like, optional
        Folder of ``free.step`` and the other STEP files; they are removed again by default.

    Returns
    -------
    dict
        ``fitted_kink`` and ``snapped_kink``, the largest kink (deg) of the ball as fitted and as snapped; for each body
        its ``area`` (m^2) and ``volume`` (m^3), the largest ``kink`` (deg) and the largest jump of ``curvature`` across
        seams (1/m), what `RecordedRun.numbers` returns, and ``cad``, numbers of the STEP file, or None; ``totals`` of
        the fair one, see `check_totals`.
    """
    ball = Ball(*SIZES[paper])
    bodies, seams, numbers = {}, {}, {}
    for name, (tolerance, bound) in WAYS.items():
        problem = ball.problem(tolerance, bound)
        problem.driver = nlopt(TOLERANCE, 300)
        with recorded(problem) as done:
            problem.run_driver()
        bodies[name] = done.problem
        points = ball.control_points(done.problem)
        seams[name] = bm.measures.seam_continuity(ball.model, points)
        numbers[name] = done.numbers() | {
            "area": done.problem.get_val("surface_area").item(),
            "volume": done.problem.get_val("volume").item(),
            "kink": seams[name][0].max_kink,
            "curvature": max(seam.max_jump for seam in seams[name]),
            "cad": into_cad(ball.model, points, name, folder),
        }
    started = ball.problem(*WAYS["fair"])
    started.setup(mode="rev")
    started.run_model()
    if figures:
        draw(figures, ball, bodies, seams)
    snapped = bm.measures.seam_continuity(ball.model)[0].max_kink
    totals = check_totals(perturb_design(started))._asdict()
    return {"fitted_kink": ball.kink, "snapped_kink": snapped, **numbers, "totals": totals}


def into_cad(model: bm.FittedModel, points: np.ndarray, name: str, folder=None) -> dict | None:
    """Write a body as STEP, and say what is read back; None where OpenCascade is not installed."""
    if find_spec("OCP") is None:
        return None
    with TemporaryDirectory() as other:
        report = bm.files.write_cad(Path(folder or other, f"{name}.step"), model, points)
    names = "distance", "tolerance", "is_valid", "n_solids", "n_open", "n_exact", "n_bytes"
    return {name: getattr(report, name) for name in names}


def draw(figures, ball: Ball, bodies: dict[str, om.Problem], seams) -> None:
    """Draw the section of all bodies, and kinks and curvatures along the seams around their tops."""
    fine = ball.model.member(6.0)  # so that curves are seen as curves
    x = fine.regenerate().to_vector().reshape(-1, 3)
    cut = bm.measures.SurfaceGrid.of(fine).rows
    cut = cut[np.abs(x[cut, 1]) < 1e-6]
    cut = cut[np.argsort(np.arctan2(x[cut, 0], x[cut, 2]))]
    rim = {seam.number for seam in seams["free"][:4]}  # the kinks of the cap
    with figure(figures, "smooth_seams", (12.0, 3.8), n_colours=128) as drawing:
        left, middle, right = drawing.subplots(1, 3)
        left.plot(*x[np.append(cut, cut[0])][:, [0, 2]].T, color=GRAY, label="ball")
        for name, color in COLORS.items():
            nodes = fine.regenerate(ball.control_points(bodies[name])).to_vector().reshape(-1, 3)[cut]
            left.plot(*np.append(nodes, nodes[:1], axis=0)[:, [0, 2]].T, color=color, label=name)
            around = [seam for seam in seams[name] if seam.number in rim]
            kinks = np.array([seam.kinks for seam in around])
            jumps = np.abs(np.diff([seam.curvatures for seam in around], axis=2))
            at = np.linspace(0.0, 1.0, kinks.shape[1] + 2)[1:-1]
            middle.semilogy(at, kinks.max(axis=0), color=color, label=name)
            right.semilogy(at, jumps.max(axis=0), color=color, label=name)
        left.set(aspect="equal", xlabel="$x$ (m)", ylabel="$z$ (m)")
        middle.set(xlabel="fraction of a seam", ylabel="kink (deg)", ylim=(1e-6, 100.0))
        right.set(xlabel="fraction of a seam", ylabel="jump of curvature (1/m)", ylim=(1e-2, 10.0))
        left.legend(frameon=False)
        right.legend(frameon=False)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/smooth_seams.png'
