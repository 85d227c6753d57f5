"""A move in increments, Eq. (8), with its exact derivative through all of them. Theory: ``docs/theory/elasticity.rst``.

The surface goes from b_srf^(0) to b_srf^(m) along straight lines, in m equal increments. Each moves the mesh from
b^(i-1) to b^(i), with a stiffness that depends on b^(i-1) and b^(0). So does its derivative: forward products go
through the increments in order, transposed ones in reverse order. What one increment does depends on the mover; for
elastic elements it is in `bspline_mdao.core.movement.equilibrium_mover`.

Another number of increments is another function of the surface: it is a setting of the mover, and no move chooses it.
`increments_for` finds a sufficient number before a run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np

from ...base.checks import as_array
from ...base.display import OneLine
from ...base.numerics.progress import progress_bar
from ...base.numerics.stopwatch import working_seconds
from ...errors import InputError, MovementError
from ..mesh.moving_mesh import MovingMesh
from ..mesh.sliding_points import SlidPoints
from .mover import IncrementReport, MovementReport, Mover, Step, check_reach, check_request, met_alike

__all__ = ["PAPER_INCREMENTS", "IncrementalMovement", "IncrementalMover", "in_increments", "increments_for"]

PAPER_INCREMENTS = 5
"""The paper's m, section IV."""

NUMBERS = (1, 2, 5, 10)
"""Numbers of increments to choose from."""

GOOD_RATIO = 0.03
"""A mesh is good while no element's smallest corner triple product is below this fraction of the baseline's."""


@dataclass(frozen=True, eq=False)
class IncrementalMovement(OneLine):
    """A completed move in increments."""

    mesh: MovingMesh  # what was moved
    steps: tuple[Step, ...]  # the increments
    report: MovementReport  # report on them
    # data that moves from the same initial points share, to be passed to the mover's next ``move`` as its ``start``;
    # None if there is nothing
    start: object = None
    slid: SlidPoints | None = None  # positions of points after sliding; None if none slide

    @property
    def surface_ids(self) -> np.ndarray:
        """Points on the surface, shape (n_surface,)."""
        return self.mesh.surface_ids

    @property
    def points(self) -> np.ndarray:
        """Points after the last increment, shape (n_points, 3), in metres."""
        return self.steps[-1].points if self.slid is None else self.slid.points

    def jvp(
        self,
        d_initial: np.ndarray,  # (n_points, 3), change of the initial points
        d_surface: np.ndarray,  # (n_surface, 3), change of the surface points after the move
    ) -> np.ndarray:
        """Change of the points, shape (n_points, 3)."""
        d_points, m = d_initial, len(self.steps)
        d_at_rest = d_initial[self.surface_ids]
        d_surface = d_at_rest + self.mesh.alike(d_surface - d_at_rest)
        for i, step in enumerate(self.steps, start=1):
            d_points = step.jvp(d_initial, d_points, _between(d_at_rest, d_surface, i, m))
        return d_points if self.slid is None else self.slid.jvp(d_initial, d_points)

    def vjp(
        self,
        bar: np.ndarray,  # (n_points, 3), derivative of a scalar with respect to the points
    ) -> tuple[np.ndarray, np.ndarray]:  # initial_bar: (n_points, 3); surface_bar: (n_surface, 3)
        """Transpose of `jvp`."""
        m = len(self.steps)
        initial_bar, surface_bar = np.zeros_like(bar), np.zeros((len(self.surface_ids), 3), dtype=bar.dtype)
        if self.slid is not None:
            initial_bar, bar = self.slid.vjp(bar)
        for i, step in zip(range(m, 0, -1), reversed(self.steps)):
            reference_bar, bar, target_bar = step.vjp(bar)
            initial_bar += reference_bar
            initial_bar[self.surface_ids] += (1.0 - i / m) * target_bar
            surface_bar += (i / m) * target_bar
        alike_bar = self.mesh.alike(surface_bar)
        initial_bar[self.surface_ids] += surface_bar - alike_bar
        return initial_bar + bar, alike_bar


