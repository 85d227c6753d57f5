"""Where the Jacobian of a B-spline volume is positive, element by element: the regions between knots.

Boxes of fractions of the spans are examined, many at a time, the whole element first.
`bspline_mdao.core.evaluation.knot_ranges` finds the ranges of the knots on a box, hence of its Bézier control points.
`bspline_mdao.core.evaluation.derivative_cones` finds whether they prove that the Jacobian has one sign. Boxes that
remain undecided are halved. If their control vectors have a corner with a Jacobian that is not positive, this corner is
examined next, as a box without extent.

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...grids.cells.bernstein import INVALID, UNDECIDED, VALID
from .derivative_cones import are_positive, control_vectors, cut_direction, frames, load_edges, worst_corner
from .knot_ranges import enclose, extraction, parameter_slopes
from .poles import NO_POLE, divided_turns, next_to_pole, poles_of

__all__ = ["Lanes", "Queue", "decide_elements"]

LANES = 4096, 16
"""Control points of the boxes that are examined at a time if many wait, and number of boxes if few do: a call costs as
much as about ten boxes, and free lanes cost as much as others."""

MAX_DEPTH = 24
"""Halvings of a box, one after the other."""

MAX_BOXES = 400
"""Boxes of an element before it is left undecided."""


class Queue(NamedTuple):
    """Boxes that wait."""

    n_waiting: np.ndarray  # int (2,), number of boxes that wait, and of elements not yet examined
    # elements of the boxes that wait, and how often these were halved
    waiting: np.ndarray  # int (n,)
    waiting_depths: np.ndarray  # int (n,)
    waiting_boxes: np.ndarray  # (n, 2, 3, 2), fractions and parameters
    n_boxes: np.ndarray  # int (n_elements,), boxes of each element that were examined

    @classmethod
    def of(cls, n_lanes: int, n_elements: int) -> Queue:
        """A queue in which all elements wait."""
        room, counts = n_lanes * (2 * MAX_DEPTH + 4), lambda n: np.zeros(n, dtype=np.int64)
        return cls(np.array([0, n_elements]), counts(room), counts(room), np.zeros((room, 2, 3, 2)), counts(n_elements))


class Boxes(NamedTuple):
    """Boxes under examination, one in each lane."""

    numbers: np.ndarray  # int (L,), elements of the boxes; -1 in free lanes
    loaded: np.ndarray  # int (L,), elements of the control points and knots in the lanes
    depths: np.ndarray  # int (L,), how often the boxes were halved
    # the boxes, and the parameters on them
    fractions: np.ndarray  # (3, 2, L)
    box: np.ndarray  # (3, 2, L)

    @classmethod
    def of(cls, n_lanes: int) -> Boxes:
        """Free lanes."""
        ranges = np.zeros((3, 2, n_lanes)), np.zeros((3, 2, n_lanes))
        return cls(np.full(n_lanes, -1), np.full(n_lanes, -1), np.zeros(n_lanes, dtype=np.int64), *ranges)


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _load_knots(knots, first, orders, lane, local, coincide):
    """Write the knots that an element depends on to a lane, and which of them are the ends of its span."""
    for e in range(3):
        p, T = orders[e], knots[e]
        for i in range(2 * p - 2):
            end, is_same = first[e] + p - 1 if i <= p - 2 else first[e] + p, 1.0
            for a in range(2):
                for b in range(2):
                    knot = T[a, b, first[e] + 1 + i]
                    local[e, a, b, i, lane] = knot
                    if knot != T[a, b, end]:
                        is_same = 0.0
            coincide[e, i, lane] = is_same


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(knots, orders, is_empty, B, shortest, status, queue, boxes, local, coincide, edges):
    """Fill lanes with waiting boxes or elements not yet examined; return how many lanes are in use."""
    q, now, n_busy = queue, boxes, 0
    n_1, n_2 = B.shape[1] - orders[1] + 1, B.shape[2] - orders[2] + 1
    for lane in range(now.numbers.size):
        number = -1
        while number < 0 and q.n_waiting[0] > 0:
            q.n_waiting[0] -= 1
            at = q.n_waiting[0]
            if status[q.waiting[at]] == VALID:  # no box has decided about the element
                number, now.depths[lane] = q.waiting[at], q.waiting_depths[at]
                for e in range(3):
                    for i in range(2):
                        now.fractions[e, i, lane] = q.waiting_boxes[at, 0, e, i]
                        now.box[e, i, lane] = q.waiting_boxes[at, 1, e, i]
        while number < 0 and q.n_waiting[1] > 0:
            following = status.size - q.n_waiting[1]
            q.n_waiting[1] -= 1
            if not is_empty[following]:
                number, now.depths[lane] = following, 0
                for e in range(3):
                    for i in range(2):
                        now.fractions[e, i, lane], now.box[e, i, lane] = float(i), float(i)
        now.numbers[lane] = number
        if number < 0:
            continue
        n_busy += 1
        if number != now.loaded[lane]:
            now.loaded[lane] = number
            first = number // (n_1 * n_2), number // n_2 % n_1, number % n_2
            load_edges(B, first, orders, shortest, lane, edges)
            _load_knots(knots, first, orders, lane, local, coincide)
    return n_busy


@njit(cache=True, nogil=True, no_cpython_wrapper=True, error_model="numpy")
def _wait(queue, boxes, lane, depth, direction, low, high):
    """Queue the part of a lane's box between two fractions in one direction."""
    q, now, at = queue, boxes, queue.n_waiting[0]
    q.n_waiting[0] += 1
    q.waiting[at], q.waiting_depths[at] = now.numbers[lane], depth
    for e in range(3):
        for i in range(2):
            q.waiting_boxes[at, 0, e, i], q.waiting_boxes[at, 1, e, i] = now.fractions[e, i, lane], now.box[e, i, lane]
    q.waiting_boxes[at, 0, direction, 0], q.waiting_boxes[at, 0, direction, 1] = low, high


