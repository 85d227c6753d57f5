"""A wall on the baseline: its triangles, how the layer above it turns, and its reach, up to which points follow it.

The reach is a few times the width of the wall's quads. Grids whose cells at the wall are as high as wide need no layer,
and have none.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ...errors import InputError
from .closest_points import TriangleTree
from .closest_search import fade
from .frames import WallFrames
from .settings import LAYER, LayerSettings

__all__ = ["Wall"]


@dataclass(frozen=True, eq=False)
class Wall:
    """A wall on the baseline. Made by `Wall.of`."""

    tree: TriangleTree  # its triangles and its reach
    frames: WallFrames  # how the layer above it turns

    @classmethod
    def of(
        cls,
        points: np.ndarray,  # (n, 3), its nodes on the baseline (m), each once
        quads: np.ndarray,  # (n_quads, 4) of int, corners of its quads in order, around the normal into the fluid
        heights: np.ndarray,  # (n,), heights of the first cells at the nodes (m); 0 if there is none
        # sequence of (ndarray of int, ndarray of shape (3,)), nodes in planes that they must stay in, and the planes'
        # normals: their rotation keeps the plane
        planes: Sequence[tuple[np.ndarray, np.ndarray]] = (),
        fixed: np.ndarray | None = None,  # of int, nodes that never turn, such as nodes on a fixed boundary
        # (n_quads,) of int, face that each quad belongs to; heights are kept above each face separately if several meet
        # in a node
        faces: np.ndarray | None = None,
        n_threads: int | None = None,  # number of threads; by default ``NUMBA_NUM_THREADS``
        settings: LayerSettings = LAYER,
    ) -> Wall:
        """Sort the triangles of a wall, and find its reach and the neighbours of its nodes."""
        points = np.ascontiguousarray(points, dtype=float)
        frames = WallFrames.of(points, quads, planes, fixed, faces, n_threads, settings)
        heights = np.asarray(heights, dtype=float)
        if heights.shape != (len(points),):
            raise InputError(f"wall layer: heights of shape {heights.shape}; give shape ({len(points)},)")
        reach = _reach(points, np.asarray(quads), heights, settings)
        return cls(TriangleTree.of(points, np.asarray(quads), reach, settings.farthest), frames)

    @property
    def n_points(self) -> int:
        """Number of nodes."""
        return len(self.tree.points)


def _reach(points: np.ndarray, quads: np.ndarray, heights: np.ndarray, settings: LayerSettings) -> np.ndarray:
    """Distance up to which points follow a wall, at its nodes, shape (n,)."""
    x = points[quads]
    diagonals = x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]
    area = 0.5 * np.linalg.norm(np.cross(*diagonals), axis=1)
    longest = np.max([np.linalg.norm(d, axis=1) for d in diagonals], axis=0)
    width = np.divide(area, longest, out=np.zeros(len(quads)), where=longest > 0.0)
    ends = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    around = _mean_of(quads.ravel(), np.repeat(np.arange(len(quads)), 4), len(points), len(quads))
    adjacent = _mean_of(ends.ravel(), ends[:, ::-1].ravel(), len(points), len(points))
    spacing = around @ width
    reach = np.maximum(spacing, np.minimum(settings.first_heights * heights, settings.widths * spacing))
    for _ in range(settings.smoothings):
        reach = 0.5 * (reach + adjacent @ reach)
    return reach * _viscosity(spacing, heights, settings)


def _viscosity(spacing: np.ndarray, heights: np.ndarray, settings: LayerSettings) -> float:
    """Fraction of its reach that a wall has: if cells are as high as wide, a layer is useless and costs quality."""
    has_height = heights > 0.0
    if not has_height.any():
        return 0.0
    flatness = np.quantile(spacing[has_height] / heights[has_height], 0.75)
    least = settings.inviscid
    return 1.0 - fade(np.log(max(flatness, 1.0) / least) / np.log(settings.viscous / least))


def _mean_of(rows: np.ndarray, columns: np.ndarray, n_rows: int, n_columns: int) -> csr_array:
    """Matrix of the means of the values at the columns that go with each row."""
    sums = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n_rows, n_columns)).tocsr()
    return diags_array(1.0 / np.maximum(sums @ np.ones(n_columns), 1.0)) @ sums
