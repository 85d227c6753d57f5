"""What the components share: finite inputs, kernels that follow a baseline grid, products, sparse Jacobians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmdao.api as om
from scipy.sparse import csr_array

from ..errors import InputError


def finite_points(vector: np.ndarray, name: str, pathname: str) -> np.ndarray:
    """View a flat input as points, after a look for numbers that are none.

    Parameters
    ----------
    vector : ndarray, shape (3 n,)
        Coordinates, xyz interleaved (m).
    name, pathname : str
        Variable and component, for the message.

    Returns
    -------
    ndarray, shape (n, 3)

    Raises
    ------
    om.AnalysisError
        If a coordinate is not finite: a driver can back off from the step that led there.
    """
    points = vector.reshape(-1, 3)
    if not np.isfinite(vector).all():
        row, axis = np.argwhere(~np.isfinite(points))[0]
        raise om.AnalysisError(
            f"{pathname}: {'xyz'[axis]} of point {row + 1} of '{name}' is {points[row, axis]}; take a smaller step"
        )
    return points


def finite_values(vector: np.ndarray, name: str, pathname: str) -> np.ndarray:
    """Give an input back after a look for numbers that are none.

    Parameters
    ----------
    vector : ndarray
        Values.
    name, pathname : str
        Variable and component, for the message.

    Returns
    -------
    ndarray

    Raises
    ------
    om.AnalysisError
        If a value is not finite.
    """
    if not np.isfinite(vector).all():
        entry = int(np.argmin(np.isfinite(vector).ravel()))
        raise om.AnalysisError(
            f"{pathname}: value {entry + 1} of '{name}' is {vector.ravel()[entry]}; take a smaller step"
        )
    return vector


@dataclass(frozen=True, eq=False)
class SparsePattern:
    """Where a sparse Jacobian may differ from zero, in the order that OpenMDAO is told.

    Parameters
    ----------
    rows, cols : ndarray of int, shape (n,)
        Of every entry, row by row.
    n_cols : int
        Number of columns.
    """

    rows: np.ndarray
    cols: np.ndarray
    n_cols: int

    @classmethod
    def of(cls, matrix: csr_array) -> SparsePattern:
        """Take the entries of a matrix, explicit zeros included."""
        keys = np.unique(_keys(matrix))
        return cls(*np.divmod(keys, matrix.shape[1]), matrix.shape[1])

    def data(self, matrix: csr_array, name: str) -> np.ndarray:
        """Entries, shape (n,), of a matrix within the pattern.

        Raises
        ------
        InputError
            If the matrix has others; ``name`` says whose they are.
        """
        known, keys = self.rows * self.n_cols + self.cols, _keys(matrix)
        at = np.minimum(np.searchsorted(known, keys), len(known) - 1)
        is_new = known[at] != keys if len(known) else np.ones(len(keys), dtype=bool)
        if is_new.any():
            row, col = divmod(int(keys[np.argmax(is_new)]), self.n_cols)
            raise InputError(
                f"{name}: the derivative of entry {row + 1} in entry {col + 1} was not in the pattern that it began "
                f"with; give the same entries everywhere, zeros included"
            )
        data = np.zeros(len(known))
        data[at] = matrix.data
        return data


def _keys(matrix: csr_array) -> np.ndarray:
    """Places of all entries of a matrix in its C order."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return rows * matrix.shape[1] + matrix.indices


def at_baseline(last, build, model, vector: np.ndarray, pathname: str):
    """Give a kernel for a baseline grid: the last one if it was made for the same nodes.

    Parameters
    ----------
    last : object
        Kernel with the attribute ``nodes`` that it was made for.
    build : callable
        Makes a kernel from the model and nodes of shape (n, 3).
    model : FittedModel
        The model.
    vector : ndarray, shape (3 n,)
        Nodes of the baseline, xyz interleaved (m).
    pathname : str
        The component, for the message.

    Returns
    -------
    object
        A kernel such as ``last``.

    Raises
    ------
    om.AnalysisError
        If there is none for these nodes.
    """
    nodes = vector.reshape(-1, 3)
    if np.array_equal(nodes, last.nodes):
        return last
    try:
        return build(model, nodes.copy())
    except InputError as error:
        raise om.AnalysisError(f"{pathname}: {error}") from error


def add_product(jvp, vjp, d_inputs, d_outputs, mode: str, *, of: str, wrt: str) -> None:
    """Add the product of a Jacobian, or of its transpose, to the vectors of ``compute_jacvec_product``.

    Parameters
    ----------
    jvp, vjp : callable
        The Jacobian and its transpose, of points of shape (n, 3) to points of shape (m, 3) and back.
    d_inputs, d_outputs : Vector
        OpenMDAO's linear vectors.
    mode : str
        ``"fwd"`` or ``"rev"``.
    of, wrt : str
        Names of the output and of the input.
    """
    if of not in d_outputs or wrt not in d_inputs:
        return
    if mode == "fwd":
        d_outputs[of] += jvp(d_inputs[wrt].reshape(-1, 3)).ravel()
    else:
        d_inputs[wrt] += vjp(d_outputs[of].reshape(-1, 3)).ravel()


def direction_in(d_inputs, inputs, name: str) -> np.ndarray | float:
    """Give the direction in an input of ``compute_jacvec_product``.

    Parameters
    ----------
    d_inputs, inputs : Vector
        OpenMDAO's linear vector, which leaves out what plays no part, and the inputs.
    name : str
        The input.

    Returns
    -------
    ndarray, shape (n, 3), or float
        Zeros where OpenMDAO leaves it out; the number 0 where the component has no such input.
    """
    if name in d_inputs:
        return d_inputs[name].reshape(-1, 3)
    return np.zeros((inputs[name].size // 3, 3)) if name in inputs else 0.0


def add_bar(d_inputs, name: str, bar: np.ndarray) -> None:
    """Add a derivative, shape (n, 3), to the linear vector of an input, unless OpenMDAO leaves it out."""
    if name in d_inputs:
        d_inputs[name] += bar.reshape(d_inputs[name].shape)
