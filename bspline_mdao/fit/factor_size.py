"""Numbers of control points that a mover can take, from the memory of its factor.

Linear elasticity factors a matrix of all control points in every increment, and keeps the factors where derivatives are
asked for. That memory grows faster than the number of control points, and is known before there is a fit: from the
topology and the numbers of control points alone, by the symbolic analysis of `bspline_mdao.sparse`.
"""

from __future__ import annotations

import numpy as np

from ..mesh.boundary import boundary_points
from ..mesh.moving_mesh import MovingMesh
from ..movement.equilibrium import Unknowns
from ..sparse.cholesky import Cholesky
from ..topology.topology import Topology, shared_ids
from .control_counts import NODES_PER_SPAN, ControlCounts, choose_counts

LARGEST_FACTOR = 2**30
"""Bytes of one factor that numbers of control points chosen from the grid lead to; five increments keep five."""

SMALL_MESH = 10_000
"""Control points below which a factor is not predicted: it takes less than 0.2 GB."""

_GROWTH = 4.2
"""Power of the spans per direction with which a factor grows, about."""

_MOST_CELLS = 64
"""Cells along a span beyond which numbers do not fall any more."""


def choose_affordable_counts(topology: Topology, n_control=None, order=None) -> tuple[ControlCounts, int | None]:
    """Numbers of control points and orders, and the memory of a factor of the mover's matrix.

    Parameters
    ----------
    topology : Topology
        Segments and their links.
    n_control, order
        See `bspline_mdao.fit.control_counts.choose_counts`. Where numbers are not given, spans are widened until a
        factor takes no more than `LARGEST_FACTOR`.

    Returns
    -------
    counts : ControlCounts
    factor_bytes : int or None
        See `predict_factor_bytes`.

    Raises
    ------
    InputError
        As `choose_counts`.
    """
    cells = NODES_PER_SPAN
    counts = choose_counts(topology, n_control, order)
    n_bytes = predict_factor_bytes(topology, counts.n_control)
    while n_control is None and (n_bytes or 0) > LARGEST_FACTOR and cells < _MOST_CELLS:
        cells *= 1.01 * (n_bytes / LARGEST_FACTOR) ** (1 / _GROWTH)
        counts = choose_counts(topology, None, order, cells)
        n_bytes = predict_factor_bytes(topology, counts.n_control)
    return counts, n_bytes


def predict_factor_bytes(topology: Topology, n_control: np.ndarray) -> int | None:
    """Memory of one factor of the matrix with which linear elasticity moves a control mesh.

    Parameters
    ----------
    topology : Topology
        Segments, links and boundary. All of it is taken as known or held, but for planes of symmetry.
    n_control : ndarray of int, shape (n_segments, 3)
        Control points of every segment.

    Returns
    -------
    int or None
        Bytes; None for fewer than `SMALL_MESH` control points, and for planar grids, which do not move.
    """
    shapes = [tuple(map(int, shape)) for shape in n_control]
    ids = tuple(shared_ids(shapes, topology.links, topology.collapses, topology.segment_names))
    n_points = 1 + max(int(block.max()) for block in ids)
    if n_points < SMALL_MESH or np.min(n_control) == 1:
        return None
    is_free = np.ones((n_points, 3), dtype=bool)
    for face, points in boundary_points(topology, ids):
        is_free[points] &= face.kind == "symmetry"
    nowhere = np.zeros((n_points, 3))
    mesh = MovingMesh(ids, topology.segment_names, nowhere, np.zeros(0, dtype=np.int32), is_free)
    unknowns = Unknowns(mesh)
    return Cholesky().analyze(unknowns.pattern, nowhere[unknowns.point_ids]).factor_bytes
