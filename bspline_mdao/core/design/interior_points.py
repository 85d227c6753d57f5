"""Interior control points as variables: they move the grid and keep the surface fixed, section II.E.

A value is a displacement along one of the three control mesh lines through the point, in units of the distance to the
nearest neighbour on that line. So values mean the same for cells of any size and aspect ratio, and a bound limits how
far a point may move. Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ...base.checks import require_kind
from ...base.display import OneLine
from ...errors import InputError
from ...grids.topology.topology import describe
from ..mesh.interior import fixed_periodic_planes, interior_directions
from ..model.fitted_model import FittedModel
from .variable import block_diagonal

__all__ = ["InteriorPoints", "InteriorShift"]

SHORT = 1e-9
"""A line of the control mesh gives no direction if neighbours on it are nearer than this fraction of the mesh's
size."""


@dataclass(frozen=True, eq=False)
class InteriorShift(OneLine):
    """Displacements of control points that are linear in values. Made by `InteriorPoints.bind`."""

    point_ids: np.ndarray  # int (n_values,), number of the control point that each value moves, ascending
    directions: np.ndarray  # (n_values, 3), its displacement for the value 1 (m)
    n_points: int  # number of control points
    reach: float  # largest absolute value

    @property
    def n_values(self) -> int:
        """Number of values."""
        return len(self.point_ids)

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves, shape (n_values,)."""
        return np.zeros(self.n_values)

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds of the values, shape (n_values,)."""
        return np.full(self.n_values, -self.reach)

    @property
    def upper(self) -> np.ndarray:
        """Upper bounds of the values, shape (n_values,)."""
        return np.full(self.n_values, self.reach)

    @cached_property
    def matrix(self) -> csr_array:
        """Map from values to displacements of all control points, xyz interleaved: shape (3 n_points, n_values)."""
        rows = block_diagonal(self.directions[:, :, None])
        sums = csr_array(
            (np.ones(3 * self.n_values), (_interleaved(self.point_ids), np.arange(3 * self.n_values))),
            shape=(3 * self.n_points, 3 * self.n_values),
        )
        return csr_array(sums @ rows)

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move control points, shape (n_points, 3), in metres; real or complex."""
        return points + self.displacement(values)

    def displacement(self, values: np.ndarray) -> np.ndarray:
        """Displacements of the control points (m), shape (n_points, 3)."""
        return (self.matrix @ values).reshape(-1, 3)

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `displacement`: (n_points, 3) to (n_values,)."""
        return self.matrix.T @ bar.ravel()


@dataclass(frozen=True, eq=False)
class InteriorPoints(OneLine):
    """Move control points inside the grid while the surface stays fixed.

    Points of walls, of the far field and of undeclared faces are fixed, and so are edges where patches meet. Points on
    symmetry planes slide in them; points on interfaces move in all their blocks. Every point has a value for each of
    its free directions, three inside: along the lines of the control mesh, in units of the distance to the nearest
    neighbour on the line. So values are dimensionless, and zero where nothing moves.

    Parameters
    ----------
    name : str
        Name of the variable.
    where : ndarray of bool, shape (n_control_points,), or of int, optional
        Which control points; all movable ones by default.
    reach : float
        How far they may move: largest absolute value, below 0.5 so that neighbours do not meet.
    sliding : str or sequence of str
        Planar patches whose points slide in their planes, in addition to symmetry planes.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> model = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 6, 5))
    >>> shift = InteriorPoints("inner", reach=0.3).bind(model)
    >>> bool((shift.displacement(shift.upper)[shift.point_ids] != 0.0).any(axis=1).all())
    True
    """

    name: str
    where: Any = None
    reach: float = 0.4
    sliding: str | Sequence[str] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.reach < 0.5:
            raise InputError(f"'{self.name}': reach is {self.reach}; give a number between 0 and 0.5")

    def bind(self, model: FittedModel) -> InteriorShift:
        """Find the points of a model that move, and their directions.

        Parameters
        ----------
        model : FittedModel
            The fitted grid, whose control mesh gives the directions.

        Returns
        -------
        InteriorShift

        Raises
        ------
        InputError
            If no point is left to move, ``where`` does not match the control mesh, or a patch cannot slide.
        """
        require_kind(model, FittedModel, f"the model of '{self.name}'", "make it with fit_grid(grid)")
        projectors, lines = interior_directions(model, self.sliding), control_lines(model)
        directions = np.einsum("nij,ndj->ndi", projectors, lines)
        kept = _independent(
            projectors, lines, directions, SHORT * float(np.linalg.norm(np.ptp(model.control_points, axis=0)))
        )
        n_movable = np.count_nonzero(kept.any(axis=1))
        kept &= self._is_asked(len(kept))[:, None]
        if not kept.any():
            of = f"none of the {n_movable:,} that may move is asked for" if n_movable else "all of them are fixed"
            raise InputError(
                f"{model.header.source}: '{self.name}' has no control point to move: {of}; inside a block they are "
                f"free, on a boundary they are only where its patch is of kind 'symmetry' or slides"
                f"{'' if n_movable else _what_may_slide(model, self.sliding)}"
            )
        ids, numbers = np.nonzero(kept)
        return InteriorShift(ids, directions[ids, numbers], len(kept), self.reach)

    def _is_asked(self, n_points: int) -> np.ndarray:
        """Whether ``where`` chooses each control point."""
        if self.where is None:
            return np.ones(n_points, dtype=bool)
        where, is_asked = np.asarray(self.where), np.zeros(n_points, dtype=bool)
        try:
            is_asked[where] = True
        except IndexError as error:
            raise InputError(f"'{self.name}': where: {error}; the model has {n_points:,} control points") from None
        return is_asked


def _what_may_slide(model: FittedModel, sliding: str | Sequence[str]) -> str:
    """Name the periodic planes of a model, and say how to let them slide."""
    patch_of = {face.window: face.patch for face in model.topology.boundary}
    texts = []
    for pair in fixed_periodic_planes(model, sliding):
        windows = (*pair.windows, *pair.others)
        names = sorted({patch for window in windows if (patch := patch_of[window]) is not None})
        if all(patch_of[window] is not None for window in windows):
            what = f"the patches {' and '.join(names)}"
            advice = f"let them slide ({' '.join(f'--slide {name}' for name in names)}; in Python sliding={names})"
        else:
            shapes = model.topology.shapes
            faces = [describe(window, shapes[window.block]) for window in windows if patch_of[window] is None]
            what = " and ".join([*names, *faces])
            advice = (
                "make patches of them ('bspline-mdao inspect GRID --draft FILE' drafts them, --patches FILE declares "
                "them) and let these slide (--slide PATCH; in Python sliding=...)"
            )
        texts.append(f"; {what} are periodic planes, by a {pair.motion}: {advice}")
    return "".join(texts)


def control_lines(
    model: FittedModel,  # the fitted grid
) -> np.ndarray:
    """Directions of the three lines of the control mesh through each control point."""
    # returns (n_control_points, 3, 3), rows are the directions i, j, k of the first volume with the point: from the
    # neighbour before it to the one after it, with the length to the nearer one (m); zero if no neighbour is at another
    # place
    points = model.control_points
    lines, is_done = np.zeros((len(points), 3, 3)), np.zeros(len(points), dtype=bool)
    for ids in model.mesh.control_ids:
        along = np.stack([_along(points[ids], d) for d in range(3)], axis=-2)
        is_new = ~is_done[ids]
        lines[ids[is_new]] = along[is_new]
        is_done[ids] = True
    return lines


def _along(net: np.ndarray, direction: int) -> np.ndarray:
    """Directions of a net of points (N0, N1, N2, 3) along one of its lines, with the length to the nearer end."""
    if net.shape[direction] == 1:
        return np.zeros_like(net)
    lengths = np.linalg.norm(np.diff(net, axis=direction), axis=-1)
    pad = [(0, 0)] * 3
    before, after = list(pad), list(pad)
    before[direction], after[direction] = (1, 0), (0, 1)
    nearer = np.minimum(*(np.pad(lengths, width, constant_values=np.inf) for width in (before, after)))
    across = np.gradient(net, axis=direction)
    size = np.linalg.norm(across, axis=-1)
    return across * np.divide(nearer, size, out=np.zeros_like(size), where=size > 0.0)[..., None]


def _independent(projectors: np.ndarray, lines: np.ndarray, directions: np.ndarray, short: float) -> np.ndarray:
    """Which directions of each point count, shape (n, 3): as many as its projector leaves, the least rotated first."""
    lengths = np.linalg.norm(lines, axis=2)
    left = np.linalg.norm(directions, axis=2) / np.maximum(lengths, np.finfo(float).tiny)
    left[lengths <= short] = -1.0
    rank = np.rint(np.trace(projectors, axis1=1, axis2=2)).astype(int)
    place = np.argsort(np.argsort(-left, axis=1, kind="stable"), axis=1)
    return (place < rank[:, None]) & (left > 0.0)


def _interleaved(ids: np.ndarray) -> np.ndarray:
    """Rows of x, y and z of numbered points."""
    return (3 * ids[:, None] + np.arange(3)).ravel()
