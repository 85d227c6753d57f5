"""Building blocks of every component.

To add a component:

1. ``setup`` declares the variables and how they are checked: by `check_along_edges` for grid points on which outputs
   depend nonlinearly, otherwise by `check_along_directions` with a suitable step.
2. ``compute`` checks its inputs with `finite_points` or `finite_values`, calls one kernel, and writes its outputs.
   Kernel failures at a design go through `failures_as_analysis_errors`, so drivers can back off. State shared by
   ``compute`` and the derivatives is kept in a `LastState`. If one process raises, all must raise: a method without
   communication is decorated by `fails_together`; a method with communication keeps whatever may fail, input checks
   included, inside `failures_as_analysis_errors`, and its communication outside.
3. The derivative is written in one of two ways:

   - *matrix-free*, if the kernel has ``jvp`` and ``vjp``: ``compute_jacvec_product`` is one call of `add_product`, or
     uses `direction_in` and `add_bar` if inputs are not points;
   - *sparse*, if the kernel returns entries: the component is a `SparseComponent`, declares them by ``declare_sparse``
     in ``setup_partials`` and fills them in ``compute_partials``, through `SparsePattern` if kernels return matrices.

4. A component whose kernel is real calls `refuse_complex_step`; a linear one splits complex inputs by `by_parts`.
5. An entry point in ``pyproject.toml`` and a line in ``bspline_mdao/__init__.pyi`` register it; a test compares them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
import openmdao.api as om
from openmdao.utils.om_warnings import issue_warning
from openmdao.vectors.vector import Vector
from scipy.sparse import coo_array, csr_array

from ...base.numerics.processes import ONE, together
from ...base.text import value_name
from ...errors import InputError, MovementError
from ...grids.cells.hexahedron import COLLAPSE_TOLERANCE
from .checked_along_edges import CheckedAlongEdges, shortest_edges

LINEAR_STEP = 1.0
"""Difference step for linear functions: any step is exact, and rounding matters least for a large one."""

SMOOTH_STEP = 1e-5
"""Difference step for functions that vary over a length of order 1, such as an angle or a scale."""

EACH, SAME, LEFT_OUT = "own", "same", "left out"
"""Ways to check derivatives on several processes, see `CheckedOnProcesses`."""


def finite_points(
    vector: np.ndarray,  # (3 n,), coordinates, xyz interleaved (m)
    name: str,  # name, pathname: variable and component, for the message
    pathname: str,
) -> np.ndarray:  # (n, 3)
    """View a flat input as points, after checking that all numbers are finite."""
    points = vector.reshape(-1, 3)
    if not np.isfinite(vector).all():
        row, axis = np.argwhere(~np.isfinite(points))[0]
        value = value_name(name, 3 * row + axis)
        raise om.AnalysisError(
            f"{pathname}: {value}, {'xyz'[axis]} of point {row + 1}, is {points[row, axis]}; take a smaller step"
        )
    return points


def as_node_numbers(numbers: Sequence[int] | np.ndarray | None, n: int, name: str, pathname: str) -> np.ndarray:
    """Return the user's node numbers as an array; all ``n`` for None."""
    numbers = np.arange(n) if numbers is None else np.asarray(numbers)
    if numbers.ndim != 1 or numbers.dtype.kind != "i" or not len(numbers) or numbers.min() < 0 or numbers.max() >= n:
        raise InputError(f"{pathname}: '{name}' are not numbers of nodes; give a list of integers from 0 to {n - 1}")
    return numbers


def finite_values(
    vector: np.ndarray,  # values
    name: str,  # name, pathname: variable and component, for the message
    pathname: str,
) -> np.ndarray:
    """Return an input after checking that all numbers are finite."""
    if not np.isfinite(vector).all():
        entry = int(np.argmin(np.isfinite(vector).ravel()))
        value = value_name(name, entry, vector.size)
        raise om.AnalysisError(f"{pathname}: {value} is {vector.ravel()[entry]}; take a smaller step")
    return vector


