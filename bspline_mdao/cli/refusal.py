"""Why a move is refused, and what cures it.

The causes are looked for in this order: a control mesh that is folded before anything moves; what the splines miss of
the grid, where the splines' own grid stays valid; a control mesh that tangles; splines that fold over a valid one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..cells.grid_quality import GridQuality
from ..model.fitted_model import FittedModel
from ..movement.increments import AUTO
from ..movement.mover import MEND, MovementReport
from .movers import MoverOptions

if TYPE_CHECKING:
    from .move import Moved


def complaint(model: FittedModel, moved: Moved, options: MoverOptions) -> str:
    """Say which cells are inverted, why, and what cures it.

    Parameters
    ----------
    model : FittedModel
        What was moved.
    moved : Moved
        The move, which leaves cells inverted.
    options : MoverOptions
        How it was made.

    Returns
    -------
    str
    """
    cause, cure = _cause_and_cure(model, moved, options)
    n = moved.after.n_inverted
    return (
        f"the move leaves {n:,} cell{'s' * (n > 1)} inverted, the worst {moved.newly_inverted[0]}; {cause}; "
        f"nothing was written; {cure}, or --allow-invalid to see it"
    )


def _cause_and_cure(model: FittedModel, moved: Moved, options: MoverOptions) -> tuple[str, str]:
    mesh, report = moved.mesh, moved.movement.report
    if mesh.n_invalid:
        n = f"{mesh.n_invalid:,} of {len(mesh.elements):,}"
        return f"{n} elements of the control mesh are invalid before the move", MEND
    missed = None if model.residual is None else np.linalg.norm(model.residual, axis=1).max()
    if missed and _is_the_residual(model, moved):
        cause = f"the splines' own grid is valid there, what they miss of the grid, up to {missed:.2g} m, is in the way"
        more = [f"take {option}" for option in _more(report)]
        return cause, " or ".join(["fit with more control points (--n-control)", *more, "deform it less"])
    first = report.first_tangled()
    if not first:
        return "the splines fold between control points, whose mesh stays valid", "take a smaller deformation"
    number, increment = first
    cause = f"the control mesh tangles in increment {number} of {report.n_increments}, {increment.place}"
    held = [what for what, _ in mesh.obstacles if what not in cause]
    if held:
        cause += f"; {held[0]} is fixed where the surface ends on it: --slide or --release it if the cells are there"
    return cause, _cure_of_tangling(report, options)


def _cure_of_tangling(report: MovementReport, options: MoverOptions) -> str:
    """Say what to do about a control mesh that tangles, what is most likely to help first."""
    if options.mover != "elasticity":
        return "take --mover elasticity or a smaller deformation"
    if options.increments not in (None, AUTO):
        return "take --increments auto, a smaller deformation or --mover torsional"
    tried = ", ".join(str(trial.n_increments) for trial in report.tried)
    smaller = f"a smaller deformation (tried with {tried} increments)"
    return "take " + " or ".join([*_more(report), smaller, "--mover torsional"])


def _more(report: MovementReport) -> list[str]:
    """The most increments that were tried, where elements tangle with each number and fewer were taken.

    They tangle fewer elements as a rule, though the worst of them may be worse.
    """
    most = report.tried[-1].n_increments if report.tried else 0
    return [f"--increments {most}"] if report.first_tangled() and most > report.n_increments else []


def _is_the_residual(model: FittedModel, moved: Moved) -> bool:
    """Whether most cells that are inverted now, and were not, are valid in the grid of the splines alone."""
    quality = GridQuality.of_baseline(model.regenerate())
    after = quality.cells(moved.grid.to_vector().reshape(-1, 3))
    own = quality.cells(model.evaluator().forward(moved.movement.points))
    n_inverted = n_valid = 0
    for block, cells, own_cells in zip(quality.blocks, after, own):
        inverted = np.setdiff1d(np.flatnonzero(~cells.is_valid), block.was_invalid, assume_unique=True)
        n_inverted += inverted.size
        n_valid += np.count_nonzero(own_cells.is_valid.ravel()[inverted])
    return 2 * n_valid > n_inverted