@njit(cache=True, nogil=True, error_model="numpy")
def _settle(
    orders, sign, signs, vectors, rows, columns, pole, at_pole, is_inside, has_frame, is_proved, status, queue, boxes
):
    """Record results for boxes; where there is none, halve the box or give its element up."""
    q, now, corner = queue, boxes, np.zeros(3, dtype=np.int64)
    for lane in range(now.numbers.size):
        number = now.numbers[lane]
        if number < 0 or status[number] != VALID or not is_inside[lane]:
            continue
        q.n_boxes[number] += 1
        if is_proved[lane]:
            if sign * signs[lane] < 0.0:
                status[number] = INVALID
            continue
        is_full = q.n_boxes[number] >= MAX_BOXES or q.n_waiting[0] + 3 > q.waiting.size
        if is_full or now.depths[lane] >= MAX_DEPTH:
            status[number] = UNDECIDED
            continue
        d = cut_direction(vectors, rows, orders, columns, now.fractions, has_frame[lane], lane)
        low, high = now.fractions[d, 0, lane], now.fractions[d, 1, lane]
        _wait(q, now, lane, now.depths[lane] + 1, d, low, 0.5 * (low + high))
        _wait(q, now, lane, now.depths[lane] + 1, d, 0.5 * (low + high), high)
        if has_frame[lane] and worst_corner(vectors, orders, sign * signs[lane], pole, at_pole[lane], lane, corner):
            for e in range(3):
                now.fractions[e, 1 - corner[e], lane] = now.fractions[e, corner[e], lane]
            _wait(q, now, lane, MAX_DEPTH, 0, now.fractions[0, 0, lane], now.fractions[0, 1, lane])


class Lanes:
    """Lanes in which boxes of one volume are examined, with the results."""

    def __init__(
        self,
        n_lanes: int,
        orders: tuple[int, int, int],
        varies: np.ndarray,  # bool (3, 3), whether knots of the first direction vary with the second's parameter
        normal: np.ndarray,  # (3,), derivative in a direction of order 1
        pole: tuple[int, int, int],  # the pole next to the elements, see `knot_ranges.extraction`
    ):
        p, L, self.orders, self.normal, self.pole = max(*orders, 2), n_lanes, orders, normal, pole
        n, n_parts = 2 * p - 2, p * (p - 1) // 2
        self.varies, self.depends = varies, varies | (varies @ varies)
        self.depends |= self.depends @ varies
        self.boxes = Boxes.of(L)
        self.is_inside, self.has_frame, self.is_proved, self.at_pole = np.zeros((4, L), dtype=bool)
        self.knots = np.zeros((3, 2, 2, n, L)), np.zeros((3, n, L))
        self.edges, self.points = np.zeros((3, *orders, 3, L)), np.zeros((2, 3, p, p, L))
        self.rows = np.zeros((2, 3, 3, p, p - 1, L))
        self.slopes, self.turns, self.pole_turns, self.columns = np.zeros((4, 3, 3, 2, L))
        self.for_matrices = (
            np.zeros((4, n, L)), np.zeros((2, 2, n, L)), np.zeros((2, n_parts, 2, L)), np.zeros((2, 2, n_parts, 2, L)),
            np.zeros((p, 2, L)), np.zeros((2, p, 2, L)), np.zeros((p, p, 2, L)), np.zeros((2, p, p, 2, L)),
        )  # fmt: skip
        self.for_means = np.zeros((4, p, L)), np.zeros((3, p, L)), np.zeros((3, 3, L)), np.zeros((p, L))
        self.frame, self.signs = np.zeros((3, 3, L)), np.zeros(L)
        self.contracted, self.vectors = np.zeros((2, 2, *orders, 3, L)), np.zeros((3, 2, *orders, 3, L))

    def fill(
        self,
        knots: tuple[np.ndarray, ...],
        is_left_out: np.ndarray,
        B: np.ndarray,
        shortest: float,
        status: np.ndarray,
        queue: Queue,
    ) -> int:
        """Fill lanes with waiting boxes or elements not yet examined; return how many lanes are in use."""
        return _fill(knots, self.orders, is_left_out, B, shortest, status, queue, self.boxes, *self.knots, self.edges)

    def derive(self) -> None:
        """Find the control vectors of the derivatives on the boxes, in their frames."""
        orders, depends, pole, at_pole = self.orders, self.depends, self.pole, self.at_pole
        fractions, box, (local, coincide) = self.boxes.fractions, self.boxes.box, self.knots
        self.is_inside[:], self.has_frame[:] = True, True
        enclose(local, orders, fractions, box, self.is_inside)
        if self.varies.any():
            parameter_slopes(local, orders, self.varies, fractions, box, self.slopes, self.turns, self.has_frame)
        if pole != NO_POLE:
            np.equal(fractions[pole[1], pole[2]], pole[2], out=at_pole)
            poles = pole, at_pole, self.slopes, self.turns
            divided_turns(local, orders, depends, *poles, fractions, box, self.pole_turns)
        extraction(
            local, orders, depends, coincide, fractions, box, self.turns, pole, at_pole, self.pole_turns,
            self.for_matrices, self.points, self.rows, self.has_frame,
        )  # fmt: skip
        of_derivatives = self.edges, orders, self.points, self.rows, depends, self.normal, pole, at_pole
        frames(*of_derivatives, self.for_means, self.frame, self.signs, self.has_frame)
        control_vectors(*of_derivatives, self.frame, self.contracted, self.vectors)

    def judge(self, sign: float, status: np.ndarray, queue: Queue) -> None:
        """Record whether the Jacobian is proved to have one sign, or halve the boxes."""
        self.is_proved[:] = self.has_frame
        are_positive(self.vectors, self.orders, self.columns, self.is_proved)
        _settle(
            self.orders, sign, self.signs, self.vectors, self.rows, self.columns, self.pole, self.at_pole,
            self.is_inside, self.has_frame, self.is_proved, status, queue, self.boxes,
        )  # fmt: skip


