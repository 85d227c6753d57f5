"""Improve the worst cells of a grid by moving interior control points; the surface stays fixed.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...base.numerics.stopwatch import working_seconds
from ...errors import InputError
from ..design.interior_points import InteriorPoints
from ..model.fitted_model import FittedModel
from .improvement import Improvement
from .search import Search

__all__ = ["improve_grid"]

SHARPNESS = (10.0, 30.0, 100.0, 300.0)
"""Sharpness of the smooth minimum in the rounds: the last one's error is a few hundredths of the ratio of Q."""

ITERATIONS = 60
"""Maximum number of iterations in a round."""


def improve_grid(
    model: FittedModel,
    *,
    reach: float = 0.4,
    height_tolerance: float = 0.01,
    sliding: str | Sequence[str] = (),
    iterations: int = ITERATIONS,
    progress: Callable[[float, str], None] | None = None,
) -> Improvement:
    """Improve the worst cells of every block of a grid with a fixed surface.

    Neither the worst Q of any block nor the smallest corner of the grid decreases, and no valid cell becomes inverted.
    Nodes of walls, of the far field and of undeclared faces stay to the last bit, nodes of symmetry planes slide in
    them, and first cell heights at walls stay within a tolerance.

    Parameters
    ----------
    model : FittedModel
        The fitted grid. Its residual is preserved.
    reach : float
        How far control points may move, relative to the distance to their nearest neighbours; below 0.5.
    height_tolerance : float
        Allowed relative change of first cell heights at walls.
    sliding : str or sequence of str
        Planar patches whose nodes slide in their planes, in addition to symmetry planes.
    iterations : int
        Maximum number of iterations in each of the four rounds.
    progress : callable, optional
        Called with the fraction done and a description of the current step.

    Returns
    -------
    Improvement
        The result; with the given grid and a reason if nothing could be improved.

    Raises
    ------
    InputError
        If an option is invalid, no control point may move, or the grid has no cells.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> found = improve_grid(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 6, 5)), iterations=10)
    >>> found.after.q_min >= found.before.q_min
    True
    """
    if not 0.0 < height_tolerance < 1.0:
        raise InputError(f"improve: height_tolerance is {height_tolerance}; give a number between 0 and 1")
    if iterations < 1:
        raise InputError(f"improve: iterations is {iterations}; give 1 or more")
    started = working_seconds()
    search = Search(model, InteriorPoints("interior", reach=reach, sliding=sliding).bind(model), height_tolerance)
    for number, sharpness in enumerate(SHARPNESS):
        if progress is not None:
            progress(number / len(SHARPNESS), f"round {number + 1} of {len(SHARPNESS)}")
        search.run_round(sharpness, iterations)
    return search.result(working_seconds() - started)
