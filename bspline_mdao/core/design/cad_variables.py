"""CAD design variables: control points of the faces that walls are tied to, and shapes of other files.

They move wall nodes linearly and exactly, ``of_nodes``; surface control points follow the nodes as for any given nodes.
Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csc_array, csr_array

from ...base.display import OneLine
from ...errors import InputError
from ..cad.cad_body import CadBody
from ..cad.tied_surface import TiedSurface
from ..fit.surface_fit import follower_of
from .displacement import Direction, Displacement, directions_of
from .variable import AuxiliaryPoints, Layout

__all__ = ["CadPoints", "CadShapes", "CadVariable", "moved_body", "require_one_tie"]

IDLE = 1e-9
"""A control point whose largest weight in any node is below this gets no value: an optimizer could move it by any
amount without effect."""

ON_PLANE = 1e-7
"""Distance, relative to the size of the body, up to which a control point lies in a symmetry plane: the precision of
files."""


@dataclass(frozen=True, eq=False)
class CadVariable(OneLine, ABC):
    """A design variable that moves the faces of a CAD file, and the wall nodes that are tied to them."""

    name: str
    tied: TiedSurface

    auxiliary: ClassVar[tuple[AuxiliaryPoints, ...]] = ()

    @property
    @abstractmethod
    def of_nodes(self) -> csc_array:
        """Moves of the nodes, xyz interleaved (m), per unit of the values: (3 n, n_values)."""

    @abstractmethod
    def body_at(self, values: np.ndarray) -> CadBody:
        """Return the moved faces at values, shape (n_values,): what `write_body` writes to a file."""

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves: zeros, shape (n_values,)."""
        return np.zeros(self.of_nodes.shape[1])

    def bind(self, layout: Layout) -> Displacement:
        """Let the surface control points follow the nodes.

        Raises
        ------
        InputError
            If nodes of the design surface are not tied.
        """
        numbers = np.arange(self.tied.surface.n_points)
        follower = follower_of(self.tied.model, layout.mesh, self.tied.surface, numbers)
        at, of_nodes = follower.at(follower.baseline), self.of_nodes
        moves = np.zeros((3 * len(layout.points), of_nodes.shape[1]))
        for value in range(of_nodes.shape[1]):
            change = of_nodes[:, [value]].toarray().reshape(-1, 3)
            moves[: 3 * layout.n_surface, value] = at.jvp(change).ravel()
        return Displacement(csr_array(moves))


