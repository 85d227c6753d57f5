"""Selections of surface control points: by patch, box, block, proximity, plane or number, and their combinations.

A selection is a small object resolved on the baseline of a mesh. Selections combine with ``&``, ``|`` and ``~``::

    where = OnPatch(model, "wing*") & ~InBox(high=(None, None, 0.1))

Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from ...base.checks import as_direction, as_numbers, as_vector
from ...base.display import OneLine
from ...base.matching import MARKERS, matching_names
from ...errors import InputError
from ..mesh.boundary import boundary_points, matching_patches
from ..mesh.moving_mesh import MovingMesh

__all__ = [
    "InBlock",
    "InBox",
    "NearPlane",
    "Nearest",
    "OnPatch",
    "OnSideOfPlane",
    "Selection",
    "SurfaceRows",
    "Where",
    "designed_patches",
    "rows_of",
]

TOUCHING = 1e-9
"""Distance, relative to the size of the mesh, up to which a point is on a limit: round-off of fitted points."""


class Selection(OneLine, ABC):
    """Some of the surface control points of a mesh."""

    @abstractmethod
    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is selected, shape (n_surface,), on the baseline."""

    @abstractmethod
    def __str__(self) -> str:
        """Describe the selection for messages such as 'no point is ...'."""

    def rows(self, mesh: MovingMesh) -> np.ndarray:
        """Rows of the selected points in ``mesh.surface_ids``, ascending."""
        rows = np.flatnonzero(self.mask(mesh))
        if not len(rows):
            raise InputError(f"selection: none of the {len(mesh.surface_ids)} surface control points is {self}")
        return rows

    def __and__(self, other: Selection) -> Selection:
        return _Both(self, other) if isinstance(other, Selection) else NotImplemented

    def __or__(self, other: Selection) -> Selection:
        return _Either(self, other) if isinstance(other, Selection) else NotImplemented

    def __invert__(self) -> Selection:
        return _Not(self)


Where = Selection | np.ndarray | Sequence[int]
"""Surface control points: a selection, or rows of ``mesh.surface_ids``."""


def rows_of(where: Where, mesh: MovingMesh, what: str) -> np.ndarray:
    """Rows of surface control points, at least one; ``what`` is for messages."""
    if isinstance(where, Selection):
        return where.rows(mesh)
    rows, n = np.atleast_1d(where), len(mesh.surface_ids)
    if not rows.size or rows.ndim > 1 or not np.issubdtype(rows.dtype, np.integer):
        raise InputError(f"{what}: give a selection, or numbers of surface control points")
    if rows.min() < 0 or rows.max() >= n:
        wrong = rows[(rows < 0) | (rows >= n)][0]
        raise InputError(f"{what}: there is no surface control point {wrong}; give numbers from 0 to {n - 1}")
    return rows


@dataclass(frozen=True, eq=False)
class _Both(Selection):
    a: Selection
    b: Selection

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        return self.a.mask(mesh) & self.b.mask(mesh)

    def __str__(self) -> str:
        return f"({self.a} and {self.b})"


@dataclass(frozen=True, eq=False)
class _Either(Selection):
    a: Selection
    b: Selection

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        return self.a.mask(mesh) | self.b.mask(mesh)

    def __str__(self) -> str:
        return f"({self.a} or {self.b})"


@dataclass(frozen=True, eq=False)
class _Not(Selection):
    a: Selection

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        return ~self.a.mask(mesh)

    def __str__(self) -> str:
        return f"not {self.a}"


