"""Protocols and reports of all movers, and the checks that every move passes. Theory: ``docs/theory/movers.rst``.

A mover moves the points of a `MovingMesh` with its surface, in one or more increments. The interface has three methods:
``move`` gives a movement, whose ``jvp`` and ``vjp`` are the products with its exact derivative and with the transpose.
A user's own mover is any object with a ``mesh`` and a ``move``. It can use
`bspline_mdao.core.movement.increments.in_increments` to repeat what it does in one increment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ...base.display import OneLine
from ...base.text import counted
from ...errors import InputError, MovementError
from ..mesh.moving_mesh import MovingMesh

__all__ = [
    "IncrementReport",
    "Movement",
    "MovementReport",
    "Mover",
    "SolveReport",
    "Step",
    "check_reach",
    "check_request",
    "differentiable",
    "digits_of",
    "met_alike",
]

PLANE_TOLERANCE = 1e-5
"""A surface point may leave its symmetry plane by this fraction of the mesh's size: single precision."""

MAX_AMPLIFICATION = 100.0
"""Most that a point may be moved, in units of the largest displacement of the surface.

A field with a maximum principle amplifies nothing. Rotations in straight increments, elasticity and radial functions
overshoot nevertheless: elasticity by up to 8, compact radial functions by up to 31 in the cases of
``run_scripts/robustness_table.py``. Elasticity on meshes that are folded or wrongly connected moves points by 100 to
1000 times the displacement of the surface.
"""

MEND = 'fit the grid with method="valid" (fit --method valid)'
"""Advice for control meshes that are invalid before they move."""

ROUND_OFF = 1e-9
"""Displacements below this fraction of the mesh's size are not judged."""


@dataclass(frozen=True)
class SolveReport:
    """Report on the linear system of one increment."""

    solver: str  # name of the solver
    iterations: int  # 0 for a direct solver, or its number of corrections
    residual: float  # 2-norm of the residual relative to the right-hand side's
    seconds: float  # wall clock of factor and solution
    digits: float  # estimate of the correct decimal digits of the displacement relative to the largest, from 0 to 16


@dataclass(frozen=True)
class IncrementReport:
    """Report on one increment."""

    solve: SolveReport | None  # None for a mover that solves nothing
    n_tangled: int  # elements that are valid on the baseline but no longer
    place: str  # the worst of them, ``"element (i, j, k) of block 3"``, counted from 1; empty if there is none
    min_corner: float  # smallest corner triple product of the elements that are valid on the baseline
    # smallest ratio of an element's smallest corner triple product to its value on the baseline, of the same elements
    corner_ratio: float
    # invalid elements, whatever they are on the baseline, counted as in the report of a fit
    n_invalid: int


@dataclass(frozen=True)
class MovementReport(OneLine):
    """Report on a movement, increment by increment."""

    increments: tuple[IncrementReport, ...]  # in order
    seconds: float  # wall clock of the whole move
    n_invalid: int = 0  # elements that are invalid on the baseline, before anything moves
    where: str = ""  # which of several processes moved, and why; empty for one process

    def __str__(self) -> str:
        what = counted(self.n_increments, "increment")
        solve = self.increments[-1].solve if self.increments else None
        how = f" by {solve.solver}, {self.digits:.0f} digits" if solve else ""
        return f"{what}{how}, {self.seconds:.2f} s{f', {self.where}' if self.where else ''}"

    @property
    def n_increments(self) -> int:
        """Number of increments that the move was made in."""
        return len(self.increments)

    @property
    def digits(self) -> float:
        """Estimate of the correct decimal digits of the worst increment; 16 for a mover that solves nothing."""
        return min((increment.solve.digits for increment in self.increments if increment.solve), default=16.0)

    def first_tangled(self) -> tuple[int, IncrementReport] | None:
        """Number, from 1, and report of the first increment that tangles; None if none does."""
        tangled = ((n, report) for n, report in enumerate(self.increments, start=1) if report.n_tangled)
        return next(tangled, None)

    @property
    def tangling(self) -> str:
        """What tangles; empty if the mesh is not tangled at the end."""
        # It names the increment in which tangling began, the worst element there, and elements that were invalid
        # before.
        tangled = self.first_tangled()
        if tangled is None or not self.increments[-1].n_tangled:
            return ""
        (number, first), cause = tangled, ""
        if self.n_invalid:
            others = f"{self.n_invalid:,} {'other is' if self.n_invalid == 1 else 'others are'}"
            cause = f"; {others} invalid before the move"
        return (
            f"increment {number} of {self.n_increments} inverts {first.place} (corner triple product "
            f"{first.min_corner:.2g}); {counted(self.increments[-1].n_tangled, 'element')} newly "
            f"invalid at the end{cause}"
        )


