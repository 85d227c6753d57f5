"""Meshes of mixed cells: tetrahedra, pyramids, wedges, hexahedra and polyhedra, by the faces of their cells.

Corners are numbered as in VTK, CGNS and Gmsh::

    tetra    0, 1, 2, and 3 above               pyramid      0, 1, 2, 3, and 4 above
    wedge    0, 1, 2, and 3, 4, 5 above         hexahedron   0, 1, 2, 3, and 4, 5, 6, 7 above

Every inner face is stored twice, once for each of its cells, as a quad around the normal out of the cell; triangles
repeat their last corner, and faces with more corners are cut into a fan.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...errors import InputError
from .faces_of_cells import write_faces
from .marked_faces import faces_at, faces_on
from .mesh_numbers import require_cells, require_corners
from .pyramids import Pyramids
from .quads import area_vectors

__all__ = [
    "FACES",
    "CellQuality",
    "MixedMesh",
    "face_keys",
    "faces_around",
    "fans",
    "first_heights",
    "padded",
    "quality_of",
]

FACES = {
    "tetra": ((0, 2, 1, 1), (0, 1, 3, 3), (1, 2, 3, 3), (2, 0, 3, 3)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4, 4), (1, 2, 4, 4), (2, 3, 4, 4), (3, 0, 4, 4)),
    "wedge": ((0, 2, 1, 1), (3, 4, 5, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
"""Faces of each kind of cell, around the outward normal."""

MIXERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
"""Odd numbers that combine corners into one number modulo 2^64 if they do not fit: two of ten million faces collide
with a probability of 3e-6."""

UPRIGHT = 0.1
"""Cosine of the angle between an edge and the normal of the wall, above which the edge leads off the wall."""

CANCELLED = 1e-6
"""Fraction of the areas around a node that their sum must have for a normal there: at the edge of a plate without
thickness both sides cancel but for rounding."""


def padded(faces: np.ndarray) -> np.ndarray:
    """Faces as quads, shape (n, 4): triangles repeat their last corner."""
    return faces if faces.shape[1] == 4 else faces[:, [0, 1, 2, 2]]


def fans(
    corners: np.ndarray,  # int (n_corners,), corners of all faces in sequence
    sizes: np.ndarray,  # int (n_faces,), number of corners of each
) -> tuple[np.ndarray, np.ndarray]:
    """Cut faces of any number of corners into quads and triangles."""
    # returns quads int (n, 4): quads, and triangles with their last corner twice; faces with more corners are fans
    # returns face int (n,): face of each, ascending
    starts, counts = np.cumsum(sizes) - sizes, np.where(sizes > 4, sizes - 2, 1)
    face = np.repeat(np.arange(len(sizes)), counts)
    piece = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    last = np.where(sizes[face] == 4, 3, piece + 2)
    places = np.stack([0 * piece, piece + 1, piece + 2, last], axis=1)
    return corners[starts[face][:, None] + places], face


@dataclass(frozen=True, eq=False)
class CellQuality(OneLine):
    """Volumes of cells, and which cells are inverted."""

    volumes: np.ndarray  # (n_cells,), volumes (m^3)
    # whether the volume, or the volume of a pyramid from the centre of the cell to one of its faces, is not positive.
    # The centre is the mean of the centres of its faces, weighted by their areas
    is_inverted: np.ndarray  # bool (n_cells,)


@dataclass(frozen=True, eq=False)
class MixedMesh(OneLine):
    """A mesh of mixed cells. Made by `read_mesh`, or from arrays.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Nodes (m).
    cells : mapping of str to ndarray of int, each of shape (n_kind, n_corners)
        Corners of the cells of each kind, see `FACES`.
    markers : mapping of str to ndarray of int, each of shape (n_faces, 4)
        Faces of the parts of the boundary, by name; triangles repeat their last corner.
    polyhedra : tuple of two ndarray of int, of shapes (n_faces, 4) and (n_faces,), optional
        Faces of cells of any kind as seen from each cell, around the outward normal, and the numbers of their cells.
    source : str
        Its origin, for messages.
    n_copies : int
        Number of copies of each node of its file among the nodes, all nodes once before any a second time: two for a
        two-dimensional file.
    stated : mapping of str to str, optional
        What the file says about markers: types of OpenFOAM's patches, or of CGNS's boundary conditions.
    polygons : ndarray of int, shape (n_faces,), optional
        The polygon to which each face of ``polyhedra`` belongs; pieces of one polygon are consecutive. By default each
        face is a polygon of its own.
    numbers : ndarray of int, shape (n_file,), optional
        The node of the mesh for each node of its file, if the file is a grid of blocks, which share nodes: blocks in
        order, each in C order.
    unit : str
        Unit of its lengths, empty if unknown; metres are assumed then.

    Raises
    ------
    InputError
        If a node is not finite, an element has a node that does not exist, a kind of cells is unknown, or a cell has no
        faces: kernels index by these numbers unchecked.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MixedMesh
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> mesh = MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])})
    >>> mesh.quality().volumes.round(6)
    array([0.166667])
    """

    points: np.ndarray
    cells: Mapping[str, np.ndarray]
    markers: Mapping[str, np.ndarray] | None = None
    polyhedra: tuple[np.ndarray, np.ndarray] | None = None
    source: str = "mesh"
    n_copies: int = 1
    stated: Mapping[str, str] | None = None
    polygons: np.ndarray | None = None
    numbers: np.ndarray | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        """Refuse what is not a mesh, whatever its source."""
        object.__setattr__(self, "points", self.as_nodes(self.points))
        n, copies = len(self.points), self.n_copies
        for kind, corners in self.cells.items():
            if kind not in FACES:
                raise InputError(f"{self.source}: has cells '{kind}'; known are {', '.join(FACES)}")
            require_corners(corners, 1 + max(map(max, FACES[kind])), n, f"{self.source}: cells '{kind}'", copies)
        for name, faces in (self.markers or {}).items():
            require_corners(faces, 4, n, f"{self.source}: faces of marker '{name}'", copies)
        if self.polyhedra is not None:
            require_cells(*self.polyhedra, n, self.source)

    def as_nodes(self, points: np.ndarray) -> np.ndarray:
        """Return other nodes of the mesh, shape (n, 3), as 8-byte reals.

        Raises
        ------
        InputError
            If they have another shape, or are not finite, or are complex.
        """
        nodes = as_finite_points(points, len(self.points), f"{self.source}: nodes")
        if nodes.dtype.kind == "c":
            raise InputError(f"{self.source}: nodes are complex; give real ones")
        return nodes

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def length_unit(self) -> str:
        """Unit of its lengths: the given one, or metres."""
        return self.unit or "m"

    @property
    def n_stored(self) -> int:
        """Number of nodes of its file."""
        return self.n_points // self.n_copies

    @property
    def width(self) -> float:
        """Distance (m) between the planes of a two-dimensional file: volumes by it are areas; 1 in three dimensions."""
        ends = self.points[: self.n_stored + 1 : max(self.n_stored, 1)]
        return float(np.linalg.norm(ends[1] - ends[0])) if self.n_copies == 2 and len(ends) == 2 else 1.0

    def nodes_of_file(self, points: np.ndarray) -> np.ndarray:
        """Return nodes of the mesh, shape (n, 3), in the order of its file.

        For a grid of blocks this is the grid vector, shape (n_file, 3), with shared nodes once in each block.
        """
        points = self.as_nodes(points)
        return points[: self.n_stored] if self.numbers is None else points[self.numbers]

    def stored_ids(self, ids: np.ndarray) -> np.ndarray:
        """Numbers in its file of some nodes, ascending, each once."""
        return np.unique(ids % self.n_stored) if len(ids) else ids

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        n = sum(len(corners) for corners in self.cells.values())
        return n + (0 if self.polyhedra is None else int(self.polyhedra[1].max(initial=-1)) + 1)

    def kind_in_file(self, kind: str) -> str:
        """Name of a kind of cells in its file, which may be two-dimensional."""
        return {"wedge": "triangle", "hexahedron": "quad"}.get(kind, kind) if self.n_copies == 2 else kind

    @property
    def cell_counts(self) -> dict[str, int]:
        """Number of cells of each kind; in a two-dimensional file by their names there."""
        found = {self.kind_in_file(kind): len(corners) for kind, corners in self.cells.items() if len(corners)}
        n_polyhedra = self.n_cells - sum(found.values())
        return {**found, **({"polyhedron": n_polyhedra} if n_polyhedra else {})}

    def cell_name(self, cell: int) -> str:
        """Kind of a cell, and its number among the cells of this kind, from 1."""
        for kind, n in self.cell_counts.items():
            if cell < n:
                return f"{kind} {cell + 1:,}"
            cell -= n
        raise IndexError(cell)

    @cached_property
    def cell_faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Faces of all cells, shape (n, 4), around their outward normals, and their cells, shape (n,).

        Programs disagree about the orientation of a wedge: faces are turned if most cells of a kind have negative
        volumes otherwise.
        """
        kind = np.int32 if max(self.n_points, self.n_cells) < 2**31 else np.int64
        counts = {name: len(corners) * len(FACES[name]) for name, corners in self.cells.items()}
        n_faces = sum(counts.values()) + (0 if self.polyhedra is None else len(self.polyhedra[0]))
        faces, cells = np.empty((n_faces, 4), dtype=kind), np.empty(n_faces, dtype=kind)
        begin = first = 0
        for name, corners in self.cells.items():
            end, last = begin + counts[name], first + len(corners)
            write_faces(self.points, corners, np.array(FACES[name]), faces[begin:end])
            cells[begin:end].reshape(-1, len(FACES[name]))[:] = np.arange(first, last, dtype=kind)[:, None]
            begin, first = end, last
        if self.polyhedra is not None and len(self.polyhedra[0]):
            of_polyhedra, numbers = (part.astype(kind) for part in self.polyhedra)
            n = int(numbers.max()) + 1
            volumes = np.bincount(numbers, Pyramids.of(self.points, of_polyhedra, numbers, n).volumes, n)
            is_turned = np.count_nonzero(volumes < 0.0) > 0.5 * n
            faces[begin:], cells[begin:] = of_polyhedra[:, ::-1] if is_turned else of_polyhedra, numbers + first
        return faces, cells

    @cached_property
    def sides(self) -> tuple[np.ndarray | None, np.ndarray]:
        """Side of a cell to which each face belongs, ascending, None if all are whole; and the cells of sides."""
        _, cells = self.cell_faces
        if self.polygons is None:
            return None, cells
        is_first, begin = np.ones(len(cells), dtype=bool), len(cells) - len(self.polygons)
        is_first[begin + 1 :] = (np.diff(cells[begin:]) != 0) | (np.diff(self.polygons) != 0)
        return (None, cells) if is_first.all() else (np.cumsum(is_first) - 1, cells[is_first])

    def pyramids(self, points: np.ndarray | None = None) -> Pyramids:
        """Pyramids to the sides of all cells, with other nodes if given, shape (n, 3)."""
        x, (faces, cells) = self.points if points is None else points, self.cell_faces
        return Pyramids.of(x, faces, cells, self.n_cells, self.sides[0])

    @cached_property
    def skin(self) -> np.ndarray:
        """Faces that belong to one cell only, around the outward normal, shape (n, 4)."""
        faces, _ = self.cell_faces
        keys = face_keys(faces, self.n_points)
        _, first, counts = np.unique(keys, return_index=True, return_counts=True)
        return faces[np.sort(first[counts == 1])]

    def into_fluid(self, faces: np.ndarray) -> np.ndarray:
        """Turn faces of the boundary so that they run around the normal into the mesh.

        Parameters
        ----------
        faces : ndarray of int, shape (n, 4)
            Faces of cells, in any direction.

        Returns
        -------
        ndarray of int, shape (m, 4)
            The faces that belong to one cell only.
        """
        of_cells, _ = self.cell_faces
        is_of_wall = np.zeros(self.n_points, dtype=bool)
        is_of_wall[faces] = True
        near = of_cells[faces_on(of_cells, is_of_wall)]
        keys, first, counts = np.unique(face_keys(near, self.n_points), return_index=True, return_counts=True)
        wanted = np.isin(keys, face_keys(faces, self.n_points)) & (counts == 1)
        return near[np.sort(first[wanted])][:, ::-1]

    def quality(self, points: np.ndarray | None = None) -> CellQuality:
        """Measure its cells, with other nodes if given, shape (n, 3)."""
        return quality_of(self.pyramids(points))


