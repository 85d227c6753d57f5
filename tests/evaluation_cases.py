"""B-spline meshes with random curved knots for the tests of evaluation."""

import numpy as np

from bspline_mdao.core.evaluation.evaluator import Evaluator
from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots, FunctionKnots
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.splines.volume import Volume

ORDERS = [(4, 4, 4), (2, 3, 4), (6, 5, 2), (1, 4, 4), (4, 1, 3), (3, 6, 1), (1, 1, 5), (2, 2, 2), (5, 4, 6), (4, 4, 1)]


def curved_knots(rng, n_control, order):
    """Random bilinear knots."""
    inner = np.sort(rng.uniform(0.05, 0.95, (2, 2, n_control - order)), axis=-1)
    ends = np.zeros((2, 2, order))
    return BilinearKnots(np.concatenate([ends, inner, ends + 1.0], axis=-1), order)


def random_volume(rng, orders, n_control):
    """Volume with random bilinear knots."""
    return Volume(tuple(curved_knots(rng, n, p) for n, p in zip(n_control, orders)))


def mixed_volume():
    """Volume with bilinear, constant and user-defined knots of unequal orders."""
    rng = np.random.default_rng(5)
    bend = FunctionKnots(
        order=3,
        n_control=4,
        value=lambda s, t: 0.5 + 0.2 * (s * t)[:, None],
        gradient=lambda s, t: 0.2 * np.stack([t, s], axis=-1)[:, None],
    )
    return Volume((curved_knots(rng, 6, 4), bend, ConstantKnots([0, 0, 0, 0.3, 0.3, 0.7, 1, 1, 1], 3)))


def random_parameters(rng, n, orders=(4, 4, 4)):
    """Parameters with the corners and many points on faces among them; 0 in degenerate directions."""
    parameters = rng.uniform(0, 1, (n, 3))
    at_end = rng.uniform(0, 1, (n, 3)) < 0.2
    parameters[at_end] = np.round(parameters[at_end])
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(-1, 3)[:n]
    parameters[: len(corners)] = corners
    return parameters * (np.array(orders) > 1)


def random_mesh(rng, orders, n_volumes=1, extra=3):
    """Volumes of the same orders and unequal sizes that share no control point."""
    volumes = [
        random_volume(rng, orders, [p + (0 if p == 1 else int(rng.integers(0, extra + 1))) for p in orders])
        for _ in range(n_volumes)
    ]
    sizes = [int(np.prod(volume.n_control)) for volume in volumes]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    ids = [start + np.arange(size).reshape(v.n_control) for start, size, v in zip(starts, sizes, volumes)]
    return BSplineMesh(tuple(volumes), tuple(ids), int(starts[-1]))


def cloud(rng, mesh, n, n_threads=None):
    """Evaluator of ``n`` points per volume in shuffled rows, some copied; with parameters, rows and copies."""
    parameters = [random_parameters(rng, n, volume.orders) for volume in mesh.volumes]
    n_nodes = n * len(mesh.volumes)
    n_copies = n // 4
    shuffled = rng.permutation(n_nodes + n_copies)
    rows = np.split(shuffled[:n_nodes], len(mesh.volumes))
    copies = np.stack([shuffled[n_nodes:], rng.choice(shuffled[:n_nodes], n_copies)], axis=1)
    evaluator = Evaluator.build(mesh, parameters, rows, n_nodes + n_copies, copies, n_threads)
    return evaluator, parameters, rows, copies
