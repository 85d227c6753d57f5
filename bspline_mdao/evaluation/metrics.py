"""Derivatives of the mapping in the parameters at many points: the grid metrics x_xi, x_eta, ..., of every volume.

They include the dependence of curved knots on the other parameters, Eq. (4). A node on an interface has the metrics of
its own volume, so that there is one result per volume and nothing is shared. At fixed parameters the metrics are linear
in the control points; `MappingGradients` is that linear map and its transpose. Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from ..errors import InputError
from ..numerics.threads import run_tasks, thread_count
from ..splines.mesh import BSplineMesh
from ..splines.volume import evaluate_gradients, volume_basis_gradients

CHUNK_NODES = 2**13
"""Nodes per chunk, at least."""

CHUNKS_PER_VOLUME = 16
"""Chunks per volume, at most: bounds the memory that the transpose needs."""

_SLICE = 1024  # points at a time, so that their basis functions stay in the cache


@dataclass(frozen=True, eq=False)
class MappingGradients:
    """The linear map from control points to the derivatives of the mapping at fixed parameters.

    Parameters
    ----------
    mesh : BSplineMesh
        Volumes and control point ids.
    parameters : sequence of ndarray, each of shape (n_v, 3)
        Parameters of the points of each volume.
    n_threads : int, optional
        Number of threads; None stands for ``NUMBA_NUM_THREADS``. Results do not depend on it.

    Raises
    ------
    InputError
        If the parameters do not fit the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.splines.knots import ConstantKnots
    >>> from bspline_mdao.splines.volume import Volume
    >>> line = Volume.of(ConstantKnots.uniform(n_control=2, order=2))
    >>> mesh = BSplineMesh((line,), (np.arange(2).reshape(2, 1, 1),), 2)
    >>> gradients = MappingGradients(mesh, [np.array([[0.5, 0.0, 0.0]])])
    >>> gradients.forward(np.array([[1.0, 0.0, 0.0], [4.0, 5.0, 0.0]]))[0][0, :, 0]
    array([3., 5., 0.])
    """

    mesh: BSplineMesh
    parameters: tuple[np.ndarray, ...]
    n_threads: int | None = None

    def __post_init__(self):
        parameters = tuple(np.ascontiguousarray(p, dtype=float) for p in self.parameters)
        object.__setattr__(self, "parameters", parameters)
        if len(parameters) != len(self.mesh.volumes):
            raise InputError(
                f"metrics: {len(self.mesh.volumes)} volumes and parameters for {len(parameters)}; give one array each"
            )
        for v, p in enumerate(parameters, start=1):
            if p.ndim != 2 or p.shape[1] != 3:
                raise InputError(f"metrics: parameters of volume {v} have shape {p.shape}; give shape (n, 3)")

    def forward(self, control_points: np.ndarray) -> list[np.ndarray]:
        """Evaluate the derivatives of the mapping.

        Parameters
        ----------
        control_points : ndarray of float, shape (n_control_points, 3)
            Control points.

        Returns
        -------
        list of ndarray, each of shape (n_v, 3, 3)
            Entry ``[q, d, m]`` is the derivative of coordinate d of point q in parameter m.
        """
        self._check(control_points, (self.mesh.n_control_points, 3), "control points")
        nets = [np.ascontiguousarray(net, dtype=float) for net in self.mesh.nets(control_points)]
        gradients = [np.empty((len(p), 3, 3)) for p in self.parameters]
        chunks = self._chunks()

        def differentiate(number: int):
            v, part = chunks[number]
            gradients[v][part] = evaluate_gradients(self.mesh.volumes[v], nets[v], self.parameters[v][part])

        run_tasks(differentiate, len(chunks), thread_count(self.n_threads))
        return gradients

    def adjoint(self, bars: Sequence[np.ndarray]) -> np.ndarray:
        """Transposed product: cotangents of the control points from those of the derivatives.

        Parameters
        ----------
        bars : sequence of ndarray of float, each of shape (n_v, 3, 3)
            One matrix per point.

        Returns
        -------
        ndarray, shape (n_control_points, 3)
        """
        for p, bar in zip(self.parameters, bars, strict=True):
            self._check(bar, (len(p), 3, 3), "derivatives")
        chunks = self._chunks()
        sums: list = [None] * len(chunks)

        def accumulate(number: int):
            v, part = chunks[number]
            volume = self.mesh.volumes[v]
            sums[number] = np.zeros((*volume.n_control, 3))
            for start in range(part.start, part.stop, _SLICE):
                points = slice(start, min(start + _SLICE, part.stop))
                basis = volume_basis_gradients(volume, self.parameters[v][points])
                bar = np.ascontiguousarray(bars[v][points], dtype=float)
                _add_gradients_transposed(sums[number], volume.orders, *basis, bar)

        run_tasks(accumulate, len(chunks), thread_count(self.n_threads))
        out = np.zeros((self.mesh.n_control_points, 3))
        for (v, _), chunk_sums in zip(chunks, sums):
            np.add.at(out, self.mesh.control_ids[v], chunk_sums)
        return out

    def _chunks(self) -> list[tuple[int, slice]]:
        """Volume and points of each piece of work; they do not depend on the number of threads."""
        chunks = []
        for v, p in enumerate(self.parameters):
            size = max(CHUNK_NODES, -(-len(p) // CHUNKS_PER_VOLUME))
            chunks += [(v, slice(start, min(start + size, len(p)))) for start in range(0, len(p), size)]
        return chunks

    @staticmethod
    def _check(array: np.ndarray, shape: tuple[int, ...], name: str):
        if array.shape != shape or np.iscomplexobj(array):
            raise InputError(f"metrics: {name} of shape {array.shape}; give real ones of shape {shape}")


@njit(cache=True, nogil=True, error_model="numpy")
def _add_gradients_transposed(B, orders, firsts, gradients, bar):
    """Add the transpose of the derivatives of Eq. (3), applied to ``bar``, shape (n, 3, 3), to ``B``."""
    p_0, p_1, p_2 = orders
    weights = np.empty((gradients.shape[1], 3))
    for q in range(bar.shape[0]):
        values = gradients[q, :, 0]
        for m in range(weights.shape[0]):
            for x in range(3):
                weights[m, x] = 0.0
                for k in range(3):
                    weights[m, x] += gradients[q, m, 1 + k] * bar[q, x, k]
        for a in range(p_0):
            for b in range(p_0, p_0 + p_1):
                v_01 = values[a] * values[b]
                line = B[firsts[q, 0] + a, firsts[q, 1] + b - p_0]
                for c in range(p_2):
                    value = values[p_0 + p_1 + c]
                    for x in range(3):
                        w_01 = weights[a, x] * values[b] + values[a] * weights[b, x]
                        line[firsts[q, 2] + c, x] += w_01 * value + v_01 * weights[p_0 + p_1 + c, x]