@dataclass(frozen=True, eq=False)
class SparsePattern:
    """Entries of a sparse Jacobian that may differ from zero, in the order in which they are declared to OpenMDAO."""

    # rows, cols: (n,) of int, row and column of every entry, row by row
    rows: np.ndarray
    cols: np.ndarray
    n_cols: int  # number of columns

    @classmethod
    def of(cls, matrix: csr_array) -> SparsePattern:
        """Make the pattern of the entries of a matrix, explicit zeros included."""
        keys = np.unique(_keys(matrix))
        return cls(*np.divmod(keys, matrix.shape[1]), matrix.shape[1])

    def data(self, matrix: csr_array, name: str) -> np.ndarray:
        """Entries, shape (n,), of a matrix within the pattern."""
        declared, keys = self.rows * self.n_cols + self.cols, _keys(matrix)
        at = np.minimum(np.searchsorted(declared, keys), len(declared) - 1)
        is_new = declared[at] != keys if len(declared) else np.ones(len(keys), dtype=bool)
        if is_new.any():
            row, col = divmod(int(keys[np.argmax(is_new)]), self.n_cols)
            raise InputError(
                f"{name}: the derivative of entry {row + 1} in entry {col + 1} was not in the pattern that it began "
                f"with; give the same entries everywhere, zeros included"
            )
        data = np.zeros(len(declared))
        data[at] = matrix.data
        return data


