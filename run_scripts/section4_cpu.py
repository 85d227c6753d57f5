"""Section IV: CPU times of the B-spline mover and of the node-based one, in one run.

Both move with five increments of linear elasticity, each on a sequence of ever finer meshes: control meshes up to the
one that is used, and members of the grid family up to the largest that the time allows. Both are solved in two ways, by
the paper's conjugate gradients preconditioned with ILU(p) and by sparse Cholesky factors. What the full grid would take
node by node is extrapolated from the measured growth, if it is not reached, and marked as such.

Process time on one thread, meshes and movers in turn; finding the unknowns and the order of elimination counts.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from common import BLUE, ORANGE, figure, run
from morphs import BLENDED_WING_BODY, ONERA_M6, Case, Morph, warm_up

from bspline_mdao import Grid
from bspline_mdao.sparse.cholesky import Cholesky
from bspline_mdao.sparse.conjugate_gradient import ConjugateGradients

CASES = {"onera_m6": ONERA_M6, "blended_wing_body": BLENDED_WING_BODY}
SOLVERS = {"conjugate_gradients": ConjugateGradients(), "cholesky": Cholesky(n_threads=1)}
LABELS = {"b_spline": "B-spline", "node_based": "node-based"}
SMALL = ((9, 9, 9), (5, 5, 5))
"""Nodes and control points of each block at the small size."""

LEVELS = {True: (0.2, 1 / 3, 0.5), False: (0.5, 0.75)}
"""Cells and elements per direction, by those of the case, at the paper's size and small.