def quality_of(pyramids: Pyramids) -> CellQuality:
    """Volumes of cells, and which cells are inverted, by their pyramids."""
    volumes, least = pyramids.of_cells.T
    return CellQuality(volumes, np.minimum(volumes, least) <= 0.0)


def face_keys(faces: np.ndarray, n_points: int) -> np.ndarray:
    """Numbers of faces, equal for the same corners in any order: shape (n,)."""
    ids = np.sort(faces, axis=1).astype(np.int64)
    is_triangle = (ids[:, 1:] == ids[:, :-1]).any(axis=1)
    first = np.argmax(ids[:, 1:] == ids[:, :-1], axis=1)
    ids[is_triangle] = np.sort(np.where(np.arange(4) == first[is_triangle, None], n_points, ids[is_triangle]), axis=1)
    if n_points < 2**21 - 1:  # three corners identify a face, and fit into one number
        return (ids[:, 0] * (n_points + 1) + ids[:, 1]) * (n_points + 1) + ids[:, 2]
    return ids[:, :3].astype(np.uint64) @ np.array(MIXERS, dtype=np.uint64)


def first_heights(
    mesh: MixedMesh,
    wall: np.ndarray,  # int (n_faces, 4), faces of the wall, around the normal into the mesh
    ids: np.ndarray,  # int (n_wall,), nodes of the wall, ascending
) -> tuple[np.ndarray, np.ndarray]:
    """Find the next node of each node of a wall, along the edge most normal to the wall."""
    # returns at int (m,): wall nodes that have one, as numbers among `ids`; nodes on the edge of a plate without
    # thickness, where the wall has no normal, have none
    # returns beside int (m,): their next nodes
    is_wall = np.zeros(mesh.n_points, dtype=bool)
    is_wall[ids] = True
    faces, _ = mesh.cell_faces
    faces = faces[faces_at(faces, is_wall)]
    edges = np.concatenate([faces[:, [k, (k + 1) % 4]] for k in range(4)])
    edges = np.concatenate([edges, edges[:, ::-1]])
    edges = np.unique(edges[is_wall[edges[:, 0]] & ~is_wall[edges[:, 1]]], axis=0)
    at = np.searchsorted(ids, edges[:, 0])
    off = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    cosines = np.einsum("ed,ed->e", off, _wall_normals(mesh.points, wall, ids)[at])
    cosines /= np.maximum(np.linalg.norm(off, axis=1), np.finfo(float).tiny)
    order = np.lexsort((-cosines, at))
    order = order[cosines[order] > UPRIGHT]
    at, first = np.unique(at[order], return_index=True)
    return at, edges[order[first], 1]


def faces_around(ids: np.ndarray, faces: np.ndarray) -> csr_array:
    """Matrix (n, n_faces) with one for each face around each node; a repeated corner of a triangle counts once."""
    places = np.stack([np.searchsorted(ids, faces).ravel(), np.repeat(np.arange(len(faces)), 4)], axis=1)
    rows, columns = np.unique(places, axis=0).T
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(ids), len(faces)))


def _wall_normals(points: np.ndarray, wall: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Unit normals of a wall at its nodes, shape (n_wall, 3), zero if there is none, see `first_heights`."""
    areas = area_vectors(points[wall])
    sums = faces_around(ids, wall) @ np.column_stack([areas, np.linalg.norm(areas, axis=1)])
    lengths = np.linalg.norm(sums[:, :3], axis=1)
    return sums[:, :3] / np.where(lengths > CANCELLED * sums[:, 3], lengths, np.inf)[:, None]
