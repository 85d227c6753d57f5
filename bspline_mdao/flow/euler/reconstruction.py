"""Mean state and jump at a face, from the cells along the grid line through it.

Along the line lie the cells a, b on the left of the face and c, d on its right. On uniform grids the mean
``(-a + 7 b + 7 c - d) / 12`` of cell averages is of fourth order; a fraction, ``dissipation``, of the third difference
``a - 3 b + 3 c - d`` is dissipated. At shocks the mean is over the two cells at the face, and the jump is the first
difference, ``c - b``. At the end of a line, the cell after the last is extrapolated linearly.

The shock sensor ``sigma`` blends one into the other. With the relative second differences ``n`` of the pressure at the
cells on both sides, after Jameson, Schmidt and Turkel (AIAA 81-1259), and ``q = n_l^2 + n_r^2``, it is
``q^2 / (q^2 + threshold^4)``: smooth, and of eighth order in smooth flow.

Theory: ``docs/theory/euler.rst`` and, for shocks, ``docs/theory/euler_transonic.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import DTypeLike

from ...errors import InputError
from ...grids.cells.cell_faces import NONE, CellFaces
from .cell_sums import CellSums
from .sensor import stencil_sensor
from .sensor_derivatives import stencil_sensor_jvp, stencil_sensor_vjp

FIRST, THIRD = 0, 1
"""Rows of the weights in the differences of a face: the first and the third."""

INNER, FARFIELD, SLIP = 0, 1, 2
"""Roles of a face: cells on both sides, the free stream outside, or a slip boundary."""

KINDS = {"wall": SLIP, "symmetry": SLIP, "farfield": FARFIELD}
"""Roles of boundary faces by the kind of their patch."""

COMPACT_MEAN = (0.0, 0.5, 0.5, 0.0)
"""Weights of the four cells in the mean state at shocks."""

_FULL = np.array([[-1, 7, 7, -1], [0, -12, 12, 0], [12, -36, 36, -12]]) / 12.0


@dataclass(frozen=True, eq=False)
class Stencil:
    """Cells and weights of every face."""

    # (n_faces, 4) of int, cells a, b, c, d; b or c has weight 0 for missing cells. At boundary faces c is the third
    # cell inwards.
    cells: np.ndarray
    means: np.ndarray  # (n_classes, 4), weights in the mean state, by class of the face
    # (n_faces,) of int, class of each face; `.irregular_faces` have their own classes
    classes: np.ndarray
    # (n_lines, 2, 4), weights in the first and the third difference, by type of the line through a face
    differences: np.ndarray
    lines: np.ndarray  # (n_faces,) of int, type of the line through each face
    roles: np.ndarray  # (n_faces,) of int, `INNER`, `FARFIELD` or `SLIP`
    sums: CellSums  # sums over the faces of every cell

    @classmethod
    def of(cls, faces: CellFaces) -> Stencil:
        """Choose cells and weights by the grid line through each face."""
        edge = faces.left[faces.n_inner :]
        b, c = faces.left, np.append(faces.right, np.where(faces.third == NONE, edge, faces.third))
        a, d = faces.beyond_left, np.append(faces.beyond_right, edge)
        no_a, no_d = a == NONE, d == NONE
        roles = np.full(faces.n_faces, INNER, dtype=np.int8)
        lines = (no_a + 2 * no_d).astype(np.int8)
        depths = 2 - no_a - np.append(np.zeros(faces.n_inner, int), faces.third == NONE)
        for patch in faces.boundary:
            if patch.kind not in KINDS:
                kind = f"of kind '{patch.kind}'" if patch.kind else "of no kind"
                raise InputError(
                    f"flow: patch '{patch.name}' ({patch.stop - patch.start} faces) is {kind}; declare it as one of "
                    f"{', '.join(KINDS)} (bspline-mdao inspect --draft begins the file)"
                )
            part = slice(patch.start, patch.stop)
            roles[part] = KINDS[patch.kind]
            lines[part] = _BOUNDARY_LINES[KINDS[patch.kind]] + depths[part]
        cells = np.stack([np.where(no_a, b, a), b, c, np.where(no_d, c, d)], axis=1).astype(np.int32)
        classes = lines.astype(np.int32)  # as if `.irregular_faces` had their own classes: kernels compile once
        return cls(cells, _MEANS, classes, _DIFFERENCES, lines, roles, CellSums.of(cells, roles == INNER))

    def scheme(self, dissipation: float, threshold: float) -> FaceScheme:
        """Arrays of all faces with the numbers of a scheme, see `.residual.Discretization`."""
        by_class = self.means, self.classes, self.differences, self.lines
        return FaceScheme(self.cells, *by_class, self.roles, float(dissipation), float(threshold))

    def smooth_jumps(self, dissipation: float) -> np.ndarray:
        """Weights in the jump by type of the line, shape (n_lines, 4), without shocks."""
        # For a line of two cells they are zero.
        jumps = self.differences[:, FIRST].copy()
        jumps[:_N_INNER_LINES] = dissipation * self.differences[:_N_INNER_LINES, THIRD]
        return jumps


class FaceScheme(NamedTuple):
    """The scheme at faces, as arguments of all kernels: fields as in `Stencil` and `.residual`."""

    cells: np.ndarray
    means: np.ndarray
    classes: np.ndarray
    differences: np.ndarray
    lines: np.ndarray
    roles: np.ndarray
    dissipation: float
    threshold: float  # of the shock sensor; 0 for none

    def part(self, faces: slice | np.ndarray) -> FaceScheme:
        """The scheme of a range or list of faces."""
        by_class = self.means, self.classes[faces], self.differences, self.lines[faces]
        return FaceScheme(self.cells[faces], *by_class, self.roles[faces], self.dissipation, self.threshold)

    def cast(self, dtype: DTypeLike) -> FaceScheme:
        """The scheme with weights of a type: complex ones for complex states."""
        if self.means.dtype == dtype:
            return self
        return self._replace(means=self.means.astype(dtype), differences=self.differences.astype(dtype))


def _folded(no_a: bool, no_d: bool) -> np.ndarray:
    """Weights in mean and differences with extrapolated cells at the ends of a line: a = 2 b - c, d = 2 c - b."""
    fold = np.eye(4)
    if no_a:
        fold[0] = [0, 2, -1, 0]
    if no_d:
        fold[3] = [0, -1, 2, 0]
    return _FULL @ fold


def _boundary(*means: tuple[float, ...], first: float = 0.0) -> list[np.ndarray]:
    """Weights of a boundary face by the number of cells inwards: for cells b, a and the third, at c."""
    weights = np.zeros((len(means), 3, 4))
    for row, mean in zip(weights, means):
        row[0, [1, 0, 2][: len(mean)]] = mean
        row[1 + FIRST, 1] = first
    return list(weights)


_WEIGHTS = np.stack(
    [
        *(_folded(no_a, no_d) for no_d in (False, True) for no_a in (False, True)),
        *_boundary((1.0,), (1.5, -0.5), (1.875, -1.25, 0.375)),  # to the face, by polynomials of increasing degree
        *_boundary((0.5,), (0.5,), (0.5,), first=-1.0),  # halfway to the free stream
    ]
)

_MEANS, _DIFFERENCES = np.ascontiguousarray(_WEIGHTS[:, 0]), np.ascontiguousarray(_WEIGHTS[:, 1:])

_N_INNER_LINES = 4
"""Rows of inner faces come first."""

_BOUNDARY_LINES = {SLIP: _N_INNER_LINES, FARFIELD: _N_INNER_LINES + 3}


@njit(cache=True, error_model="numpy", inline="always")
def area_of(areas, f):
    """Area vector of a face."""
    return areas[f, 0], areas[f, 1], areas[f, 2]


@njit(cache=True, error_model="numpy", inline="always")
def has_area(s):
    """Whether a face has an area: without, as on a collapsed edge, it has no flux, and speeds divide by the area."""
    return s[0] * s[0] + s[1] * s[1] + s[2] * s[2] != 0.0


@njit(cache=True, error_model="numpy", inline="always")
def has_sensor(scheme, f):
    """Whether a face may be at a shock."""
    return scheme.roles[f] == INNER and scheme.threshold > 0.0


@njit(cache=True, error_model="numpy")
def face_state(scheme, f, states, stream, sigma):
    """Mean state and jump of a face, and the derivatives of both with respect to the sensor."""
    cells, role, differences = scheme.cells[f], scheme.roles[f], scheme.differences[scheme.lines[f]]
    mean = _combine(scheme.means[scheme.classes[f]], states, cells)
    first = _combine(differences[FIRST], states, cells)
    if role != INNER:
        outside = 1.0 if role == FARFIELD else 0.0
        return _add(mean, 0.5 * outside, stream), _add(first, outside, stream), first, first
    mean, mean_slope = _blend(mean, _combine(COMPACT_MEAN, states, cells), sigma)
    third = _scale(scheme.dissipation, _combine(differences[THIRD], states, cells))
    jump, jump_slope = _blend(third, first, sigma)
    return mean, jump, mean_slope, jump_slope


@njit(cache=True, error_model="numpy", nogil=True)
def face_weights(scheme, f, sigma, out):
    """Weights of the four cells of a face in mean state and jump, shape (2, 4), with the current sensor."""
    means, differences = scheme.means[scheme.classes[f]], scheme.differences[scheme.lines[f]]
    for k in range(4):
        out[0, k], out[1, k] = means[k], differences[FIRST, k]
        if scheme.roles[f] == INNER:
            third = scheme.dissipation * differences[THIRD, k]
            out[0, k] += sigma * (COMPACT_MEAN[k] - out[0, k])
            out[1, k] = third + sigma * (out[1, k] - third)


@njit(cache=True, error_model="numpy")
def shock_sensor(states, cells, threshold):
    """Shock sensor at an inner face, from 0 in smooth flow to 1."""
    return stencil_sensor(*_around(states, cells), *_constants(cells, threshold))


@njit(cache=True, error_model="numpy")
def shock_sensor_jvp(states, cells, threshold, d_states):
    """Change of `shock_sensor` with the states."""
    return stencil_sensor_jvp(*_around(states, cells), *_constants(cells, threshold), *_around(d_states, cells))


@njit(cache=True, error_model="numpy")
def shock_sensor_vjp(states, cells, threshold, bar):
    """Transpose of `shock_sensor_jvp`: adjoints of the first state, the two middle pressures and the last state."""
    return stencil_sensor_vjp(*_around(states, cells), *_constants(cells, threshold), bar)


@njit(cache=True, error_model="numpy", inline="always")
def _around(states, cells):
    """The values on which the sensor depends."""
    return _state(states, cells[0]), states[cells[1], 4], states[cells[2], 4], _state(states, cells[3])


@njit(cache=True, error_model="numpy", inline="always")
def _constants(cells, threshold):
    """Whether the first and the last cell exist, as numbers, and the level of the sensor."""
    has_first, has_last = 1.0 if cells[0] != cells[1] else 0.0, 1.0 if cells[3] != cells[2] else 0.0
    return has_first, has_last, threshold * threshold * threshold * threshold


@njit(cache=True, error_model="numpy", inline="always")
def _state(states, cell):
    return states[cell, 0], states[cell, 1], states[cell, 2], states[cell, 3], states[cell, 4]


@njit(cache=True, error_model="numpy", inline="always")
def _sum(weights, states, cells, n):
    return (
        weights[0] * states[cells[0], n]
        + weights[1] * states[cells[1], n]
        + weights[2] * states[cells[2], n]
        + weights[3] * states[cells[3], n]
    )


@njit(cache=True, error_model="numpy")
def _combine(weights, states, cells):
    return (
        _sum(weights, states, cells, 0),
        _sum(weights, states, cells, 1),
        _sum(weights, states, cells, 2),
        _sum(weights, states, cells, 3),
        _sum(weights, states, cells, 4),
    )


@njit(cache=True, error_model="numpy", inline="always")
def _blend(smooth, shock, sigma):
    """Blend states of smooth flow and of shocks by the sensor; also the derivative with respect to it."""
    slope = (
        shock[0] - smooth[0],
        shock[1] - smooth[1],
        shock[2] - smooth[2],
        shock[3] - smooth[3],
        shock[4] - smooth[4],
    )
    return _add(smooth, sigma, slope), slope


@njit(cache=True, error_model="numpy", inline="always")
def _scale(factor, a):
    return factor * a[0], factor * a[1], factor * a[2], factor * a[3], factor * a[4]


@njit(cache=True, error_model="numpy", inline="always")
def _add(a, factor, b):
    return (
        a[0] + factor * b[0],
        a[1] + factor * b[1],
        a[2] + factor * b[2],
        a[3] + factor * b[3],
        a[4] + factor * b[4],
    )