At half the paper's cells per direction a Cholesky factor takes 5 GB; twice as many would take a hundred.
"""

N_FITTED = 2
"""Largest meshes from which the growth is found: that of conjugate gradients slows down as meshes get finer."""

SLOWEST_GROWTH = 4 / 3
"""Power with which the time of conjugate gradients grows at least: iterations as the points along an edge."""

MINUTES = {"type": float, "default": 60.0, "help": "time after which no larger mesh is tried (60 by default)"}
"""Option of the command line."""


@dataclass(frozen=True)
class Series:
    """CPU times of one mover with one solver on ever larger meshes."""

    n_points: list[int] = field(default_factory=list)
    cpu_seconds: list[float] = field(default_factory=list)
    iterations: list[list[int]] = field(default_factory=list)

    @property
    def exponent(self) -> float:
        """Power of the number of points with which the time grows, from the largest meshes; 2 until there are two."""
        if len(self.n_points) < 2:
            return 2.0
        n, t = (np.log(values[-N_FITTED:]) for values in (self.n_points, self.cpu_seconds))
        return float(np.polyfit(n, t, 1)[0])

    def at(self, n_points: float, exponent: float | None = None) -> float:
        """Time on a mesh of another size: that of the largest, scaled by the measured growth or by another one."""
        exponent = self.exponent if exponent is None else exponent
        return self.cpu_seconds[-1] * (n_points / self.n_points[-1]) ** exponent

    def add(self, moved) -> None:
        """Append a move."""
        self.n_points.append(moved.n_points)
        self.cpu_seconds.append(moved.cpu_seconds)
        self.iterations.append(moved.numbers()["iterations"])

    def numbers(self) -> dict:
        """What the script tells of it."""
        return {**vars(self), "exponent": self.exponent}


@dataclass(frozen=True)
class Study:
    """A case with the times that were measured so far.

    Parameters
    ----------
    case : Case
        What is moved.
    grid : Grid
        Grid about its first shape.
    n_control : tuple of int
        Control points of each block.
    levels : tuple of float
        Cells per direction of the members of the family, by those of the grid, ascending. The control mesh grows in
        proportion and reaches its size at the last.
    b_spline, node_based : dict
        Times by solver.
    """

    case: Case
    grid: Grid
    n_control: tuple[int, int, int]
    levels: tuple[float, ...]
    b_spline: dict[str, Series] = field(default_factory=lambda: {name: Series() for name in SOLVERS})
    node_based: dict[str, Series] = field(default_factory=lambda: {name: Series() for name in SOLVERS})

    @cached_property
    def morph(self) -> Morph:
        """The case with the whole control mesh."""
        return Morph.of(self.case, self.grid, self.n_control)

    @cached_property
    def control_points(self) -> np.ndarray:
        """Its moved control points, on which the surfaces of the node-based moves lie."""
        return self.morph.move_control_mesh()[1]

    @cached_property
    def n_full(self) -> int:
        """Distinct nodes of the whole grid."""
        return 1 + max(int(ids.max()) for ids in self.morph.model.topology.node_ids())

    def measure(self, level: float, deadline: float) -> None:
        """Time both movers with both solvers on the meshes of a level; node by node only if time allows, or first."""
        share = level / self.levels[-1]
        n_control = tuple(max(4, 1 + round(share * (n - 1))) for n in self.n_control)
        control = Morph.of(self.case, self.grid, n_control)
        for name, solver in SOLVERS.items():
            self.b_spline[name].add(control.move_control_mesh(solver=solver)[0])
            nodes = self.node_based[name]
            if not nodes.n_points or time.monotonic() + nodes.at(self.n_full * level**3) < deadline:
                nodes.add(self.morph.move_nodes(self.control_points, level, solver=solver))

    def numbers(self) -> dict:
        """What the script tells of the case."""
        return {
            "b_spline": {name: series.numbers() for name, series in self.b_spline.items()},
            "node_based": {name: series.numbers() for name, series in self.node_based.items()},
            "full_grid": {
                "n_points": self.n_full,
                "is_extrapolated": max(series.n_points[-1] for series in self.node_based.values()) < self.n_full,
                "cpu_seconds": {name: series.at(self.n_full) for name, series in self.node_based.items()},
            },
            "ratio": {
                "same_algorithm": self._ratio("conjugate_gradients", "conjugate_gradients"),
                "best_solvers": self._ratio(fastest(self.b_spline), fastest(self.node_based)),
                "paper": self.case.paper_seconds[1] / self.case.paper_seconds[0],
            },
        }

    def _ratio(self, b_spline: str, node_based: str) -> dict:
        """Time of the node-based mover by that of the B-spline one, each with a solver."""
        seconds, nodes = self.b_spline[b_spline].cpu_seconds[-1], self.node_based[node_based]
        return {
            "solvers": [SOLVERS[b_spline].name, SOLVERS[node_based].name],
            "measured": nodes.cpu_seconds[-1] / seconds,
            "measured_at": nodes.n_points[-1],
            "full_grid": nodes.at(self.n_full) / seconds,
            "full_grid_at_least": nodes.at(self.n_full, min(nodes.exponent, SLOWEST_GROWTH)) / seconds,
        }


def main(paper: bool = False, figures=None, minutes: float = 60.0) -> dict:
    """Time both movers on both cases.

    Parameters
    ----------
    paper : bool
        The paper's grids and control meshes.
    figures : path-like, optional
        Folder for ``section4_cpu.png``.
    minutes : float
        A mesh is not tried if it is expected to end later than this.

    Returns
    -------
    dict
        ``onera_m6`` and ``blended_wing_body``. Each has the times of both movers with both solvers, ``b_spline`` and
        ``node_based``: ``n_points``, ``cpu_seconds`` and ``iterations`` of every mesh, and the ``exponent`` of the
        growth; ``full_grid``, what moving all nodes one by one takes, and whether it ``is_extrapolated``; and
        ``ratio``, node-based by B-spline, measured at the largest mesh, for the full grid, and for the full grid if the
        time grew from there on as slowly as it can: with the ``same_algorithm``, with the ``best_solvers`` of each, and
        in the ``paper``.
    """
    deadline = time.monotonic() + 60.0 * minutes
    warm_up(*SOLVERS.values())
    studies = {name: prepare(case, paper) for name, case in CASES.items()}
    for level in LEVELS[paper]:
        for study in studies.values():
            study.measure(level, deadline)
    numbers = {name: study.numbers() for name, study in studies.items()}
    if figures:
        draw(figures, numbers)
    return numbers


def prepare(case: Case, paper: bool) -> Study:
    """Study of a case of which nothing was measured yet."""
    shape, n_control = case.sizes[True] if paper else SMALL
    return Study(case, case.make_grid(shape), n_control, LEVELS[paper])


def fastest(series: dict[str, Series]) -> str:
    """Solver of the shortest time on the largest mesh that any reached."""
    largest = max(one.n_points[-1] for one in series.values())
    reached = {name: one.cpu_seconds[-1] for name, one in series.items() if one.n_points[-1] == largest}
    return min(reached, key=reached.get)


def draw(folder, numbers: dict) -> None:
    """Draw the times against the numbers of points, the full grid as open marks where it is extrapolated."""
    from matplotlib.ticker import NullFormatter

    with figure(folder, "section4_cpu", size=(7.6, 3.6)) as canvas:
        for axes, (name, case) in zip(canvas.subplots(1, 2, sharey=True), numbers.items()):
            for mover, color in (("b_spline", BLUE), ("node_based", ORANGE)):
                for solver, marker in zip(SOLVERS, "os"):
                    n, t = (case[mover][solver][key] for key in ("n_points", "cpu_seconds"))
                    label = f"{LABELS[mover]}, {SOLVERS[solver].name}"
                    axes.loglog(n, t, color=color, marker=marker, markersize=4, label=label)
                    if mover == "node_based" and n[-1] < case["full_grid"]["n_points"]:
                        full = case["full_grid"]["n_points"], case["full_grid"]["cpu_seconds"][solver]
                        look = {"marker": marker, "markersize": 4, "markerfacecolor": "white", "markevery": [1]}
                        axes.loglog([n[-1], full[0]], [t[-1], full[1]], ":", color=color, **look)
            axes.set(title=CASES[name].title, xlabel="points that are moved")
            axes.xaxis.set_minor_formatter(NullFormatter())
        canvas.axes[0].set_ylabel("CPU time of a move (s)")
        canvas.axes[0].legend(loc="upper left", fontsize=8)


if __name__ == "__main__":
    run(main, __doc__.splitlines()[0], minutes=MINUTES)
