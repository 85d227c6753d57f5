"""A move in increments, Eq. (8), with its exact derivative through all of them. Theory: ``docs/theory/elasticity.rst``.

The surface goes from b_srf^(0) to b_srf^(m) along straight lines, in m equal increments; each moves the mesh from
b^(i-1) to b^(i), with a stiffness that depends on b^(i-1) and b^(0). So does its derivative: forward products go
through the increments in their order, transposed ones in the reverse order. What one increment does is the mover's;
for elastic elements it is `bspline_mdao.movement.equilibrium`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from ..checks import as_array
from ..errors import InputError, MovementError
from ..mesh.moving_mesh import MovingMesh
from ..numerics.progress import shown
from ..shown import OneLine
from .mover import IncrementReport, MovementReport, Step, Trial, check_reach, check_request

__all__ = ["AUTO", "GOOD_RATIO", "NUMBERS", "IncrementalMovement", "IncrementalMover", "in_increments"]

"""Logs every increment that is done, with the arguments ``(increment, n_increments)``."""

AUTO = "auto"
"""Number of increments of a move that chooses it by what it needs."""

NUMBERS = (1, 2, 5, 10)
"""Numbers of increments that such a move tries in turn."""

GOOD_RATIO = 0.03
"""A mesh stays good while no element's smallest corner triple product falls below this fraction of the baseline's."""


@dataclass(frozen=True, eq=False)
class IncrementalMovement(OneLine):
    """A move that was made in increments.

    Parameters
    ----------
    surface_ids : ndarray of int, shape (n_surface,)
        Points on the surface.
    steps : tuple of Step
        The increments.
    report : MovementReport
        What they did.
    start : object, optional
        What moves from the same initial points can share, to be handed to the mover's next ``move`` as its ``start``;
        None where there is nothing.
    """

    surface_ids: np.ndarray
    steps: tuple[Step, ...]
    report: MovementReport
    start: object = None

    @property
    def points(self) -> np.ndarray:
        """Points after the last increment, shape (n_points, 3), in metres."""
        return self.steps[-1].points

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points, shape (n_points, 3).

        Parameters
        ----------
        d_initial : ndarray, shape (n_points, 3)
            Change of the initial points.
        d_surface : ndarray, shape (n_surface, 3)
            Change of the surface points after the move.
        """
        d_points, m = d_initial, len(self.steps)
        for i, step in enumerate(self.steps, start=1):
            d_points = step.jvp(d_initial, d_points, _between(d_initial[self.surface_ids], d_surface, i, m))
        return d_points

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`.

        Parameters
        ----------
        bar : ndarray, shape (n_points, 3)
            Derivative of a scalar with respect to the points.

        Returns
        -------
        initial_bar : ndarray, shape (n_points, 3)
        surface_bar : ndarray, shape (n_surface, 3)
        """
        m = len(self.steps)
        initial_bar, surface_bar = np.zeros_like(bar), np.zeros((len(self.surface_ids), 3), dtype=bar.dtype)
        for i, step in zip(range(m, 0, -1), reversed(self.steps)):
            reference_bar, bar, target_bar = step.vjp(bar)
            initial_bar += reference_bar
            initial_bar[self.surface_ids] += (1.0 - i / m) * target_bar
            surface_bar += (i / m) * target_bar
        return initial_bar + bar, surface_bar


def in_increments(
    mesh: MovingMesh,
    step: Callable[[np.ndarray, np.ndarray, np.ndarray], Step],
    initial: np.ndarray,
    surface: np.ndarray,
    n_increments: int | str,
    numbers: Sequence[int] = NUMBERS,
) -> IncrementalMovement:
    """Move the surface in equal increments along straight lines, and the mesh behind it.

    Parameters
    ----------
    mesh : MovingMesh
        What is moved.
    step : callable
        ``step(initial, before, surface)`` makes one increment: from the initial points of the whole move, shape
        (n_points, 3), the points before the increment, and the surface points after it, shape (n_surface, 3).
    initial : ndarray, shape (n_points, 3)
        Points before the move (m).
    surface : ndarray, shape (n_surface, 3)
        Surface points after it (m).
    n_increments : int or "auto"
        The paper's m. "auto" takes the first of ``numbers`` with which the mesh stays good: every element that is valid
        on the baseline keeps `GOOD_RATIO` of its smallest corner triple product. Where none does, the number counts
        that keeps most. Which it is depends on ``initial``, ``surface`` and ``numbers`` alone.
    numbers : sequence of int
        What "auto" tries, ascending.

    Raises
    ------
    InputError
        If a shape or the number of increments is wrong.
    MovementError
        If the move cannot be done, or moves a point far beyond what the surface does, with any of the numbers.
    """
    require_number(n_increments)
    initial, surface = as_array(initial, "movement: points"), as_array(surface, "movement: surface points")
    check_request(mesh, initial, surface)
    if n_increments != AUTO:
        return _follow(mesh, step, initial, surface, n_increments)
    began, movement, tried = time.perf_counter(), None, []
    for number in numbers:
        movement = None  # the factors of the last one make room for those of the next
        try:
            movement = _follow(mesh, step, initial, surface, number)
            tried.append(Trial(number, movement.report.increments[-1].corner_ratio))
        except MovementError as error:
            tried.append(Trial(number, -np.inf, str(error)))
        if tried[-1].corner_ratio >= GOOD_RATIO:
            break
    best = max(reversed(tried), key=lambda trial: trial.corner_ratio)
    if movement is None or best is not tried[-1]:
        movement = None
        movement = _follow(mesh, step, initial, surface, best.n_increments)
    report = replace(movement.report, seconds=time.perf_counter() - began, tried=tuple(tried))
    return replace(movement, report=report)


def require_number(n_increments: int | str) -> None:
    """Refuse what is no number of increments."""
    is_number = isinstance(n_increments, Integral) and not isinstance(n_increments, bool) and n_increments >= 1
    if not is_number and n_increments != AUTO:
        raise InputError(f"movement: {n_increments} increments; give a whole number from 1, or '{AUTO}'")


def _follow(mesh, step, initial, surface, n_increments) -> IncrementalMovement:
    """Move the mesh behind its surface in a number of equal increments, i = 1 to m of Eq. (8)."""
    began, steps, reports = time.perf_counter(), [], []
    before, surface_before = initial, initial[mesh.surface_ids]
    with shown("moving the control mesh") as tell:
        for i in range(1, n_increments + 1):
            tell((i - 1) / n_increments, f"increment {i} of {n_increments}")
            try:
                steps.append(step(initial, before, _between(surface_before, surface, i, n_increments)))
            except MovementError as error:
                raise MovementError(f"increment {i} of {n_increments}: {error}") from error
            before = steps[-1].points
            check_reach(mesh, initial, surface, before)
            tangling = mesh.tangled(before)
            reports.append(IncrementReport(solve=steps[-1].report, **vars(tangling)))
    report = MovementReport(tuple(reports), time.perf_counter() - began, n_invalid=mesh.n_invalid)
    return IncrementalMovement(mesh.surface_ids, tuple(steps), report)


def _between(start: np.ndarray, stop: np.ndarray, i: int, m: int) -> np.ndarray:
    """Surface after increment i of m, b_srf^(i): the last ends exactly on ``stop``; one at rest stays at ``start``."""
    return stop if i == m else start + (i / m) * (stop - start)


class IncrementalMover(OneLine):
    """What movers share that do the same in every increment.

    A leaf has the fields ``mesh`` and ``n_increments``, a number or "auto", and says what one increment does.
    """

    mesh: MovingMesh
    n_increments: int | str

    def __post_init__(self):
        require_number(self.n_increments)

    def move(self, initial: np.ndarray, surface: np.ndarray, numbers: Sequence[int] = NUMBERS) -> IncrementalMovement:
        """Move points (n_points, 3) behind surface points (n_surface, 3), both in metres.

        With ``n_increments="auto"`` the move tries ``numbers`` of increments in turn, see `in_increments`.

        Raises
        ------
        InputError
            If a shape or the number of increments is wrong.
        MovementError
            If a coordinate is not finite, a surface point leaves its symmetry plane, a system cannot be solved, or a
            point is moved far beyond what the surface does.
        """
        initial = np.array(initial, dtype=float)
        return in_increments(self.mesh, self._step, initial, surface, self.n_increments, numbers)

    def _step(self, initial: np.ndarray, before: np.ndarray, surface: np.ndarray) -> Step:
        """Make one increment, see `in_increments`."""
        raise NotImplementedError
