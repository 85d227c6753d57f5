"""Grids of curved hexahedra from a fitted model.

Corners of the elements are the nodes of a member of the grid's family. The nodes inside edges, faces and elements are
taken from a member of that member, so they follow its stretching. Theory: ``docs/theory/high_order.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...grids.cells.curved_grid import CurvedGrid, CurvedPatch
from ...grids.topology.index_space import Window
from ...grids.topology.sharing import node_sharing
from ...grids.topology.topology import Topology
from .fitted_model import FittedModel

__all__ = ["DEGREES", "curved_grid"]

DEGREES = range(1, 5)
"""Degrees of elements that the file formats support."""

UNNAMED = "boundary"
"""Name of boundary faces that no patch covers."""


def curved_grid(
    model: FittedModel, degree: int, factor: float = 1.0, control_points: np.ndarray | None = None
) -> CurvedGrid:
    """Grid of curved hexahedra whose sides follow the B-spline volumes.

    Parameters
    ----------
    model : FittedModel
        The model.
    degree : int
        Degree of the elements, 1 to 4: 8, 27, 64 or 125 nodes.
    factor : float
        Elements per direction, divided by the cells of the grid; below 1 for fewer elements than the grid has cells.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points (m); the fitted ones by default.

    Returns
    -------
    CurvedGrid
        Shared nodes occur once, also across blocks and where edges have collapsed.

    Raises
    ------
    InputError
        If degree or factor cannot be used, the grid is flat or has blanked nodes, or an element has no volume.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import curved_grid
    >>> model = fit_grid(brick_grid((9, 9, 9, 9)))
    >>> grid = curved_grid(model, degree=2, factor=0.5)
    >>> grid.elements.shape, bool((grid.worst_jacobians() > 0).all())
    ((384, 3, 3, 3), True)
    """
    source = model.header.source
    if isinstance(degree, bool) or degree not in DEGREES:
        raise InputError(f"{source}: degree {degree!r} of elements; give {DEGREES[0]} to {DEGREES[-1]}")
    if any(1 in shape for shape in model.topology.shapes):
        raise InputError(f"{source}: a block is one node thick; curved hexahedra need cells in all three directions")
    if any(iblank is not None and (iblank == 0).any() for iblank in model.header.iblanks):
        raise InputError(f"{source}: has blanked nodes, which files of elements cannot mark; give a grid without")
    member = model.member(factor).member(int(degree))
    topology = member.topology
    rows, ids = node_sharing(topology).rows, topology.node_ids()
    vector = member.regenerate(control_points).to_vector().reshape(-1, 3)
    nodes = np.empty((1 + max(int(part.max()) for part in ids), 3))
    for part, numbers in zip(rows, ids):
        nodes[numbers] = vector[part]
    whole = _ids_of_blocks(topology, ids)
    is_left = [_is_left_handed(nodes, numbers, degree) for numbers in whole]
    elements = [_elements(numbers, degree, left) for numbers, left in zip(whole, is_left)]
    places = [_places(block, numbers.shape, degree) for block, numbers in enumerate(whole)]
    patches = _patches(topology, whole, is_left, degree)
    return CurvedGrid(int(degree), nodes, np.concatenate(elements), patches, np.concatenate(places), source)


def _ids_of_blocks(topology: Topology, ids: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Numbers of the nodes of every block."""
    whole = [np.empty(shape, dtype=np.int64) for shape in topology.shapes]
    for segment, numbers in zip(topology.segments, ids):
        whole[segment.block][segment.slices] = numbers
    return whole


def _pieces(numbers: np.ndarray, degree: int) -> np.ndarray:
    """Lattices of all elements of a block, or of a face of one: shape (E0, E1, ..., d + 1, d + 1, ...)."""
    n_dimensions = numbers.ndim
    windows = np.lib.stride_tricks.sliding_window_view(numbers, (degree + 1,) * n_dimensions)
    return windows[(slice(None, None, degree),) * n_dimensions]


def _is_left_handed(nodes: np.ndarray, numbers: np.ndarray, degree: int) -> bool:
    """Whether most elements of a block are left-handed, by the volumes that the edges from their centres span."""
    corners = nodes[_pieces(numbers, degree)[..., ::degree, ::degree, ::degree]].reshape(-1, 2, 2, 2, 3)
    edges = [np.diff(corners, axis=1 + d).mean(axis=(1, 2, 3)) for d in range(3)]
    return bool((np.einsum("nx,nx->n", edges[0], np.cross(edges[1], edges[2])) < 0.0).mean() > 0.5)


def _elements(numbers: np.ndarray, degree: int, is_left: bool) -> np.ndarray:
    """Right-handed lattices of the elements of a block, shape (n, d + 1, d + 1, d + 1)."""
    elements = _pieces(numbers, degree).reshape(-1, *(degree + 1,) * 3)
    return elements[:, ::-1] if is_left else elements


def _places(block: int, shape: tuple[int, ...], degree: int) -> np.ndarray:
    """Block and cell of every element of a block, shape (n, 4)."""
    cells = np.indices([(n - 1) // degree for n in shape]).reshape(3, -1).T
    return np.column_stack([np.full(len(cells), block), cells])


def _patches(
    topology: Topology, whole: Sequence[np.ndarray], is_left: Sequence[bool], degree: int
) -> tuple[CurvedPatch, ...]:
    """Boundary faces by the names of their patches, in order of appearance, without collapsed ones."""
    kinds: dict[str, str] = {}
    faces: dict[str, list[np.ndarray]] = {}
    for face in topology.boundary:
        name, block = face.patch or UNNAMED, face.window.block
        kinds.setdefault(name, face.kind or "other")
        pieces = _faces(whole[block], face.window, is_left[block], degree)
        corners = np.sort(pieces[:, ::degree, ::degree].reshape(-1, 4), axis=1)
        is_surface = (np.diff(corners, axis=1) > 0).sum(axis=1) >= 2
        faces.setdefault(name, []).append(pieces[is_surface])
    return tuple(CurvedPatch(name, kinds[name], np.concatenate(parts)) for name, parts in faces.items())


def _faces(numbers: np.ndarray, window: Window, is_left: bool, degree: int) -> np.ndarray:
    """Lattices of the element faces on a window, turned outwards, shape (n, d + 1, d + 1)."""
    d = next(m for m in range(3) if window.lo[m] == window.hi[m])
    pieces = _pieces(np.squeeze(numbers[window.slices], axis=d), degree).reshape(-1, degree + 1, degree + 1)
    is_inwards = (window.lo[d] == 0) ^ (d == 1) ^ is_left
    return pieces.transpose(0, 2, 1) if is_inwards else pieces
