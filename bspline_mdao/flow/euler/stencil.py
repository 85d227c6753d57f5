"""Which cells give the mean state and the jump at a face, and with which weights.

Along the grid line through a face lie the cells a, b on its left and c, d on its right. On even grids the mean
``(-a + 7 b + 7 c - d) / 12`` of cell averages is of fourth order; what is dissipated is a share of the third difference
``a - 3 b + 3 c - d``, and at shocks of the first, ``c - b``. Where a line ends, the cell behind the last is
extrapolated linearly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...cells.cell_faces import NONE, CellFaces
from ...errors import InputError

MEAN, FIRST, THIRD = 0, 1, 2
"""Rows of the weights of a face: of its mean state, its first and its third difference."""

INNER, FARFIELD, SLIP = 0, 1, 2
"""What is known about a face: cells on both sides, the free stream outside, or no flow through it."""

KINDS = {"wall": SLIP, "symmetry": SLIP, "farfield": FARFIELD}
"""What the kinds of patches mean for the flow."""

_FULL = np.array([[-1, 7, 7, -1], [0, -12, 12, 0], [12, -36, 36, -12]]) / 12.0


@dataclass(frozen=True, eq=False)
class Stencil:
    """Cells and weights of every face.

    Parameters
    ----------
    cells : ndarray of int, shape (n_faces, 4)
        Cells a, b, c, d; where there is none, b or c with weight 0. At boundary faces c is the third cell inwards.
    weights : ndarray, shape (n_classes, 3, 4)
        Weights of mean, first and third difference by the class of a face.
    classes : ndarray of int8, shape (n_faces,)
        Class of each face.
    roles : ndarray of int8, shape (n_faces,)
        `INNER`, `FARFIELD` or `SLIP`.
    """

    cells: np.ndarray
    weights: np.ndarray
    classes: np.ndarray
    roles: np.ndarray

    @classmethod
    def of(cls, faces: CellFaces) -> Stencil:
        """Choose cells and weights.

        Raises
        ------
        InputError
            If a patch is of a kind that says nothing about the flow.
        """
        edge = faces.left[faces.n_inner :]
        b, c = faces.left, np.append(faces.right, np.where(faces.third == NONE, edge, faces.third))
        a, d = faces.beyond_left, np.append(faces.beyond_right, edge)
        no_a, no_d = a == NONE, d == NONE
        roles = np.full(faces.n_faces, INNER, dtype=np.int8)
        classes = (no_a + 2 * no_d).astype(np.int8)
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
            classes[part] = _BOUNDARY_CLASSES[KINDS[patch.kind]] + depths[part]
        cells = np.stack([np.where(no_a, b, a), b, c, np.where(no_d, c, d)], axis=1).astype(np.int32)
        return cls(cells, _WEIGHTS, classes, roles)

    def part(self, faces: slice) -> tuple[np.ndarray, ...]:
        """Cells, weights, classes and roles of a range of faces, as the kernels take them."""
        return self.cells[faces], self.weights, self.classes[faces], self.roles[faces]


def _folded(no_a: bool, no_d: bool) -> np.ndarray:
    """Weights where the cells at the ends of a line are extrapolated: a = 2 b - c, d = 2 c - b."""
    fold = np.eye(4)
    if no_a:
        fold[0] = [0, 2, -1, 0]
    if no_d:
        fold[3] = [0, -1, 2, 0]
    return _FULL @ fold


def _boundary(*means: tuple[float, ...], first: float = 0.0) -> list[np.ndarray]:
    """Weights of a boundary face by the number of cells there are inwards: those of cells b, a and the third, at c."""
    weights = np.zeros((len(means), 3, 4))
    for row, mean in zip(weights, means):
        row[MEAN, [1, 0, 2][: len(mean)]] = mean
        row[FIRST, 1] = first
    return list(weights)


_WEIGHTS = np.stack(
    [
        *(_folded(no_a, no_d) for no_d in (False, True) for no_a in (False, True)),
        *_boundary((1.0,), (1.5, -0.5), (1.875, -1.25, 0.375)),  # to the face, by ever higher polynomials
        *_boundary((0.5,), (0.5,), (0.5,), first=-1.0),  # half-way to the free stream
    ]
)
_BOUNDARY_CLASSES = {SLIP: 4, FARFIELD: 7}
