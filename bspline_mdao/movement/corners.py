"""Displacement of block corners that nothing prescribes: a network of springs along the edges of the blocks."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..mesh.moving_mesh import MovingMesh
from ..sparse.spring_network import SpringNetwork
from ..topology.index_space import sections_of, whole_slices

__all__ = ["free_corners"]


def free_corners(mesh: MovingMesh) -> SpringNetwork:
    """Connect the corners along the edges of all blocks by springs, as stiff as the edges are short on the baseline.

    Parameters
    ----------
    mesh : MovingMesh
        The blocks.

    Returns
    -------
    SpringNetwork
        Its given points are those of the surface.
    """
    lengths = {}
    for ids in mesh.blocks:
        for section in sections_of(ids.shape, n_free=1):
            edge = ids[whole_slices(section)].ravel()
            ends = (int(min(edge[0], edge[-1])), int(max(edge[0], edge[-1])))
            if ends[0] != ends[1]:  # neither collapsed nor closed
                lengths[ends] = np.linalg.norm(np.diff(mesh.points[edge], axis=0), axis=1).sum()
    return SpringNetwork.of(
        mesh.n_points, lengths, mesh.surface_ids, mesh.fixed_ids, lambda ids: _directions(mesh, ids)
    )


def _directions(mesh: MovingMesh, ids: np.ndarray) -> sparse.csr_array:
    """Directions in which points may move as orthonormal columns, shape (3 n, n_free)."""
    frames = np.broadcast_to(np.eye(3), (len(ids), 3, 3)) if mesh.frames is None else mesh.frames[ids]
    blocks = sparse.block_diag(list(frames.transpose(0, 2, 1)), format="csc") if len(ids) else sparse.csc_array((0, 0))
    return sparse.csr_array(blocks[:, np.flatnonzero(mesh.is_free[ids])])