@dataclass(frozen=True, eq=False)
class OnPatch(Selection):
    """Surface control points on patches.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The model of the mesh.
    patches : str or sequence of str
        Patches by name or pattern (``"wing*"``); for an unstructured mesh its walls.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import OnPatch
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(flat_plate_grid((5, 5, 5)))
    >>> mesh = moving_mesh(model)
    >>> upper = OnPatch(model, "*upper")
    >>> bool(0 < upper.mask(mesh).sum() < mesh.surface_ids.size)
    True
    """

    model: Any  # with mesh and topology, or of an unstructured mesh
    patches: str | Sequence[str]

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is on one of the patches."""
        model = self.model
        is_of_nodes = not mesh.blocks and len(mesh.markers) > 0  # see `bspline_mdao.core.mesh.node_mesh`
        if not is_of_nodes and [ids.shape for ids in model.control_ids] != [ids.shape for ids in mesh.blocks]:
            raise InputError(f"selection: the mesh is not of {model.source}; give OnPatch the model of the mesh")
        if mesh.markers:  # an unstructured mesh
            wanted = matching_names([name for name, *_ in mesh.markers], self.patches, model.source, MARKERS)
            found = [ids for name, ids, _ in mesh.markers if name in wanted]
        else:
            wanted = matching_patches(model.topology, self.patches)
            sides = boundary_points(model.topology, model.control_ids)
            found = [ids for face, ids in sides if face.patch in wanted]
        return np.isin(mesh.surface_ids, np.concatenate([np.zeros(0, dtype=int), *found]))

    def __str__(self) -> str:
        names = (self.patches,) if isinstance(self.patches, str) else self.patches
        return f"on patch {' or '.join(names) or '(none is named)'}"


def designed_patches(model: Any, mesh: MovingMesh) -> tuple[str, ...]:
    """Names of the patches of a model whose control points are all on the design surface of its mesh."""
    if mesh.markers:  # an unstructured mesh
        sides = [(name, ids) for name, ids, _ in mesh.markers]
    else:
        sides = [(face.patch, ids) for face, ids in boundary_points(model.topology, model.control_ids) if face.patch]
    other = {name for name, ids in sides if not np.isin(ids, mesh.surface_ids).all()}
    return tuple(dict.fromkeys(name for name, _ in sides if name not in other))


@dataclass(frozen=True)
class InBox(Selection):
    """Points in a box along the coordinate axes, including its sides.

    Parameters
    ----------
    low, high : sequence of three (float or None)
        Ends of the box in x, y and z (m); None if there is none.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import InBox
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> int(InBox(low=(None, 0.4, None)).mask(mesh).sum())  # points above y = 0.4 m
    9
    """

    low: Sequence[float | None] = (None, None, None)
    high: Sequence[float | None] = (None, None, None)

    def __post_init__(self) -> None:
        ends = (_limits(self.low, -np.inf), _limits(self.high, np.inf))
        if {end.shape for end in ends} != {(3,)}:
            raise InputError(f"selection: {self}; give three numbers (or None) for either end")
        if not (ends[0] <= ends[1]).all():
            raise InputError(f"selection: {self} has a low end above its high end, or one that is no number")

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is in the box."""
        points, margin = _surface(mesh), TOUCHING * mesh.size
        is_above = points >= _limits(self.low, -np.inf) - margin
        return np.all(is_above & (points <= _limits(self.high, np.inf) + margin), axis=1)

    def __str__(self) -> str:
        return f"in the box from {tuple(self.low)} to {tuple(self.high)}"


@dataclass(frozen=True, eq=False)
class InBlock(Selection):
    """Points of one block by their indices.

    Parameters
    ----------
    block : int
        Block of the mesh, from 0.
    index : index expression
        Which of the block's control points, as numpy indexes an array: ``np.s_[:, 0, 2:5]``. Indices are from 0.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import InBlock
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> int(InBlock(0, np.s_[:, :, 0]).mask(mesh).sum())
    9
    """

    block: int
    index: Any = ...

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is in this part of the block."""
        if self.block not in range(len(mesh.blocks)):
            raise InputError(
                f"selection: no block has the number {self.block}; give one from 0 to {len(mesh.blocks) - 1}"
            )
        try:
            ids = mesh.blocks[self.block][self.index]
        except IndexError as error:
            shape = mesh.blocks[self.block].shape
            raise InputError(f"selection: {self}; the block has {shape} control points ({error})") from None
        return np.isin(mesh.surface_ids, ids)

    def __str__(self) -> str:
        parts = self.index if isinstance(self.index, tuple) else (self.index,)
        return f"in block {self.block + 1} at [{', '.join(map(_indices, parts))}]"


@dataclass(frozen=True, eq=False)
class Nearest(Selection):
    """Points nearest to given places, with all points that coincide with them, for example across a thin plate.

    Parameters
    ----------
    places : array_like, shape (3,) or (n_places, 3)
        Places (m).
    n : int
        Number of points for each place.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import Nearest
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> mesh.points[mesh.surface_ids][Nearest([[0.0, 2.0, 0.0]]).mask(mesh)].round(3) + 0.0
    array([[0. , 0.5, 0. ]])
    """

    places: np.ndarray
    n: int = 1

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is near enough."""
        tree, places = cKDTree(_surface(mesh)), _vectors(self.places, str(self))
        if self.n not in range(1, tree.n + 1):
            raise InputError(f"selection: {self}; give a whole number from 1 to {tree.n}, all surface control points")
        farthest = tree.query(places, k=[self.n])[0][:, 0]
        found = tree.query_ball_point(places, farthest + TOUCHING * mesh.size)
        mask = np.zeros(tree.n, dtype=bool)
        mask[np.concatenate(found).astype(int)] = True
        return mask

    def __str__(self) -> str:
        return f"among the {self.n} nearest to {np.asarray(self.places).tolist()}"