def _keys(matrix: csr_array) -> np.ndarray:
    """C-order position of every entry of a matrix."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return rows * matrix.shape[1] + matrix.indices


class LastState:
    """The last state, made again only if the inputs change."""

    # OpenMDAO runs a component and takes products at the same inputs many times over; line searches and finite
    # differences return to earlier inputs, too.

    def __init__(self) -> None:
        self.points: list[np.ndarray] | None = None
        self.state: Any = None

    def at(
        self,
        points: Sequence[np.ndarray],  # the inputs
        # makes the state from the inputs, passed as separate arguments: copies, which it may keep. If it raises, the
        # last state stays.
        make: Callable,
    ) -> Any:  # what ``make`` returned
        """Return the state at inputs: the last one if it was made for them."""
        if self.points is None or not all(map(np.array_equal, points, self.points)):
            copies = [array.copy() for array in points]
            self.state, self.points = make(*copies), copies
        return self.state


def add_product(
    # inputs, d_inputs, d_outputs: OpenMDAO's inputs and linear vectors, which omit irrelevant variables
    inputs: Vector,
    d_inputs: Vector,
    d_outputs: Vector,
    mode: str,  # ``"fwd"`` or ``"rev"``
    *,
    # takes a direction in every input, of shape (n, 3), and returns the change of the output, of shape (m, 3)
    jvp: Callable,
    # takes the derivative with respect to the output, of shape (m, 3), and returns the derivative with respect to each
    # input, of shape (n, 3), or None for zero: a sequence of them, unless ``wrt`` is one name
    vjp: Callable,
    of: str,  # name of the output
    # names of the inputs, in the order of ``jvp``. An input that the component lacks gets the direction 0.
    wrt: str | Sequence[str],
) -> None:
    """Add the product of a Jacobian, or of its transpose, to the vectors of ``compute_jacvec_product``."""
    names = (wrt,) if isinstance(wrt, str) else wrt
    if of not in d_outputs or not any(name in d_inputs for name in names):
        return
    if mode == "fwd":
        d_outputs[of] += by_parts(jvp, *(direction_in(d_inputs, inputs, name) for name in names)).ravel()
        return
    seed = d_outputs[of].reshape(-1, 3)
    for unit, part in ((1.0, seed.real), (1j, seed.imag)) if np.iscomplexobj(seed) else ((1.0, seed),):
        bars = vjp(np.ascontiguousarray(part))
        for name, bar in zip(names, (bars,) if isinstance(wrt, str) else bars):
            if bar is not None:
                add_bar(d_inputs, name, bar if unit == 1.0 else unit * bar)


def direction_in(
    d_inputs: Vector,  # d_inputs, inputs: OpenMDAO's linear vector, which omits irrelevant variables, and the inputs
    inputs: Vector,
    name: str,  # the input
) -> np.ndarray | float:
    """Return the direction in an input of ``compute_jacvec_product``."""
    # Returns (n, 3), zeros if OpenMDAO leaves it out; the number 0 if the component has no such input.
    if name in d_inputs:
        return d_inputs[name].reshape(-1, 3)
    return np.zeros((inputs[name].size // 3, 3)) if name in inputs else 0.0


def add_bar(d_inputs: Vector, name: str, bar: np.ndarray) -> None:
    """Add a derivative, shape (n, 3), to the linear vector of an input, unless OpenMDAO leaves it out."""
    if name in d_inputs:
        d_inputs[name] += bar.reshape(d_inputs[name].shape)


def difference_step(
    net: np.ndarray,  # (..., 3), points (m); neighbours along any direction are joined by edges
) -> float:
    """Find the step (m) at which central differences with respect to all points of a net are most accurate."""
    # See `central_step`; the length is the shortest edge.
    points = net.reshape(-1, 3)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    edges = shortest_edges(points, [np.arange(len(points)).reshape(net.shape[:-1])], COLLAPSE_TOLERANCE * size)
    return central_step(size, float(edges.min(where=edges > 0.0, initial=size)))


def central_step(
    size: float,  # magnitude of the numbers that are rounded
    length: float,  # length over which the function changes
) -> float:
    """Find the step at which central differences are most accurate."""
    # Central differences lose ``eps size / step`` to rounding and ``(step / length)^2`` to truncation. They are equal
    # when the step is the cube root of ``eps size length^2``.
    return float(np.cbrt(np.finfo(float).eps * size * length**2))


class CheckedOnProcesses(CheckedAlongEdges):
    """Mixin for components whose processes depend on each other, for ``check_partials`` on several processes."""

    # OpenMDAO draws the directions of a check on each process separately, and takes its dot products there. That is
    # right for components that every process has in full. Components of this class are checked in one of three ways,
    # `way_of_check`:
    #
    # - ``OWN``: from inputs that all processes have to distributed outputs. Each process checks its own part, without
    #   the sum over all processes that the reverse product otherwise takes.
    # - ``SAME``: all variables are the same on all processes, which compute jointly. They take the same directions.
    # - ``LEFT_OUT``: whatever needs sums over all processes. The check says so and has to be run on one process, where
    #   the derivatives are the same.

    way_of_check = LEFT_OUT

    def check_partials(self, *arguments: Any, **options: Any) -> Any:
        """Check the partial derivatives, see ``om.ExplicitComponent.check_partials``."""
        if self.comm.size > 1 and self.way_of_check == LEFT_OUT:
            if self.comm.rank == 0:
                issue_warning(
                    f"check_partials leaves it out on {self.comm.size} processes, whose sums it would compare one by "
                    "one; check on one process, where the derivatives are the same",
                    prefix=self.msginfo,
                    category=om.DerivativesWarning,
                )
            return {self.pathname: {}}, None
        if self.comm.size > 1 and self.way_of_check == SAME:
            np.random.set_state(self.comm.bcast(np.random.get_state(), root=0))  # noqa: NPY002 - OpenMDAO draws there
        with each_for_itself(self) if self.way_of_check == EACH else nullcontext():
            return super().check_partials(*arguments, **options)


class SparseComponent(CheckedOnProcesses, om.ExplicitComponent):
    """Component with sparse partials that ``check_partials`` checks along directions, like matrix-free components."""

    # OpenMDAO cannot check along a direction if a pattern is declared: it goes column by column. So the check sees
    # products with the declared entries instead of the declaration.

    way_of_check = EACH
    _subjacs_info: dict

    def __init__(self, **options: Any):
        super().__init__(**options)
        self.matrix_free = False  # OpenMDAO treats a component with products as one without entries
        self._entries: dict[tuple[str, str], tuple[np.ndarray, np.ndarray, Any]] = {}

    def check_partials(self, *arguments: Any, **options: Any) -> Any:
        """Check the partial derivatives, see ``om.ExplicitComponent.check_partials``."""
        declared, is_matrix_free = self._subjacs_info, self.matrix_free
        self._subjacs_info, self.matrix_free = {}, True
        try:
            return super().check_partials(*arguments, **options)
        finally:
            self._subjacs_info, self.matrix_free = declared, is_matrix_free

    def declare_sparse(
        self, of: str, wrt: str, rows: np.ndarray, cols: np.ndarray, val: np.ndarray | float | None = None
    ) -> None:
        """Declare entries that may differ from zero, in ``setup_partials``; they are constant if values are given."""
        self.declare_partials(of, wrt, rows=rows, cols=cols, val=val)
        self._entries[of, wrt] = rows, cols, val

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the declared Jacobian or its transpose; used only by the check."""
        partials: dict[tuple[str, str], np.ndarray] = {}
        self.compute_partials(inputs, partials)
        for (of, wrt), (rows, cols, constant) in self._entries.items():
            if of in d_outputs and wrt in d_inputs:
                values = np.broadcast_to(partials.get((of, wrt), constant), len(rows))
                matrix = coo_array((values, (rows, cols)), shape=(d_outputs[of].size, d_inputs[wrt].size))
                if mode == "fwd":
                    d_outputs[of] += (matrix @ d_inputs[wrt].ravel()).reshape(d_outputs[of].shape)
                else:
                    d_inputs[wrt] += (matrix.T @ d_outputs[of].ravel()).reshape(d_inputs[wrt].shape)