def decide_elements(
    knots: tuple[np.ndarray, ...],  # each (2, 2, N + p), of every direction on its four edges, Eq. (5)
    orders: tuple[int, int, int],  # 1 with a single layer of control points
    B: np.ndarray,  # (N0, N1, N2, 3), control points (m)
    sign: float,  # handedness
    normal: np.ndarray,  # (3,), derivative in a direction of order 1
    shortest: float,  # differences of control points up to this length (m) have collapsed
) -> tuple[np.ndarray, int]:
    """Decide about all elements of a volume: their status, and how many boxes were examined."""
    # status uint8 (N0 - p0 + 1, N1 - p1 + 1, N2 - p2 + 1): result for each element; an element between two equal knots
    # is empty and counts as valid
    varies = np.array([[e != v and _varies(T, e, v) for v in range(3)] for e, T in enumerate(knots)])
    status = np.full([n - p + 1 for n, p in zip(B.shape, orders)], VALID, dtype=np.uint8)
    is_empty = np.zeros(status.shape, dtype=bool)
    for e, (T, p) in enumerate(zip(knots, orders)):
        if p > 1 and not varies[e].any():
            is_empty |= np.diff(T[0, 0, p - 1 : T.shape[2] - p + 1]).reshape(np.roll([-1, 1, 1], e)) <= 0.0
    status[~is_empty], n_boxes = UNDECIDED, 0
    poles = [(pole, next_to_pole(pole, status.shape)) for pole in poles_of(knots, B, shortest)]
    elsewhere = ~np.any([np.zeros(status.shape, dtype=bool), *(side for _, side in poles)], axis=0)
    few = min(LANES[1], status.size)
    many = min(max(few, LANES[0] // int(np.prod(orders))), status.size)
    for pole, side in [(NO_POLE, elsewhere), *poles]:
        is_asked = side & (status == UNDECIDED)
        status[is_asked] = VALID  # until a box proves otherwise
        queue, found, is_left_out = Queue.of(many, status.size), status.reshape(-1), ~is_asked.reshape(-1)
        sets: dict[int, Lanes] = {}
        while queue.n_waiting.any():
            n = few if queue.n_waiting.sum() <= few else many
            lanes = sets[n] = sets.get(n) or Lanes(n, orders, varies, normal, pole)
            if lanes.fill(knots, is_left_out, B, shortest, found, queue):
                lanes.derive()
                lanes.judge(sign, found, queue)
        n_boxes += int(queue.n_boxes.sum())
    return status, n_boxes


def _varies(knots: np.ndarray, e: int, v: int) -> bool:
    """Whether knots of direction ``e`` on its four edges vary with the parameter of direction ``v``."""
    along = knots if v == (e + 1) % 3 else knots.swapaxes(0, 1)
    return bool((along[0] != along[1]).any())
