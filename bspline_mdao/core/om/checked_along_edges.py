"""``check_partials`` along directions in which every point moves by a part of its shortest edge.

The cells of one grid may be 1e-6 m high at walls and 10 m long far out. No step in metres suits both: what first
cells can follow is lost to rounding in coordinates of 100 m. So the check sees the component in variables of its own,
those of points in units of their edges. OpenMDAO takes products along a random direction r, and differences for it
between inputs ``x0 + v`` and ``x0 - v`` with ``v = step r``. Both it does with

``g(v) = (4/3 f(x0 + e v) - 1/6 f(x0 + 2 e v)) / u``

in the place of the component's f. On the diagonal of e are the shortest edges of the points, so that the step is a part
of them; u is one length. Then ``g'(0)`` is ``f'(x0) e / u``, and the central difference of g is the five-point rule for
it, off by the fourth power of the step. Two things keep rounding small: the entries of ``e v`` are multiples of the
last digit of x0 (`_Stretch.along`), so that points are just where they are meant to be; and u is such that rounding of
coordinates by one digit makes `ROUNDING` of the differences, below the absolute tolerance of ``assert_check_partials``.
The derivatives that are compared are ``e / u`` times those in metres.

The products are the component's own, and so are the values that are differenced.
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
"""Part of the shortest edge that a point moves by. The five-point rule is then off by 1e-11 of what varies over an
edge, and edges of 1e-6 m at coordinates of 1 m change by 1e7 of their last digits."""

REACH = 1e-6
"""Part of a grid's size that no point moves by more, twice: points may leave planes of symmetry by 1e-5 of it."""

ROUNDING = 1e-7
"""Part of the derivatives that rounding of coordinates makes: a tenth of the absolute tolerance of
``assert_check_partials``."""


def check_along_edges(
    component: CheckedAlongEdges,  # the component
    wrt: str,  # the input, points with x, y and z interleaved (m)
    # of int, numbers of its points in blocks, faces or lines; neighbours along any direction are joined by edges.
    # Points that the input does not have are -1. One without edges moves by `REACH` times the size of all; one with a
    # collapsed edge stays, since lines of no length are a case of their own, from which functions jump.
    lines: Sequence[np.ndarray],
    sharpness: float = 1.0,  # lengths of the edges divided by those over which the function changes
    digits: float = 1.0,  # how many last digits of coordinates are lost to rounding in the function
    # take complex steps in the place of differences where the problem has room for them, after
    # ``setup(force_alloc_complex=True)``: for components with kernels that are exact under them
    is_complex: bool = False,
) -> None:
    """Make ``check_partials`` move the points of an input by parts of their shortest edges; call it in ``setup``."""
    # What a user sets on the component after ``Problem.setup`` comes before it.
    step = PART / sharpness
    check_along_directions(component, step, wrt, is_complex)
    component._edges[wrt] = tuple(lines), step, digits / ROUNDING


class CheckedAlongEdges(Copied, Component):
    """Part of a component whose inputs are points of grids, see `check_along_edges`."""

    def __init__(self, **options: Any):
        super().__init__(**options)
        self._edges: dict[str, tuple[tuple[np.ndarray, ...], float, float]] = {}
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
        """Apply the Jacobian, in a check that of g."""
        if mode == "fwd":
            for name, stretch in self._stretches.items():
                stretch.along(self._dinputs[name].ravel())
                self._stretch(name)
        super().run_apply_linear(mode, scope_out, scope_in)
        if mode == "rev":
            for name in self._stretches:
                self._stretch(name)

    def run_apply_nonlinear(self) -> None:
        """Compute residuals, in a check those of g."""
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
        """Put the residuals of g in the place of those of f."""
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
    unit: float  # u (m)
    edges: np.ndarray  # (3 n,), diagonal of e (m)
    moves: np.ndarray  # (3 n,), ``e v`` (m)

    @classmethod
    def of(cls, points: np.ndarray, lines: Sequence[np.ndarray], step: float, digits: float) -> _Stretch:
        """Measure the edges of points (n, 3); u is that many last digits of their coordinates, divided by the step."""
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        edges = np.minimum(shortest_edges(points, lines, COLLAPSE_TOLERANCE * size), REACH / step * size)
        unit = np.finfo(float).eps * digits * float(np.abs(points).max()) / step
        return cls(points.ravel().copy(), step, unit, np.repeat(edges, 3), np.zeros(points.size))

    def along(self, direction: np.ndarray) -> None:
        """Adjust the edges so that the way along a direction (3 n,), and twice that, ends at numbers that exist."""
        # A number just below a power of two has a digit that those beyond do not have. Where that counts, it stays.
        if direction.any():
            way = self.step * direction
            last_digit = np.spacing(np.abs(self.start) + 2.0 * np.abs(self.edges * way))
            moves = last_digit * np.round(self.edges * way / last_digit)
            moves[(np.fmod(self.start, last_digit) != 0.0) & (last_digit > 1e-12 * np.abs(moves))] = 0.0
            self.moves = moves
            self.edges = np.divide(moves, way, out=np.zeros_like(moves), where=way != 0.0)


def shortest_edges(points: np.ndarray, lines: Sequence[np.ndarray], least: float) -> np.ndarray:
    """Shortest edge of every point (m), shape (n,): 0 where it is ``least`` or less, infinite without."""
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
    """Lines between some of the points that lines join, for `check_along_edges`: these are numbered by their places."""
    places = np.full(1 + max(int(ids.max()) for ids in lines), -1)
    places[numbers] = np.arange(len(numbers))
    return [places[ids] for ids in lines]


def numbered_blocks(shapes: Iterable[tuple[int, ...]]) -> list[np.ndarray]:
    """Lines of blocks, of some shapes, whose nodes are an input one after the other, each in C order."""
    return BlockLayout.of(shapes).numbers
