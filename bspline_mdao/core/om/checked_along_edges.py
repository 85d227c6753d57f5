"""``check_partials`` along directions in which every point moves by a fraction of its shortest edge.

The cells of one grid may be 1e-6 m high at walls and 10 m long in the far field. No step in metres suits both: a step
small enough for the first cells is lost to rounding in coordinates of 100 m. So the check sees the component in scaled
variables: displacements of points in units of their edges. OpenMDAO takes products along a random direction r, and the
matching differences between inputs ``x0 + v`` and ``x0 - v`` with ``v = step r``. It does both with

``g(v) = (4/3 f(x0 + e v) - 1/6 f(x0 + 2 e v)) / u``

instead of the component's f. The diagonal of e holds the shortest edges of the points, so the step is a fraction of
them; u is one length. Then ``g'(0)`` is ``f'(x0) e / u``, and the central difference of g is the five-point rule for
it, with an error of fourth order in the step. Two things keep rounding small: the entries of ``e v`` are multiples of
the last digit of x0 (`_Stretch.along`), so points are exactly where they are meant to be; and u is chosen such that
rounding coordinates by one digit contributes `ROUNDING` to the differences, below the absolute tolerance of
``assert_check_partials``. The derivatives that are compared are ``e / u`` times those in metres. For a function of the
shape alone, such as a residual divided by areas, u is 1: they are the same in any unit of length.

The products and the differenced values are the component's own.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from openmdao.core.component import Component

from ...grids.cells.hexahedron import COLLAPSE_TOLERANCE
from ...grids.topology.block_layout import BlockLayout
from .check_directions import check_along_directions
from .model_option import Copied

__all__ = ["CheckedAlongEdges", "check_along_edges"]

FIVE_POINT = ((1.0, 4.0 / 3.0), (2.0, -1.0 / 6.0))
"""Places along a direction and weights, see above."""

PART = 3e-3
"""Fraction of the shortest edge by which a point moves. The five-point rule then has a relative error of 1e-11 in what
varies over an edge, and edges of 1e-6 m at coordinates of 1 m change by 1e7 of their last digits."""

REACH = 1e-6
"""Largest move of a point as a fraction of the grid's size, doubled by the five-point rule: points may leave symmetry
planes by 1e-5 of it."""

ROUNDING = 1e-7
"""Contribution of coordinate rounding to the derivatives: a tenth of the absolute tolerance of
``assert_check_partials``."""


def check_along_edges(
    component: CheckedAlongEdges,  # the component
    wrt: str,  # the input, points with x, y and z interleaved (m)
    # of int, numbers of its points in blocks, faces or lines; neighbours along any direction are joined by edges.
    # Points that the input does not have are -1. A point without edges moves by `REACH` times the overall size. A point
    # with a collapsed edge stays: lines of zero length are a special case, and functions jump when leaving it.
    lines: Sequence[np.ndarray],
    sharpness: float = 1.0,  # lengths of the edges divided by those over which the function changes
    digits: float | None = 1.0,  # how many trailing digits of coordinates are lost to rounding; None if u is 1
    # use complex steps instead of differences if the problem was set up with ``setup(force_alloc_complex=True)``: for
    # components whose kernels are exact under complex step
    is_complex: bool = False,
) -> None:
    """Make ``check_partials`` move the points of an input by parts of their shortest edges; call it in ``setup``."""
    # What a user sets on the component after ``Problem.setup`` overrides it.
    step = PART / sharpness
    check_along_directions(component, step, wrt, is_complex)
    component._edges[wrt] = tuple(lines), step, digits and digits / ROUNDING


class CheckedAlongEdges(Copied, Component):
    """Part of a component whose inputs are points of grids, see `check_along_edges`."""

    def __init__(self, **options: Any):
        super().__init__(**options)
        self._edges: dict[str, tuple[tuple[np.ndarray, ...], float, float | None]] = {}
        self._stretches: dict[str, _Stretch] = {}

    def check_partials(self, *arguments: Any, **options: Any) -> Any:
        """Check the partial derivatives, see ``om.ExplicitComponent.check_partials``."""
        asked = self._get_check_partial_options()
        for name, (lines, step, digits) in self._edges.items():
            if asked.get(name, {}).get("step") == step:  # complex ones have none, others are the user's, in metres
                self._stretches[name] = _Stretch.of(self._inputs[name].reshape(-1, 3), lines, step, digits)
        try:
            return super().check_partials(*arguments, **options)
        finally:
            self._stretches.clear()

    def run_apply_linear(
        self, mode: str, scope_out: Container[str] | None = None, scope_in: Container[str] | None = None
    ) -> None:
        """Apply the Jacobian of f, or of g during a check."""
        if mode == "fwd":
            for name, stretch in self._stretches.items():
                stretch.along(self._dinputs[name].ravel())
                self._stretch(name)
        super().run_apply_linear(mode, scope_out, scope_in)
        if mode == "rev":
            for name in self._stretches:
                self._stretch(name)

    def run_apply_nonlinear(self) -> None:
        """Compute the residuals of f, or of g during a check."""
        for name, stretch in self._stretches.items():
            side = np.sign((self._inputs[name].ravel() - stretch.start) @ stretch.moves)
            if side:
                self._difference(name, side * stretch.moves)
                return
        super().run_apply_nonlinear()

    def _stretch(self, name: str) -> None:
        """Multiply the linear vector of an input by e / u."""
        vector, stretch = self._dinputs[name], self._stretches[name]
        self._dinputs[name] = vector * (stretch.edges / stretch.unit).reshape(vector.shape)

    def _difference(self, name: str, moves: np.ndarray) -> None:
        """Replace the residuals of f by the residuals of g."""
        outputs, shape, total = self._outputs.asarray(copy=True), self._inputs[name].shape, 0.0
        for times, weight in FIVE_POINT:
            self._inputs[name] = (self._stretches[name].start + times * moves).reshape(shape)
            super().run_apply_nonlinear()
            total = total + weight * self._residuals.asarray()
            self._outputs.set_val(outputs)
        self._residuals.set_val(total / self._stretches[name].unit)


@dataclass
class _Stretch:
    """Variables in which a check sees an input."""

    start: np.ndarray  # (3 n,), the input, x0
    step: float  # step of the differences
    unit: float  # u (m), or 1
    edges: np.ndarray  # (3 n,), diagonal of e (m)
    moves: np.ndarray  # (3 n,), ``e v`` (m)

    @classmethod
    def of(cls, points: np.ndarray, lines: Sequence[np.ndarray], step: float, digits: float | None) -> _Stretch:
        """Measure the edges of points (n, 3); u is ``digits`` last digits of their coordinates by the step, or 1."""
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        edges = np.minimum(shortest_edges(points, lines, COLLAPSE_TOLERANCE * size), REACH / step * size)
        unit = np.finfo(float).eps * digits * float(np.abs(points).max()) / step if digits else 1.0
        return cls(points.ravel().copy(), step, unit, np.repeat(edges, 3), np.zeros(points.size))

    def along(self, direction: np.ndarray) -> None:
        """Adjust the edges so that steps of once and twice a direction (3 n,) end at representable numbers."""
        # A number just below a power of two has a digit that numbers beyond it lack. Where that matters, it stays.
        if direction.any():
            way = self.step * direction
            last_digit = np.spacing(np.abs(self.start) + 2.0 * np.abs(self.edges * way))
            moves = last_digit * np.round(self.edges * way / last_digit)
            moves[(np.fmod(self.start, last_digit) != 0.0) & (last_digit > 1e-12 * np.abs(moves))] = 0.0
            self.moves = moves
            self.edges = np.divide(moves, way, out=np.zeros_like(moves), where=way != 0.0)


def shortest_edges(points: np.ndarray, lines: Sequence[np.ndarray], least: float) -> np.ndarray:
    """Shortest edge of every point (m), shape (n,): 0 if it is ``least`` or less, infinite for points without edges."""
    shortest = np.full(len(points), np.inf)
    for ids in lines:
        here, is_there = np.full(ids.shape, np.inf), ids >= 0
        for axis in range(ids.ndim):
            lower, upper = ((slice(None),) * axis + (ends,) for ends in (slice(None, -1), slice(1, None)))
            squares = np.square(points[ids[upper]] - points[ids[lower]]).sum(axis=-1)
            squares[squares <= least**2] = 0.0
            squares[~(is_there[lower] & is_there[upper])] = np.inf
            for ends in (lower, upper):
                np.minimum(here[ends], squares, out=here[ends])
        np.minimum.at(shortest, ids[is_there], here[is_there])
    return np.sqrt(shortest)


def lines_among(numbers: np.ndarray, lines: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Restrict lines to some of their points, renumbered by position, for `check_along_edges`."""
    places = np.full(1 + max(int(ids.max()) for ids in lines), -1)
    places[numbers] = np.arange(len(numbers))
    return [places[ids] for ids in lines]


def numbered_blocks(shapes: Iterable[tuple[int, ...]]) -> list[np.ndarray]:
    """Lines of blocks of given shapes whose nodes follow each other in an input, each block in C order."""
    return BlockLayout.of(shapes).numbers
