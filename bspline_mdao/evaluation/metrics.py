"""Derivatives of the mapping in the parameters at many points: the grid metrics x_xi, x_eta, ..., of every volume.

They include the dependence of curved knots on the other parameters, Eq. (4). A node on an interface has the metrics of
its own volume, so that there is one result per volume and nothing is shared. At fixed parameters the metrics are linear
in the control points; `MappingGradients` is that linear map and its transpose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from ..errors import InputError
from ..numerics.threads import run_tasks, thread_count
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from .basis_gradients import gradient_jets

CHUNK_NODES = 2**13
"""Nodes per chunk, at least."""

CHUNKS_PER_VOLUME = 16
"""Chunks per volume, at most: bounds the memory that the transpose needs."""

_SLICE = 1024  # points at a time, so that their basis jets stay in the cache


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
        gradients = [np.zeros((len(p), 3, 3)) for p in self.parameters]
        chunks = self._chunks()

        def evaluate(number: int):
            v, part = chunks[number]
            for points in _slices(part):
                firsts, jets = _jets(self.mesh.volumes[v], self.parameters[v][points])
                _contract_gradients(nets[v], *firsts, *jets, gradients[v][points])

        run_tasks(evaluate, len(chunks), thread_count(self.n_threads))
        return gradients

    def adjoint(self, bars: Sequence[np.ndarray]) -> np.ndarray:
        """Transposed product.

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
            sums[number] = np.zeros((*self.mesh.volumes[v].n_control, 3))
            for points in _slices(part):
                firsts, jets = _jets(self.mesh.volumes[v], self.parameters[v][points])
                bar = np.ascontiguousarray(bars[v][points], dtype=float)
                _contract_gradients_transposed(sums[number], *firsts, *jets, bar)

        run_tasks(accumulate, len(chunks), thread_count(self.n_threads))
        out = np.zeros((self.mesh.n_control_points, 3))
        for (v, _), chunk_sums in zip(chunks, sums):
            np.add.at(out, self.mesh.control_ids[v], chunk_sums)
        return out

    def _chunks(self) -> list[tuple[int, slice]]:
        """Pieces of work, whatever the number of threads: volume and points."""
        chunks = []
        for v, p in enumerate(self.parameters):
            size = max(CHUNK_NODES, -(-len(p) // CHUNKS_PER_VOLUME))
            chunks += [(v, slice(start, min(start + size, len(p)))) for start in range(0, len(p), size)]
        return chunks

    @staticmethod
    def _check(array: np.ndarray, shape: tuple[int, ...], name: str):
        if array.shape != shape or np.iscomplexobj(array):
            raise InputError(f"metrics: {name} of shape {array.shape}; give real ones of shape {shape}")


def _slices(part: slice) -> list[slice]:
    return [slice(start, min(start + _SLICE, part.stop)) for start in range(part.start, part.stop, _SLICE)]


def _jets(volume: Volume, parameters: np.ndarray):
    """First control points and gradient jets of the basis functions of each direction."""
    return zip(*[gradient_jets(volume.knots[d], d, parameters) for d in range(3)])


@njit(cache=True, nogil=True, error_model="numpy")
def _contract_gradients(B, firsts_0, firsts_1, firsts_2, jets_0, jets_1, jets_2, out):
    """Add the derivatives of Eq. (3) to ``out``, shape (n, 3, 3): nested sums of jets, one per coordinate."""
    line, plane, total = np.empty((3, 4)), np.empty((3, 4)), np.empty((3, 4))
    for q in range(out.shape[0]):
        total[:] = 0.0
        for a in range(jets_0.shape[1]):
            plane[:] = 0.0
            for b in range(jets_1.shape[1]):
                line[:] = 0.0
                for c in range(jets_2.shape[1]):
                    point = B[firsts_0[q] + a, firsts_1[q] + b, firsts_2[q] + c]
                    for d in range(3):
                        for m in range(4):
                            line[d, m] += point[d] * jets_2[q, c, m]
                _add_products(jets_1[q, b], line, plane)
            _add_products(jets_0[q, a], plane, total)
        for d in range(3):
            for m in range(3):
                out[q, d, m] += total[d, 1 + m]


@njit(cache=True, nogil=True, error_model="numpy")
def _contract_gradients_transposed(B, firsts_0, firsts_1, firsts_2, jets_0, jets_1, jets_2, bar):
    """Add the transposed product with ``bar``, shape (n, 3, 3), to ``B``."""
    total, plane, line = np.zeros((3, 4)), np.empty((3, 4)), np.empty((3, 4))
    for q in range(bar.shape[0]):
        for d in range(3):
            for m in range(3):
                total[d, 1 + m] = bar[q, d, m]
        for a in range(jets_0.shape[1]):
            _transposed_products(jets_0[q, a], total, plane)
            for b in range(jets_1.shape[1]):
                _transposed_products(jets_1[q, b], plane, line)
                for c in range(jets_2.shape[1]):
                    point = B[firsts_0[q] + a, firsts_1[q] + b, firsts_2[q] + c]
                    for d in range(3):
                        for m in range(4):
                            point[d] += line[d, m] * jets_2[q, c, m]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_products(factor, jets, out):
    """Add the products of a gradient jet with three others to ``out``, shape (3, 4)."""
    for d in range(3):
        out[d, 0] += factor[0] * jets[d, 0]
        for m in range(1, 4):
            out[d, m] += factor[0] * jets[d, m] + factor[m] * jets[d, 0]


@njit(cache=True, nogil=True, error_model="numpy")
def _transposed_products(factor, bar, out):
    """Write what `_add_products` makes of ``bar``, transposed in the three jets."""
    for d in range(3):
        out[d, 0] = factor[0] * bar[d, 0]
        for m in range(1, 4):
            out[d, 0] += factor[m] * bar[d, m]
            out[d, m] = factor[0] * bar[d, m]