class Movement(Protocol):
    """A completed move, with its exact derivative."""

    @property
    def points(self) -> np.ndarray:
        """Moved points, shape (n_points, 3), in metres."""

    @property
    def report(self) -> MovementReport:
        """Report of the move, increment by increment."""

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points for changes of the initial points and the surface points, each with its shape."""

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`: derivatives with respect to the initial points and the surface points."""


class Mover(Protocol):
    """Moves the points of a mesh with its surface."""

    # If a mover's movements have a ``start`` that is not None, its ``move`` also takes the start of an earlier
    # movement, which saves work that moves from the same initial points share. The mover stores nothing of a move
    # itself, so components and threads may share it.

    @property
    def mesh(self) -> MovingMesh:
        """Mesh that is moved."""

    def move(self, initial: np.ndarray, surface: np.ndarray) -> Movement:
        """Move points (n_points, 3) with surface points (n_surface, 3), both in metres."""
        # Surface points end exactly on ``surface``, fixed ones stay, and sliding ones stay in their planes.


def digits_of(error: float) -> float:
    """Correct decimal digits, from 0 to 16, of a number with a relative error."""
    return float(np.clip(-np.log10(max(error, 1e-16)), 0.0, 16.0))


def differentiable(mover: Mover) -> Mover:
    """Mover whose movements keep their factors for derivatives, unless its own ``keep_factors`` is set."""
    settings: Any = mover
    return replace(settings, keep_factors=True) if getattr(mover, "keep_factors", False) is None else mover


class Step(Protocol):
    """One completed increment, with its exact derivative."""

    # It depends on the initial points (reference stiffness), on the points before the increment, and on the surface
    # points after it.

    @property
    def points(self) -> np.ndarray:
        """Points after the increment, shape (n_points, 3), in metres."""

    @property
    def report(self) -> SolveReport | None:
        """Report on the system of the increment; None if there was none."""

    def jvp(self, d_initial: np.ndarray, d_before: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points after the increment, shape (n_points, 3)."""

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""


def check_request(
    mesh: MovingMesh,  # what is moved
    initial: np.ndarray,  # (n_points, 3), points before the move (m)
    surface: np.ndarray,  # (n_surface, 3), surface points after it (m)
) -> None:
    """Refuse requests that no mover can follow."""
    for name, array, n in (("points", initial, mesh.n_points), ("surface points", surface, len(mesh.surface_ids))):
        if array.shape != (n, 3):
            raise InputError(f"movement: {name} of shape {array.shape}; give shape ({n}, 3)")
        is_bad = ~np.isfinite(array).all(axis=1)
        if is_bad.any():
            raise MovementError(f"movement: {name[:-1]} {np.argmax(is_bad) + 1} is not finite; take a smaller step")
    rows = mesh.in_plane_rows
    off = np.abs(((surface - initial[mesh.surface_ids])[rows] * mesh.in_plane_normals).sum(axis=1))
    if len(rows) and off.max() > PLANE_TOLERANCE * mesh.size:
        worst = np.argmax(off)
        raise MovementError(
            f"movement: {mesh.place_of_surface_point(rows[worst])} leaves its symmetry plane by "
            f"{off[worst]:.3g} m; keep surface points on symmetry planes in them"
        )


def met_alike(mesh: MovingMesh, at_rest: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """Places of the surface, shape (n_surface, 3), averaged over both periodic sides where it ends on them."""
    return surface if mesh.surface_ties is None else at_rest + mesh.alike(surface - at_rest)


def check_reach(
    mesh: MovingMesh,  # what is moved
    initial: np.ndarray,  # initial, points: (n_points, 3), points before and after the move (m)
    surface: np.ndarray,  # (n_surface, 3), surface points after it (m)
    points: np.ndarray,
) -> None:
    """Refuse a move that takes a point much farther than the surface, see `MAX_AMPLIFICATION`."""
    asked = np.linalg.norm(surface - initial[mesh.surface_ids], axis=1).max(initial=0.0)
    reach = np.linalg.norm(points - initial, axis=1)
    worst = int(np.argmax(np.where(np.isnan(reach), np.inf, reach)))
    if reach[worst] <= MAX_AMPLIFICATION * asked + ROUND_OFF * mesh.size:
        return
    if mesh.n_invalid:
        cause = (
            f"{mesh.n_invalid:,} of {len(mesh.elements):,} elements invalid before the move; {MEND} if it was "
            f"fitted otherwise, or with fewer control points (n_control, --n-control)"
        )
    else:
        cause = "see by 'bspline-mdao inspect' whether all blocks are joined; if they are, take another mover"
    raise MovementError(
        f"movement: {mesh.place_of_point(worst)} would be moved {reach[worst]:.3g} m away by a surface that moves by "
        f"{asked:.3g} m at most; {cause}"
    )
