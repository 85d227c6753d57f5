"""Which elements of B-spline volumes are valid: their maps have a positive Jacobian everywhere between their knots.

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.numerics.threads import run_tasks, thread_count
from ...grids.cells.bernstein import UNDECIDED
from ...grids.cells.certificate import BlockCertificate, of_statuses
from ...grids.cells.hexahedron import COLLAPSE_TOLERANCE, cell_quality, flat_direction, mean_normal
from ..splines.knots import BilinearKnots, ConstantKnots, Knots
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from .spline_bounds import decide_elements

__all__ = ["certify_splines", "spline_statuses"]


def certify_splines(
    mesh: BSplineMesh,  # the volumes
    control_points: np.ndarray,  # (n_control_points, 3), control points (m)
    names: Sequence[str],  # names of the volumes
    # control points that determine handedness; the same by default
    baseline: np.ndarray | None = None,  # (n_control_points, 3)
    what: str = "spline element",  # what an element is called
) -> tuple[BlockCertificate, ...]:  # one for each volume with control points in two directions
    """Prove which elements of the volumes of a mesh are valid."""
    places = [n for n, volume in enumerate(mesh.volumes) if sum(count > 1 for count in volume.n_control) > 1]
    before = control_points if baseline is None else baseline

    def statuses(place: int) -> np.ndarray:
        volume, ids = mesh.volumes[place], mesh.control_ids[place]
        return spline_statuses(volume, control_points[ids], cell_quality(before[ids]).handedness)

    found = run_tasks(statuses, places, thread_count(None))
    return tuple(of_statuses(names[place], what, status) for place, status in zip(places, found))


def spline_statuses(
    volume: Volume,  # orders and knots; nothing can be proved if knots are functions of the user's own
    control_points: np.ndarray,  # (N0, N1, N2, 3), control points (m)
    handedness: int,  # +1 or -1
) -> np.ndarray:
    """Statuses of the elements of a volume, the regions between knots."""
    # returns uint8 (N0 - p0 + 1, N1 - p1 + 1, N2 - p2 + 1), `bspline_mdao.grids.cells.bernstein.VALID`, ``UNDECIDED``
    # or ``INVALID``
    orders, net = volume.orders, np.ascontiguousarray(control_points, dtype=float)
    shape = tuple(n - p + 1 for n, p in zip(volume.n_control, orders))
    edges = [edge for edge in map(_on_edges, volume.knots) if edge is not None]
    if len(edges) < 3:
        return np.full(shape, UNDECIDED, dtype=np.uint8)
    flat = flat_direction(net.shape)
    normal = np.zeros(3) if flat is None else mean_normal(np.moveaxis(net, flat, 2)[:, :, 0])
    size = float(np.linalg.norm(np.ptp(net.reshape(-1, 3), axis=0)))
    return decide_elements(tuple(edges), orders, net, float(handedness), normal, COLLAPSE_TOLERANCE * size)[0]


def _on_edges(knots: Knots) -> np.ndarray | None:
    """Knots on the four edges, shape (2, 2, N + p); None if they are functions of the user's own."""
    if isinstance(knots, ConstantKnots):
        return np.ascontiguousarray(np.broadcast_to(knots.knots, (2, 2, knots.knots.size)))
    return np.ascontiguousarray(knots.corners) if isinstance(knots, BilinearKnots) else None
