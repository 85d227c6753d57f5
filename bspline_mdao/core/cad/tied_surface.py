"""Wall nodes of a grid or mesh that are tied to the faces of a CAD file, once, on the baseline.

Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import bsr_array, csr_array, eye_array, kron

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...grids.topology.length_unit import metres_of
from ..mesh.surface import SurfaceGrid
from ..model.movable import Movable
from ..sliding.fixed_surface import refuse_far
from .cad_body import CadBody, CadTie
from .files import read_cad

__all__ = ["TiedSurface", "body_of_file", "require_on_faces"]

OTHER_UNIT = 5.0
"""Faces this many times larger or smaller than the walls are in another unit."""


@dataclass(frozen=True, eq=False)
class TiedSurface(OneLine):
    """Wall nodes and the CAD faces that they lie on. Made by `TiedSurface.of`.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The grid or mesh.
    surface : SurfaceGrid
        Nodes of all or some of its walls.
    body : CadBody
        The faces.
    tie : CadTie
        Face, (u, v) and distance of every node.

    Examples
    --------
    >>> from bspline_mdao import FittedModel
    >>> from bspline_mdao.design import TiedSurface
    >>> tied = TiedSurface.of(FittedModel.load("wing.h5"), "wing.step")  # doctest: +SKIP
    >>> tied.distances.max()  # of a node from the faces (m)  # doctest: +SKIP
    1.4e-9
    """

    model: Movable
    surface: SurfaceGrid
    body: CadBody
    tie: CadTie

    @classmethod
    def of(
        cls,
        model: Movable,
        file: str | os.PathLike | CadBody,
        patches: str | Sequence[str] | None = None,
        scale: float | None = None,
    ) -> TiedSurface:
        """Tie each wall node to the nearest face of a CAD file.

        If every patch has the name of a face, as in files made by `write_cad`, nodes are tied only to faces of their
        patch.

        Parameters
        ----------
        model : FittedModel or MeshModel
            The grid or mesh.
        file : path-like or CadBody
            A STEP or IGES file, or its contents.
        patches : str or sequence of str, optional
            Patches by name or pattern (``"wing*"``); all walls by default.
        scale : float, optional
            Grid length per metre in the file; by default from the grid's unit.

        Returns
        -------
        TiedSurface

        Raises
        ------
        InputError
            If the file cannot be read, or a node is farther off its faces than 0.01 of the size of the walls.
        """
        body = file if isinstance(file, CadBody) else body_of_file(model, file, scale)
        surface = SurfaceGrid.of(model, patches)
        names = _names_of_nodes(surface) if set(surface.patches) <= set(body.names) else None
        tie = body.tie(surface.points, names)
        require_on_faces(body, tie, surface)
        return cls(model, surface, body, tie)

    @property
    def distances(self) -> np.ndarray:
        """Distances of the nodes from the faces (m), shape (n,)."""
        return self.tie.distances

    def nodes(self, body: CadBody) -> np.ndarray:
        """Nodes (m) with moved faces, shape (n, 3); nodes in symmetry planes stay in them.

        Parameters
        ----------
        body : CadBody
            The moved faces, see `CadBody.at` and `CadBody.matched`.
        """
        move = self._in_planes @ self.body.displacement(body, self.tie).ravel()
        return self.surface.points + move.reshape(-1, 3)

    def shape(self, file: str | os.PathLike | CadBody, scale: float | None = None) -> CadBody:
        """Read the same faces, moved, from another file.

        Parameters
        ----------
        file : path-like or CadBody
            A file of the same topology: faces with the same names, or in the same order, with matching parameter
            directions. Knots and degrees may differ.
        scale : float, optional
            Grid length per metre in the file; by default from the grid's unit.

        Returns
        -------
        CadBody

        Raises
        ------
        InputError
            If the file cannot be read or its faces do not match, see `CadBody.matched`.
        """
        return self.body.matched(file if isinstance(file, CadBody) else body_of_file(self.model, file, scale))

    @cached_property
    def matrix(self) -> csr_array:
        """Map from moves of the body's control points to moves of nodes, xyz interleaved: (3 n, 3 n_control_points)."""
        return csr_array(self._in_planes @ kron(self.body.matrix(self.tie), eye_array(3), format="csr"))

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the nodes, shape (n, 3), from a change of the body's control points (n_control_points, 3)."""
        n = self.matrix.shape[1] // 3
        return (self.matrix @ as_finite_points(change, n, "change of control points").ravel()).reshape(-1, 3)

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`: (n, 3) to (n_control_points, 3)."""
        return (self.matrix.T @ as_finite_points(bar, self.surface.n_points, "seed of nodes").ravel()).reshape(-1, 3)

    @cached_property
    def _in_planes(self) -> csr_array:
        """Projection that keeps moves of nodes in symmetry planes; (3 n, 3 n)."""
        blocks = np.tile(np.eye(3), (self.surface.n_points, 1, 1))
        for numbers, normal in self.surface.on_planes(self.model):
            blocks[numbers] = (np.eye(3) - np.outer(normal, normal)) @ blocks[numbers]
        n = len(blocks)
        return bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)).tocsr()


def body_of_file(
    model: Movable,  # the grid or mesh
    path: str | os.PathLike,  # a STEP or IGES file
    scale: float | None,  # grid length per metre in the file; from the grid's unit if None
) -> CadBody:
    """Read the faces of a file in the unit of a grid or mesh."""
    unit = model.baseline.length_unit
    return read_cad(path).body.scaled(1.0 / metres_of(unit) if scale is None else scale)


def require_on_faces(body: CadBody, tie: CadTie, surface: SurfaceGrid, points: np.ndarray | None = None) -> float:
    """Refuse surface nodes, at points (n, 3) if given, that are far off; return the largest distance."""
    points = surface.points if points is None else points

    def place_of(number: int) -> str:
        on = next(n for n, part in enumerate(surface.parts) if (part == number).any())
        return f"the node at ({', '.join(f'{x:.4g}' for x in points[number])}) of {surface.names[on]}"

    ratio = body.size / surface.size
    is_other = not 1.0 / OTHER_UNIT < ratio < OTHER_UNIT
    unit = f"say the grid's unit (--units) or give a scale: the faces are {ratio:.3g} times as large as the walls"
    cure = unit if is_other else "name the patches that are on it alone"
    return refuse_far(tie.distances, points, place_of, body.source, "its faces", "the walls' size", cure)[1]


def _names_of_nodes(surface: SurfaceGrid) -> list[frozenset[str]]:
    """Patches of each node."""
    is_on = np.zeros((surface.n_points, len(surface.names)), dtype=bool)
    for number, part in enumerate(surface.parts):
        is_on[np.unique(part), number] = True
    rows, kinds = np.unique(is_on, axis=0, return_inverse=True)
    names = [frozenset(patch for patch, on in zip(surface.patches, row) if on) for row in rows]
    return [names[kind] for kind in kinds.ravel().tolist()]
