"""Meshes that the tests of point inversion share."""

import numpy as np
from splines_cases import random_bilinear_knots, random_inner_knots

from bspline_mdao.core.splines.knots import BilinearKnots
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.splines.volume import Volume, evaluate


def row_of_volumes(rng, orders=(4, 3, 5), n_inner=(3, 4, 2), n_volumes=3, spacing=None):
    """Volumes in a row along x, with curved knots that agree on the interfaces.

    With `spacing` the spans in zeta grow from that size at z = 0 to the other end, as in a boundary layer.
    """
    eta = [_edge_knots(rng, orders[1], n_inner[1]) for _ in range(n_volumes + 1)]
    zeta = [_edge_knots(rng, orders[2], n_inner[2], spacing) for _ in range(n_volumes + 1)]
    volumes = [
        Volume(
            (
                random_bilinear_knots(rng, orders[0], n_inner[0] + v),
                BilinearKnots(np.stack([eta[v], eta[v + 1]], axis=1), orders[1]),
                BilinearKnots(np.stack([zeta[v], zeta[v + 1]], axis=0), orders[2]),
            )
        )
        for v in range(n_volumes)
    ]
    return _share_faces(volumes, np.mean(zeta, axis=(0, 1)))


def _edge_knots(rng, order, n_inner, spacing=None):
    """Knots on two parallel edges, shape (2, N + p)."""
    inner = random_inner_knots(rng, n_inner, (2,))
    if spacing is not None:
        inner = spacing ** (1 - inner)
    return np.concatenate([np.zeros((2, order)), inner, np.ones((2, order))], axis=-1)


def _share_faces(volumes, zeta_knots):
    """Number the control points of volumes in a row, and place them evenly, in z by the Greville abscissae."""
    ids, points, first = [], [], 0
    for v, volume in enumerate(volumes):
        n0, n1, n2 = volume.n_control
        start = int(v > 0)
        new = np.arange(first, first + (n0 - start) * n1 * n2).reshape(n0 - start, n1, n2)
        ids.append(np.concatenate([ids[-1][-1:], new]) if start else new)
        x, y = np.linspace(v, v + 1, n0)[start:], np.linspace(0, 1, n1)
        z = np.array([zeta_knots[i + 1 : i + volume.orders[2]].mean() for i in range(n2)])
        points.append(np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3))
        first += new.size
    return BSplineMesh(tuple(volumes), tuple(ids), first), warp(np.concatenate(points))


def warp(points):
    x, y, z = points.T
    return np.stack(
        [x + 0.1 * np.sin(2 * y + z), y + 0.1 * np.sin(2 * x) + 0.1 * z, z + 0.1 * np.sin(2 * x * y)], axis=1
    )


def sector(rng, angle=1.5 * np.pi, shear=0.0):
    """A sector of a cylinder whose face xi = 0 is collapsed onto the axis; the full cylinder is closed by a seam.

    As in a fitted mesh, knots agree wherever the same line is an edge twice: at the axis, and at the seam. With `shear`
    those along the axis differ by that part of a span, so that no column of the Jacobian vanishes there.
    """
    xi, eta, zeta = (random_bilinear_knots(rng, order, n).corners.copy() for order, n in ((4, 3), (4, 5), (3, 4)))
    zeta[0, 1] = zeta[0, 0]
    zeta[0, 1, 3:-3] += shear * np.diff(zeta[0, 0])[2:-3]
    if angle == 2 * np.pi:
        xi[1], zeta[:, 1] = xi[0], zeta[:, 0]
    volume = Volume((BilinearKnots(xi, 4), BilinearKnots(eta, 4), BilinearKnots(zeta, 3)))
    n0, n1, n2 = volume.n_control
    r, theta, z = np.meshgrid(np.linspace(0, 1, n0), np.linspace(0, angle, n1), np.linspace(0, 2, n2), indexing="ij")
    net = np.stack([r * np.cos(theta), r * np.sin(theta), z + 0.2 * r], axis=-1)
    return single(volume, net)


def single(volume, net):
    """A mesh of one volume that shares nothing, and its control points."""
    ids = np.arange(np.prod(volume.n_control)).reshape(volume.n_control)
    return BSplineMesh((volume,), (ids,), ids.size), net.reshape(-1, 3)


def sample(mesh, control_points, parameters):
    """Points of all volumes at the same parameters, one volume after the other."""
    nets = mesh.nets(control_points)
    return np.concatenate([evaluate(v, net, parameters) for v, net in zip(mesh.volumes, nets)])