def in_increments(
    mesh: MovingMesh,  # what is moved
    # ``step(initial, before, surface)`` makes one increment: from the initial points of the whole move, shape
    # (n_points, 3), the points before the increment, and the surface points after it, shape (n_surface, 3)
    step: Callable[[np.ndarray, np.ndarray, np.ndarray], Step],
    initial: np.ndarray,  # (n_points, 3), points before the move (m)
    surface: np.ndarray,  # (n_surface, 3), surface points after it (m)
    n_increments: int,  # the paper's m
) -> IncrementalMovement:
    """Move the surface in equal increments along straight lines, and the mesh with it, i = 1 to m of Eq. (8).

    Parameters
    ----------
    mesh : MovingMesh
        Mesh to move.
    step : callable
        ``step(initial, before, surface)`` makes one increment: from the initial points of the whole move, shape
        (n_points, 3), the points before the increment, and the surface points after it, shape (n_surface, 3).
    initial : ndarray, shape (n_points, 3)
        Points before the move (m).
    surface : ndarray, shape (n_surface, 3)
        Surface points after it (m).
    n_increments : int
        The paper's m.

    Raises
    ------
    InputError
        If a shape or the number of increments is wrong.
    MovementError
        If the move cannot be done, or moves a point much farther than the surface.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import in_increments, interpolated_step, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> class Still:  # of which all inner points stay where they are
    ...     values = np.zeros_like(mesh.points)
    >>> def step(initial, before, surface):
    ...     return interpolated_step(mesh, before, surface, Still())
    >>> moved = in_increments(mesh, step, mesh.points, 1.01 * mesh.points[mesh.surface_ids], 2).points
    >>> bool(np.isclose(moved[mesh.surface_ids], 1.01 * mesh.points[mesh.surface_ids]).all())
    True
    """
    require_number(n_increments)
    initial, surface = as_array(initial, "movement: points"), as_array(surface, "movement: surface points")
    check_request(mesh, initial, surface)
    began, steps, reports = working_seconds(), [], []
    before, surface_before, slid = initial, initial[mesh.surface_ids], None
    surface = met_alike(mesh, surface_before, surface)
    with progress_bar("moving the control mesh") as report_progress:
        for i in range(1, n_increments + 1):
            report_progress((i - 1) / n_increments, f"increment {i} of {n_increments}")
            try:
                steps.append(step(initial, before, _between(surface_before, surface, i, n_increments)))
            except MovementError as error:
                raise MovementError(f"increment {i} of {n_increments}: {error}") from error
            before = steps[-1].points
            check_reach(mesh, initial, surface, before)
            if i == n_increments:
                slid = mesh.slid(initial, before)
                before = before if slid is None else slid.points
            tangling = mesh.tangled(before)
            reports.append(IncrementReport(solve=steps[-1].report, **vars(tangling)))
    report = MovementReport(tuple(reports), working_seconds() - began, n_invalid=mesh.n_invalid)
    return IncrementalMovement(mesh, tuple(steps), report, slid=slid)


def require_number(n_increments: int) -> None:
    """Refuse invalid numbers of increments."""
    is_number = isinstance(n_increments, Integral) and not isinstance(n_increments, bool) and n_increments >= 1
    if not is_number:
        raise InputError(f"movement: {n_increments!r} increments; give a whole number from 1")


def increments_for(mover: Mover, designs: Iterable[np.ndarray]) -> int:
    """Find a sufficient number of increments for given designs, to set in the mover before a run.

    It is the smallest of 1, 2, 5 and 10 with which the control mesh stays good in all of them: every element that is
    valid on the baseline keeps 3 % of its smallest corner triple product. Ten is not tried if five is no better than
    two.

    Parameters
    ----------
    mover : Mover
        One of `bspline_mdao.core.movement`, or another dataclass with ``n_increments``, whose own number does not
        matter.
    designs : iterable of ndarray, each of shape (n_surface, 3)
        Surface control points (m) of the most extreme designs, such as `Parametrization.extremes`.

    Returns
    -------
    int
        If no number keeps the mesh good, the tried number that is best in the worst design; the largest if the mover
        fails with all.

    Raises
    ------
    InputError
        If a shape is wrong, or the mover has no number of increments.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, increments_for, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mover = LinearElasticity(mesh)
    >>> thick, thin = (mesh.points[mesh.surface_ids] * [1.0, factor, 1.0] for factor in (1.2, 0.8))
    >>> mover = replace(mover, n_increments=increments_for(mover, [thick, thin]))
    >>> mover.n_increments
    1
    """
    settings: Any = mover
    if not hasattr(mover, "n_increments"):
        raise InputError(f"movement: {type(mover).__name__} has no number of increments to choose")
    designs, ratios = list(designs), {}
    for number in NUMBERS:
        ratios[number] = _worst_ratio(replace(settings, n_increments=number), designs)
        if ratios[number] >= GOOD_RATIO:
            return number
        # One says nothing about the others: three of 99 moves keep less with two than with one, and are good with five
        # or ten. None of the moves that keep no more with five than with two is good with ten.
        _, *several = ratios.values()
        if len(several) > 1 and -np.inf < several[-1] <= several[-2]:
            break
    return max(reversed(ratios), key=ratios.__getitem__)


def _worst_ratio(mover: Mover, designs: list[np.ndarray]) -> float:
    """Smallest ratio of a corner to its baseline value in any design; minus infinity if the mover fails."""
    options: dict[str, Any] = {}
    worst = np.inf
    for surface in designs:
        try:
            movement = mover.move(mover.mesh.points, surface, **options)
        except MovementError:
            return -np.inf
        worst = min(worst, movement.report.increments[-1].corner_ratio)
        start = getattr(movement, "start", None)
        options = {} if start is None else {"start": start}  # the factor of the baseline serves all designs
    return worst


def _between(start: np.ndarray, stop: np.ndarray, i: int, m: int) -> np.ndarray:
    """Surface after increment i of m, b_srf^(i): the last ends exactly on ``stop``; at rest it stays at ``start``."""
    return stop if i == m else start + (i / m) * (stop - start)


class IncrementalMover(OneLine):
    """Base of movers that do the same in every increment."""

    # A leaf has the fields ``mesh`` and ``n_increments``, and defines one increment.

    mesh: MovingMesh
    n_increments: int

    def __post_init__(self) -> None:
        require_number(self.n_increments)

    def move(self, initial: np.ndarray, surface: np.ndarray) -> IncrementalMovement:
        """Move points (n_points, 3) with surface points (n_surface, 3), both in metres."""
        initial = np.array(initial, dtype=float)
        return in_increments(self.mesh, self._step, initial, surface, self.n_increments)

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> Step:
        """Make one increment, see `in_increments`."""
        raise NotImplementedError
