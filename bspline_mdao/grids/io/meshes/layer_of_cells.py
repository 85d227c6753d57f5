"""Two-dimensional meshes, taken as one layer of cells between the two planes of a section.

Triangles become wedges, quads hexahedra, and lines of markers quads. Every node occurs twice: first all nodes in the
lower plane, in the order of the file, then the nodes in the upper one. A section moves equally in both planes, so
either copy gives the place of a node of the file.

A mesh without a section lies between the plane of the file and another plane one unit of length above it: volumes of
its cells are then areas, and forces are per unit span, as two-dimensional solvers give them.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ....base.display import OneLine
from ....errors import InputError, MovementError
from ...cells.mesh_numbers import require_corners
from ...cells.mixed_cells import MixedMesh
from .stored_mesh import StoredMesh, StoredPoints

__all__ = ["LayerPoints", "SectionSpan", "layer_of_cells", "volume_or_layer"]

PRISMS = {"triangle": "wedge", "quad": "hexahedron"}
"""Cell between the copies of an element in the two planes."""

ALIKE = 1e-6
"""Distance of the two copies of a node, relative to the size of a mesh, that is tolerated: less than the width of any
cell, and more than the error of systems solved to single precision."""


FLAT = 1e-9
"""Variation of the third coordinate of the nodes, relative to the size of a mesh, that is tolerated: programs that
rotate a plane leave rounding errors in it."""

UNIT = 1.0
"""Distance of the two planes of a mesh without a section, in the unit of its file."""


@dataclass(frozen=True)
class SectionSpan(OneLine):
    """The two parallel planes between which a section lies. Found by `section_span`.

    Parameters
    ----------
    axis : int
        Axis normal to them: 0, 1 or 2 for x, y or z.
    low, high : float
        Their coordinates (m).

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import naca_section, section_o_grid
    >>> from bspline_mdao.meshes import section_span
    >>> span = section_span(fit_grid(section_o_grid(naca_section(0.12), n_around=32, far=20.0)))
    >>> span.axis, span.in_plane, round(span.low, 9), round(span.high, 9)
    (2, (0, 1), 0.0, 1.0)
    """

    axis: int
    low: float
    high: float

    @property
    def in_plane(self) -> tuple[int, int]:
        """Axes of the planes, in the order of the two coordinates of a node of the file."""
        first, second = (axis for axis in range(3) if axis != self.axis)
        return first, second


@dataclass(frozen=True, eq=False)
class LayerPoints(OneLine):
    """Nodes of a two-dimensional file, in both planes."""

    stored: np.ndarray  # (n, 2) or (n, 3), nodes of the file
    axes: tuple[int, int]  # their two coordinates in the planes
    span: SectionSpan  # the planes
    source: str  # name of the file, for messages

    @classmethod
    def of(cls, stored: np.ndarray, span: SectionSpan | None, source: str) -> LayerPoints:
        """Find the coordinates in the planes: both, or all of three but the one that is constant."""
        is_bad = ~np.isfinite(stored).all(axis=1)
        if is_bad.any():
            node = int(np.argmax(is_bad))
            raise InputError(f"{source}: nodes: number {node + 1} is {stored[node]}, not finite; correct it")
        axes, flat, low = list(range(stored.shape[1])), 2, 0.0
        if len(axes) == 3 and len(stored):
            sizes = np.ptp(stored, axis=0)
            if sizes.min() <= FLAT * sizes.max():
                flat = 2 - int(np.argmin(sizes[::-1]))  # the last of several
                low = float(stored[0, flat])
                axes.remove(flat)
        if len(axes) != 2:
            raise InputError(
                f"{source}: is a surface that is in no plane of two axes; give a mesh of a volume or a plane"
            )
        span = SectionSpan(flat, low, low + UNIT) if span is None else span
        return cls(stored, (axes[0], axes[1]), span, source)

    @property
    def values(self) -> np.ndarray:
        """The nodes, shape (2 n, 3)."""
        n = len(self.stored)
        points = np.empty((2 * n, 3))
        points[:n, self.span.axis], points[n:, self.span.axis] = self.span.low, self.span.high
        for axis, stored in zip(self.span.in_plane, self.axes):
            points[:n, axis] = points[n:, axis] = self.stored[:, stored]
        return points

    def in_file(self, values: np.ndarray) -> np.ndarray:
        """Return new nodes, shape (2 n, 3), in the form of the file: those in the lower plane."""
        values = np.asarray(values, dtype=float)
        low, high = (half[:, self.span.in_plane] for half in np.split(values, 2))
        apart = np.linalg.norm(high - low, axis=1)
        worst = int(np.argmax(apart))
        if not apart[worst] <= ALIKE * np.linalg.norm(np.ptp(low, axis=0)):
            raise MovementError(
                f"{self.source}: node {worst + 1} is {apart[worst]:.3g} m farther in one plane of the section than in "
                f"the other, and the file has two dimensions; nothing was written; deform the section alike along its "
                f"span"
            )
        stored = self.stored.astype(float)
        stored[:, self.axes] = low
        return stored

    def mesh(
        self,
        cells: Mapping[str, np.ndarray],
        lines: Mapping[str, np.ndarray],
        stated: Mapping[str, str] | None = None,  # what the file says about its markers
    ) -> MixedMesh:
        """Make the layer of cells from triangles and quads, and from its markers, which are lines, shape (m, 2)."""
        n = len(self.stored)
        for name, corners in cells.items():
            require_corners(corners, corners.shape[1], n, f"{self.source}: cells '{name}'")
        cells = _turned_alike(self.stored[:, self.axes], cells) if cells else {}
        prisms = {PRISMS[name]: np.concatenate([corners, corners + n], axis=1) for name, corners in cells.items()}
        markers = {name: np.concatenate([ends, ends[:, ::-1] + n], axis=1) for name, ends in lines.items()}
        return MixedMesh(self.values, prisms, markers, source=self.source, n_copies=2, stated=stated)


def _turned_alike(points: np.ndarray, cells: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Turn cells of a plane so that all parts of the mesh have the orientation of the largest.

    Surfaces of Gmsh and zones have arbitrary orientations. A part consists of cells that traverse their common edges in
    opposite directions: a folded cell does so as well, and stays folded.
    """
    edges = [np.stack([corners, np.roll(corners, -1, axis=1)], axis=2) for corners in cells.values()]
    n_cells = sum(map(len, edges))
    firsts = np.cumsum([0, *map(len, edges)])
    owners = np.concatenate(
        [np.repeat(first + np.arange(len(pairs)), pairs.shape[1]) for first, pairs in zip(firsts, edges)]
    )
    ends = np.concatenate([pairs.reshape(-1, 2) for pairs in edges])
    order = np.lexsort((ends.max(axis=1), ends.min(axis=1)))
    ends, owners = ends[order], owners[order]
    is_joint = (ends[1:] == ends[:-1, ::-1]).all(axis=1)
    graph = coo_matrix((np.ones(is_joint.sum()), (owners[1:][is_joint], owners[:-1][is_joint])), (n_cells, n_cells))
    n_parts, part = connected_components(graph, directed=False)
    areas, unit = [], max(np.abs(points).max(initial=0.0), np.finfo(float).tiny)  # no overflow in any unit
    for corners in cells.values():
        x, y = (points[corners] / unit).transpose(2, 0, 1)
        areas.append(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    signs = np.bincount(part, np.sign(np.concatenate(areas)), n_parts)
    largest = signs[np.argmax(np.bincount(part, minlength=n_parts))]
    is_turned = (signs * np.sign(largest) < 0.0)[part]
    turned = {}
    for (kind, corners), first in zip(cells.items(), firsts):
        mask = is_turned[first : first + len(corners), None]
        turned[kind] = np.where(mask, corners[:, ::-1], corners)
    return turned


@dataclass(frozen=True, eq=False)
class _PointsTwice:
    """Nodes in the bytes of a two-dimensional file, and in both planes."""

    stored: StoredPoints
    layer: LayerPoints

    @property
    def values(self) -> np.ndarray:
        """The nodes, shape (2 n, 3)."""
        return self.layer.values

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the bytes with new nodes, shape (2 n, 3)."""
        return self.stored.replaced(self.layer.in_file(values))


def layer_of_cells(
    # its nodes in the bytes of its file, shape (n, 2), or (n, 3) with one constant coordinate
    stored: StoredPoints,
    cells: Mapping[str, np.ndarray],  # of int, corners of its triangles and quads
    # mapping of str to ndarray of int, each of shape (m, 2) of int, ends of the lines of its markers
    lines: Mapping[str, np.ndarray],
    span: SectionSpan | None,  # the planes; None if there is no section
    source: str,  # name of the file, for messages
) -> StoredMesh:
    """Make the layer of cells of a two-dimensional mesh."""
    layer = LayerPoints.of(stored.values, span, source)
    return StoredMesh(layer.mesh(cells, lines), _PointsTwice(stored, layer))


Elements = Mapping[str, np.ndarray]


def volume_or_layer(
    stored: StoredPoints,  # nodes in the bytes of the file
    # volume, plane: of int, corners of cells by kind, and of the elements of markers by name: faces, shape (m, 4), for
    # a volume, and lines, shape (m, 2), for a plane
    volume: tuple[Elements, Elements],
    plane: tuple[Elements, Elements],
    span: SectionSpan | None,  # the planes of the section; None for a plane without one
    source: str,  # name of the file, for messages
) -> StoredMesh:
    """Make the mesh of the cells of a volume or, if there are none, the layer of the cells of a plane."""
    if volume[0]:
        return StoredMesh(MixedMesh(stored.values, volume[0], volume[1], source=source), stored)
    if plane[0]:
        return layer_of_cells(stored, *plane, span, source)
    raise InputError(f"{source}: has no cells of a volume or of a plane; give a mesh of one")