@dataclass(frozen=True, eq=False)
class CadPoints(CadVariable):
    """Move control points of the faces of a CAD file, and the walls with them.

    Every control point has one value per direction, point by point. A value is a displacement, initially zero.
    Coincident control points of neighbouring faces count as one, so common edges stay closed. Control points that
    affect other edges, of trimmed faces, have no values, nor do control points that move no node. Control points in a
    symmetry plane stay in it. `point_ids` lists the remaining points.

    Parameters
    ----------
    name : str
        Name of the variable.
    tied : TiedSurface
        Wall nodes of a grid or mesh, and the faces that they are tied to.
    where : index expression or ndarray of bool, optional
        Which rows of ``tied.body.control_points``; all by default.
    direction : str or array_like
        Coordinate axes by name, ``"y"`` or several as in ``"xyz"``; a vector, shape (3,); or vectors of the remaining
        points, shape (n, 3) or (n, 3, m).
    units : str, optional
        Units of the values: m by default, None if the vectors carry them.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, FittedModel
    >>> from bspline_mdao.design import CadPoints, TiedSurface
    >>> model = FittedModel.load("wing.h5")  # doctest: +SKIP
    >>> shape = CadPoints("shape", TiedSurface.of(model, "wing.step"), direction="y")  # doctest: +SKIP
    >>> group = DesignSurface.of(model).grid_movement([shape])  # doctest: +SKIP
    """

    where: Any = ...
    direction: Direction = "xyz"
    units: str | None = "m"

    @cached_property
    def point_ids(self) -> np.ndarray:
        """Rows of ``tied.body.control_points`` that have values, ascending.

        Raises
        ------
        InputError
            If there are none, or ``where`` does not match the control points.
        """
        body, asked = self.tied.body, np.zeros(len(self.tied.body.control_points), dtype=bool)
        try:
            asked[self.where] = True
        except IndexError as error:
            raise InputError(f"'{self.name}': where: {error}; the faces have {len(asked)} control points") from None
        matrix = self.tied.matrix
        weights = np.zeros(len(asked))
        np.maximum.at(weights, matrix.indices // 3, np.abs(matrix.data))
        ids = np.flatnonzero(asked & ~body.is_fixed & (weights >= IDLE))
        if not len(ids):
            n, fixed = np.count_nonzero(asked), np.count_nonzero(asked & body.is_fixed)
            raise InputError(
                f"'{self.name}': of {n} control points asked for, {fixed} are fixed, since they reach an edge that "
                f"cuts a face or whose faces have other splines, and {n - fixed} move no node; choose others with "
                f"'where', write faces untrimmed, or move them by a second file"
            )
        return ids

    @cached_property
    def _of_points(self) -> csc_array:
        """Moves of the body's control points per unit of the values, (3 n_control_points, n_values)."""
        ids, body = self.point_ids, self.tied.body
        fields = directions_of(self.direction, len(ids), None, f"'{self.name}'")
        kept, points = fields.copy(), body.control_points
        for plane in self.tied.surface.planes:
            is_on = np.abs(points[ids] @ plane.normal - plane.offset) <= ON_PLANE * body.size
            kept[is_on] -= plane.normal[:, None] * (plane.normal @ kept[is_on])[:, None]
        is_left = np.linalg.norm(kept, axis=1) > IDLE * np.linalg.norm(fields, axis=1)
        if not is_left.any():
            raise InputError(
                f"'{self.name}': all of its control points lie in a plane of symmetry and would leave it; choose "
                f"others with 'where', or another direction"
            )
        rows = np.repeat(ids, is_left.sum(axis=1))
        entries = (3 * rows[:, None] + np.arange(3)).ravel()
        starts = 3 * np.arange(len(rows) + 1)
        return csc_array((kept.transpose(0, 2, 1)[is_left].ravel(), entries, starts), shape=(points.size, len(rows)))

    @cached_property
    def of_nodes(self) -> csc_array:
        """Moves of the nodes, xyz interleaved (m), per unit of the values: (3 n, n_values)."""
        return csc_array(self.tied.matrix @ self._of_points)

    def body_at(self, values: np.ndarray) -> CadBody:
        """Return the moved faces at values, shape (n_values,): what `write_body` writes to a file."""
        points = self.tied.body.control_points
        return self.tied.body.at(points + (self._of_points @ np.asarray(values)).reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class CadShapes(CadVariable):
    """Move walls towards the shapes of other CAD files with the same faces, one value per file.

    A value is the fraction of the move: 0 at the baseline, 1 with a node at its (u, v) on that file's faces. Moves of
    several files add up.

    Parameters
    ----------
    name : str
        Name of the variable.
    tied : TiedSurface
        Wall nodes of a grid or mesh, and the faces that they are tied to.
    shapes : sequence of CadBody
        Faces of the other files, matched and in the grid's unit, see `TiedSurface.shape`.

    Examples
    --------
    >>> from bspline_mdao.design import CadShapes
    >>> twist = CadShapes("twist", tied, [tied.shape("twisted.step")])  # doctest: +SKIP
    """

    shapes: Sequence[CadBody] = ()
    units: ClassVar[str | None] = None

    def __post_init__(self) -> None:
        if not self.shapes:
            raise InputError(f"'{self.name}': there is no shape to go to; give one CAD file at least")

    @cached_property
    def of_nodes(self) -> csc_array:
        """Moves of the nodes, xyz interleaved (m), per unit of the values: (3 n, n_values)."""
        moves = [self.tied.nodes(shape) - self.tied.surface.points for shape in self.shapes]
        return csc_array(np.stack([move.ravel() for move in moves], axis=1))

    def body_at(self, values: np.ndarray) -> CadBody:
        """Return the moved faces at values; `InputError` if files have different knots, so they cannot be added."""
        body = self.tied.body
        points = body.control_points
        for value, shape in zip(np.asarray(values), self.shapes):
            points = points + value * (body.control_points_of(shape) - body.control_points)
        return body.at(points)


def moved_body(variables: Sequence[CadVariable], values: Mapping[str, Any]) -> CadBody:
    """Move the faces of a CAD file by several variables.

    Parameters
    ----------
    variables : sequence of CadVariable
        `CadPoints` and `CadShapes` of one `TiedSurface`. Their moves add up.
    values : mapping of str to array_like
        Values of each by its name.

    Returns
    -------
    CadBody
        What `write_cad_body` writes to a file.

    Raises
    ------
    InputError
        If there is no variable, the variables are of different walls, or files have different knots, so they cannot be
        added.

    Examples
    --------
    >>> from bspline_mdao.design import moved_body
    >>> from bspline_mdao.files import write_cad_body
    >>> moved = moved_body([bumps, twist], {"bumps": problem["bumps"], "twist": 0.5})  # doctest: +SKIP
    >>> shape = write_cad_body("optimum.step", moved)  # doctest: +SKIP
    """
    require_one_tie(variables, "moved faces")
    body = variables[0].tied.body
    points = body.control_points
    moves = [v.body_at(np.atleast_1d(values[v.name])).control_points - points for v in variables]
    return body.at(points + np.sum(moves, axis=0))


def require_one_tie(variables: Sequence[CadVariable], what: str) -> None:
    """Refuse variables of different walls, or no variables."""
    if not variables:
        raise InputError(f"{what}: no variable moves the walls; give one at least")
    if any(variable.tied is not variables[0].tied for variable in variables):
        raise InputError(f"{what}: variables are of different walls; make all with one TiedSurface")
