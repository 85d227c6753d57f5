"""The surface at the Greville abscissae of its control points, and the control points that interpolate there.

Control points do not lie on a curved surface. A displacement given as a function of places on the surface, such as a
bump at some fraction of the chord, is met where the surface is at the Greville abscissae of its control points: the
displacements of these solve a constant sparse system. Theory: ``docs/theory/parametrization.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csc_array, eye_array
from scipy.sparse.linalg import SuperLU, splu

from ...base.display import OneLine
from ...grids.topology.boundary_surface import quads_in_turn
from ..splines.volume import evaluate, evaluate_gradients, volume_basis
from .control_net import surface_normals, surface_quads
from .moving_mesh import MovingMesh

__all__ = ["GrevilleSurface"]

_BETWEEN = 16
"""Samples of the surface between neighbouring Greville abscissae, if it is not a straight line."""

_NEGLIGIBLE = 1e-13
"""Fraction of the largest displacement below which a displacement is round-off of the system."""


@dataclass(frozen=True, eq=False)
class GrevilleSurface(OneLine):
    """Points of the surface of a mesh on its baseline, one for each surface control point."""

    points: np.ndarray  # (n_surface, 3), the surface at the Greville abscissae of its control points (m)
    normals: np.ndarray  # (n_surface, 3), its normals there into the fluid, of any length
    matrix: csc_array  # (n_surface, n_surface), from control points to these points
    # many points of the surface (m), and quads between them; faces do not share points
    samples: np.ndarray  # (n_samples, 3)
    quads: np.ndarray  # int (n_quads, 4)

    @classmethod
    def of(cls, mesh: MovingMesh) -> GrevilleSurface:
        """Evaluate the surface of a control mesh; without splines it is the mesh's own points."""
        n, at_baseline = len(mesh.surface_ids), mesh.points[mesh.surface_ids]
        if mesh.volumes is None or mesh.parameters is None:
            return cls(at_baseline, surface_normals(mesh), eye_array(n, format="csc"), at_baseline, surface_quads(mesh))
        points, normals, is_done = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=bool)
        entries, samples, quads, n_samples = [], [], [], 0
        for block, side, rows in _faces(mesh):
            volume, net, axis = mesh.volumes[block], mesh.points[mesh.blocks[block]], side // 2
            places = np.take(mesh.parameters[block], -(side % 2), axis=axis)
            places[..., axis] = side % 2
            _, first = np.unique(rows, return_index=True)
            first = first[~is_done[rows.ravel()[first]]]
            here, at = rows.ravel()[first], places.reshape(-1, 3)[first]
            is_done[here] = True
            points[here] = evaluate(volume, net, at)
            normals[here] = _into_block(evaluate_gradients(volume, net, at), side)
            columns, weights = _weights(volume_basis(volume, at), volume.orders, rows, axis)
            entries.append((np.repeat(here, columns.shape[1]), columns.ravel(), weights.ravel()))
            orders = np.delete(volume.orders, axis)
            dense = _between(_between(places, orders[0]).swapaxes(0, 1), orders[1]).swapaxes(0, 1)
            samples.append(evaluate(volume, net, dense.reshape(-1, 3)))
            quads.append(quads_in_turn(n_samples + np.arange(len(samples[-1])).reshape(dense.shape[:2])))
            n_samples += len(samples[-1])
        owners, columns, weights = (np.concatenate(parts) for parts in zip(*entries))
        matrix = csc_array(coo_array((weights, (owners, columns)), shape=(n, n)))
        return cls(points, normals, matrix, np.concatenate(samples), np.concatenate(quads))

    def control(
        self,
        displacements: np.ndarray,  # (n_surface, m), of the surface at `points`
    ) -> np.ndarray:
        """Displacements of the control points, shape (n_surface, m), that give the surface these displacements."""
        found = self._factor.solve(np.ascontiguousarray(displacements, dtype=float))
        return np.where(np.abs(found) > _NEGLIGIBLE * np.abs(found).max(initial=0.0), found, 0.0)

    @cached_property
    def _factor(self) -> SuperLU:
        return splu(self.matrix)


def _faces(mesh: MovingMesh) -> Iterator[tuple[int, int, np.ndarray]]:
    """Block, side and rows of ``mesh.surface_ids`` (n0, n1) of every face of the surface that has an extent."""
    found = []
    for block, ids in enumerate(mesh.blocks):
        for side in range(6):
            rows = mesh.surface_rows[np.take(ids, -(side % 2), axis=side // 2)]
            if (rows >= 0).all() and not any((rows == rows.take([0], axis=d)).all() for d in range(2)):
                found.append((block, side, rows))
    keys = [tuple(np.unique(rows).tolist()) for _, _, rows in found]
    yield from (face for face, key in zip(found, keys) if keys.count(key) == 1)  # faces between two blocks occur twice


def _into_block(gradients: np.ndarray, side: int) -> np.ndarray:
    """Normals (n, 3) into the block, of derivatives (n, 3, 3) at one of its sides."""
    axis = side // 2
    first, second = np.delete(gradients, axis, axis=2).transpose(2, 0, 1)
    normals = np.cross(first, second)
    inwards = gradients[:, :, axis] * (1.0 - 2.0 * (side % 2))
    return normals * np.sign(np.sum(normals * inwards, axis=1))[:, None]


def _weights(
    found: tuple[np.ndarray, np.ndarray], orders: tuple[int, int, int], rows: np.ndarray, axis: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the control points that points of a face depend on, and their weights, each (n, p0 p1)."""
    firsts, values = found
    ends = np.cumsum(orders)
    a, b = (d for d in range(3) if d != axis)
    of_a, of_b = (values[:, ends[d] - orders[d] : ends[d]] for d in (a, b))
    weights = of_a[:, :, None] * of_b[:, None, :]
    numbers = [firsts[:, d, None] + np.arange(orders[d]) for d in (a, b)]
    columns = rows[numbers[0][:, :, None], numbers[1][:, None, :]]
    return columns.reshape(len(firsts), -1), weights.reshape(len(firsts), -1)


def _between(places: np.ndarray, order: int) -> np.ndarray:
    """Parameters (n0, n1, 3), refined in the first direction unless it is straight."""
    if order <= 2:
        return places
    at = np.arange((len(places) - 1) * _BETWEEN + 1) / _BETWEEN
    before = np.minimum(at.astype(int), len(places) - 2)
    part = (at - before)[:, None, None]
    return (1.0 - part) * places[before] + part * places[before + 1]
