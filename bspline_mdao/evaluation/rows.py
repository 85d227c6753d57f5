"""Which volume writes which row of the result of an `Evaluator`: the checks of what it is built from."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..splines.mesh import BSplineMesh

__all__ = ["check_rows", "copies_by_volume"]


def check_rows(mesh: BSplineMesh, parameters, rows, n_rows: int, copies) -> bool:
    """Check the arguments of `Evaluator.build`; return whether every row belongs to a node.

    Raises
    ------
    InputError
        If they do not fit together, a row is given twice, or a parameter is not finite.
    """
    if not len(mesh.volumes) == len(parameters) == len(rows):
        raise InputError(
            f"evaluation: {len(mesh.volumes)} volumes, parameters for {len(parameters)} and rows for {len(rows)}; "
            f"give one array of each per volume"
        )
    for v, (p, r) in enumerate(zip(parameters, rows), start=1):
        if p.shape != (r.size, 3) or r.ndim != 1:
            raise InputError(
                f"evaluation: volume {v} has parameters of shape {p.shape} and rows of shape {r.shape}; "
                f"give shapes (n, 3) and (n,)"
            )
        if not np.isfinite(p).all():
            q = int(np.argmin(np.isfinite(p).all(axis=1)))
            raise InputError(f"evaluation: parameters of point {q + 1} of volume {v} are not finite; give numbers")
    if copies.ndim != 2 or copies.shape[1] != 2:
        raise InputError(f"evaluation: copies of shape {copies.shape}; give shape (n, 2)")
    return _check_destinations(np.concatenate([*rows, copies[:, 0]]), n_rows)


def _check_destinations(destinations, n_rows: int) -> bool:
    """Check that every row is written once at most; return whether every row is written."""
    if n_rows >= 2**32:
        raise InputError(f"evaluation: {n_rows} rows; split the grid into pieces of fewer than {2**32}")
    if destinations.size and not 0 <= destinations.min() <= destinations.max() < n_rows:
        raise InputError(f"evaluation: a row lies outside 0 .. {n_rows - 1}; number the rows from 0")
    count = np.bincount(destinations, minlength=n_rows)
    if n_rows and count.max() > 1:
        raise InputError(f"evaluation: row {int(count.argmax()) + 1} is given twice; evaluate each row once")
    return bool(count.all())


def copies_by_volume(rows, n_rows: int, copies) -> list[np.ndarray]:
    """Per volume, the row of each copy and the number of the node that it copies, shape (n, 2).

    Raises
    ------
    InputError
        If a row that is copied belongs to no node.
    """
    starts = np.cumsum([0] + [r.size for r in rows])
    node_of_row = np.full(n_rows, -1, dtype=np.int64)
    for start, r in zip(starts, rows):
        node_of_row[r] = start + np.arange(r.size)
    is_inside = (copies[:, 1] >= 0) & (copies[:, 1] < n_rows)
    nodes = np.where(is_inside, node_of_row[np.where(is_inside, copies[:, 1], 0)] if n_rows else -1, -1)
    if (nodes < 0).any():
        bad = copies[np.argmin(nodes)]
        raise InputError(f"evaluation: row {bad[0] + 1} copies row {bad[1] + 1}, which no volume evaluates")
    volume = np.searchsorted(starts, nodes, side="right") - 1
    return [np.stack([copies[volume == v, 0], nodes[volume == v] - starts[v]], axis=1) for v in range(len(rows))]