@dataclass(frozen=True, eq=False)
class OnSideOfPlane(Selection):
    """Points on the side of a plane to which its normal points, including the plane.

    Parameters
    ----------
    point, normal : sequence of three float
        A point of the plane (m), and the normal, of any length.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import OnSideOfPlane
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> int(OnSideOfPlane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)).mask(mesh).sum())
    17
    """

    point: Sequence[float]
    normal: Sequence[float]

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is on that side."""
        return _heights(mesh, self.point, self.normal) >= -TOUCHING * mesh.size

    def __str__(self) -> str:
        return f"on the side of the normal {tuple(self.normal)} of the plane through {tuple(self.point)}"


@dataclass(frozen=True, eq=False)
class NearPlane(Selection):
    """Points within a distance of a plane.

    Parameters
    ----------
    point, normal : sequence of three float
        A point of the plane (m), and the normal, of any length.
    distance : float
        Largest distance (m).

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import NearPlane
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> int(NearPlane((0.0, 0.5, 0.0), (0.0, 1.0, 0.0), distance=1e-6).mask(mesh).sum())
    9
    """

    point: Sequence[float]
    normal: Sequence[float]
    distance: float = 0.0

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is near the plane."""
        heights = _heights(mesh, self.point, self.normal)
        return np.abs(heights) <= self.distance + TOUCHING * mesh.size

    def __str__(self) -> str:
        return (
            f"within {self.distance:g} m of the plane through {tuple(self.point)} with the normal {tuple(self.normal)}"
        )


@dataclass(frozen=True, eq=False)
class SurfaceRows(Selection):
    """Surface control points by their number.

    Parameters
    ----------
    numbers : array_like of int
        Rows of ``mesh.surface_ids``, from 0.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import SurfaceRows
    >>> from bspline_mdao.drivers import combine
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> (SurfaceRows([0, 1]) & ~SurfaceRows([1])).mask(mesh).nonzero()[0]  # selections combine by &, or, not
    array([0])
    """

    numbers: Sequence[int]

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is one of them."""
        rows, n = np.ravel(self.numbers), len(mesh.surface_ids)
        if rows.size and (not np.issubdtype(rows.dtype, np.integer) or rows.min() < 0 or rows.max() >= n):
            raise InputError(f"selection: rows {rows.min()} to {rows.max()}; give whole numbers from 0 to {n - 1}")
        mask = np.zeros(n, dtype=bool)
        mask[rows.astype(int)] = True
        return mask

    def __str__(self) -> str:
        return f"one of {np.size(self.numbers)} given rows"


def _surface(mesh: MovingMesh) -> np.ndarray:
    return mesh.points[mesh.surface_ids]


def _limits(ends: Sequence[float | None], without: float) -> np.ndarray:
    """Ends of a box, None replaced."""
    return np.array([without if end is None else end for end in ends], dtype=float)


def _indices(part: Any) -> str:
    """An index in Python notation."""
    if part is ...:
        return "..."
    if not isinstance(part, slice):
        return str(part)
    ends = ["" if end is None else str(end) for end in (part.start, part.stop, part.step)]
    return ":".join(ends if ends[2] else ends[:2])


def _vectors(values: ArrayLike, what: str) -> np.ndarray:
    """Finite vectors, shape (n, 3)."""
    vectors = np.atleast_2d(as_numbers(values, f"selection: {what}"))
    if vectors.ndim != 2 or vectors.shape[1] != 3 or not np.isfinite(vectors).all():
        raise InputError(f"selection: {what}; give finite points of three coordinates")
    return vectors


def _heights(mesh: MovingMesh, point: ArrayLike, normal: ArrayLike) -> np.ndarray:
    """Distance of every surface control point from a plane, along its normal."""
    point = as_vector(point, "selection: the point of a plane")
    return (_surface(mesh) - point) @ as_direction(normal, "selection: the normal of a plane")