def refuse_complex_step(component: om.ExplicitComponent | om.ImplicitComponent) -> None:
    """Refuse OpenMDAO's complex step in a component whose kernels are real."""
    if component.under_complex_step:
        raise InputError(
            f"{component.msginfo}: there is no complex step through it; its own derivatives are exact, or take "
            f"method='fd', form='central'"
        )


@contextmanager
def failures_as_analysis_errors(
    component: om.ExplicitComponent | om.ImplicitComponent, kinds: tuple[type[Exception], ...] = (MovementError,)
) -> Iterator[None]:
    """Raise errors of some kinds as ``om.AnalysisError`` with the name of the component."""
    # All processes of the component enter, make no collective call inside, and raise together, see
    # `bspline_mdao.base.numerics.processes.together`.
    with together(component.comm), as_analysis_errors(component, kinds):
        yield


@contextmanager
def as_analysis_errors(
    component: om.ExplicitComponent | om.ImplicitComponent, kinds: tuple[type[Exception], ...] = (MovementError,)
) -> Iterator[None]:
    """Raise errors of some kinds as ``om.AnalysisError``, if all processes raise the same anyway."""
    try:
        yield
    except kinds as error:
        raise om.AnalysisError(f"{component.msginfo}: {error}") from error


@contextmanager
def each_for_itself(component: om.ExplicitComponent) -> Iterator[None]:
    """Run a component on every process as if it were the only one, with its part of distributed variables."""
    comm = component.comm
    component.comm = ONE
    try:
        yield
    finally:
        component.comm = comm


Method = TypeVar("Method", bound=Callable)


def fails_together(method: Method) -> Method:
    """Decorate a method of a component or group that makes no collective call: all processes raise what one raises."""

    @functools.wraps(method)
    def run(self: Any, *arguments: Any, **options: Any) -> Any:
        with together(self.comm):
            return method(self, *arguments, **options)

    return cast(Method, run)


def by_parts(apply: Callable, *directions: np.ndarray | float) -> Any:
    """Apply a real linear map to arrays that may be complex under complex step: to real and imaginary parts."""
    if any(map(np.iscomplexobj, directions)):
        real, imaginary = ([np.ascontiguousarray(part(x)) for x in directions] for part in (np.real, np.imag))
        return apply(*real) + 1j * apply(*imaginary)
    return apply(*directions)
