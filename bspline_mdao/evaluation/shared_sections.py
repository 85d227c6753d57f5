"""Which faces, edges and corners of the volumes of a mesh belong to other volumes as well."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.sparse import csr_array

from ..splines.mesh import BSplineMesh

__all__ = ["section_codes", "shared_with_lower"]

ON_FACE = 1e-6
"""Parameters this close to 0 or 1 count as on the face: more than round-off, so that no shared point is missed."""

_SECTIONS = tuple(itertools.product((slice(None), slice(0, 1), slice(-1, None)), repeat=3))


def section_codes(parameters: np.ndarray) -> np.ndarray:
    """Find the section of a volume that each point lies on: 0 inside, else a face, an edge or a corner.

    Parameters
    ----------
    parameters : ndarray, shape (n, 3)
        Parameters of points of any volume.

    Returns
    -------
    ndarray of int, shape (n,)
        ``9 a + 3 b + c``, where a, b and c are 0 inside, 1 at the low and 2 at the high end of xi, eta and zeta.
    """
    ends = (parameters <= ON_FACE) + 2 * (parameters >= 1 - ON_FACE)
    return ends @ np.array([9, 3, 1])


def shared_with_lower(mesh: BSplineMesh) -> np.ndarray:
    """Tell which sections of each volume have all their control points in a lower volume too.

    Returns
    -------
    ndarray of bool, shape (n_volumes, 27, n_volumes)
        Entry ``[w, code, v]``: whether the section of volume w lies in volume ``v < w``, see `section_codes`.
    """
    n = len(mesh.volumes)
    ids = np.concatenate([control_ids.ravel() for control_ids in mesh.control_ids])
    owners = np.repeat(np.arange(n), [control_ids.size for control_ids in mesh.control_ids])
    ownership = csr_array((np.ones(ids.size), (ids, owners)), shape=(mesh.n_control_points, n)) > 0
    is_shared = np.zeros((n, 27, n), dtype=bool)
    for w, control_ids in enumerate(mesh.control_ids):
        for code, section in enumerate(_SECTIONS):
            section_ids = control_ids[section].ravel()
            is_shared[w, code, :w] = ownership[section_ids].sum(axis=0)[:w] == section_ids.size
    return is_shared
