"""The compiled search for the closest points of a wall, which `.closest_points` defines.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .normal_cones import has_no_minimum
from .triangle_places import SAME_DISTANCE, closest_place, is_minimum, is_on_fluid_side, way_from

__all__ = ["MAX_CLOSEST", "fade", "find_closest"]

MAX_CLOSEST = 4
"""Most closest points of a point."""

SAME_POINT = 1e-4
"""Closest points that are nearer to each other than this fraction of the distance are the same: on two triangles that
share an edge they differ by round-off."""


@njit(cache=True, nogil=True, error_model="numpy")
def fade(s):
    """Polynomial from 1 at s = 0 to 0 at s = 1, and constant beyond, with two continuous derivatives."""
    if s >= 1.0:
        return 0.0
    if s <= 0.0:
        return 1.0
    return (1.0 - s) ** 3 * (1.0 + s * (3.0 + 6.0 * s))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _box_square(boxes, box, x, y, z):
    """Squared distance of a point from a box."""
    a = max(max(boxes[box, 0] - x, x - boxes[box, 3]), 0.0)
    b = max(max(boxes[box, 1] - y, y - boxes[box, 4]), 0.0)
    c = max(max(boxes[box, 2] - z, z - boxes[box, 5]), 0.0)
    return a * a + b * b + c * c


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _reach_at(reach, triangles, t, u, v, w):
    """Reach of a place of a triangle."""
    return u * reach[triangles[t, 0]] + v * reach[triangles[t, 1]] + w * reach[triangles[t, 2]]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _within_reach(x, y, z, points, triangles, reach, boxes, far, leaf_starts, stack):
    """Any triangle that has a point within its reach; -1 if there is none."""
    whole = np.int64(1)  # the root box; numba would compile again for the literal number
    if _box_square(boxes, whole, x, y, z) >= far[whole] * far[whole]:
        return -1  # as for most nodes of a mesh
    n_leaves = len(leaf_starts) - 1
    stack[0], n_left = 1, 1
    while n_left > 0:
        n_left -= 1
        k = stack[n_left]
        if k < n_leaves:
            one, other = 2 * k, 2 * k + 1
            near, away = _box_square(boxes, one, x, y, z), _box_square(boxes, other, x, y, z)
            if away <= near:
                one, other, near, away = other, one, away, near
            if away < far[other] * far[other]:
                stack[n_left] = other
                n_left += 1
            if near < far[one] * far[one]:
                stack[n_left] = one
                n_left += 1
            continue
        for t in range(leaf_starts[k - n_leaves], leaf_starts[k - n_leaves + 1]):
            square, u, v, w = closest_place(points, triangles, t, x, y, z)
            if square < _reach_at(reach, triangles, t, u, v, w) ** 2:
                return t
    return -1


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _bounds(nearest, farthest, round_off):
    """Distances of equally near places, certain and possible; squared distance up to which a place may have weight."""
    same = np.sqrt(nearest) * (1.0 + SAME_DISTANCE) + round_off
    apart = max(same, 1e7 * round_off)  # below this, round-off decides which triangle is the nearest
    return same, apart, farthest**2 * (nearest + round_off**2)  # otherwise round-off could leave out the nearest itself


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _collect(
    x,
    y,
    z,
    points,
    triangles,
    reach,
    boxes,
    far,
    cones,
    planes,
    cosines,
    leaf_starts,
    around_starts,
    around,
    start,
    farthest,
    round_off,
    found,
    squares,
    barycentric,
    stack,
    left,
):
    """Find the nearest triangle, and those with p = (x, y, z) in reach that are local minima or as near."""
    # Returns the number of the latter, the nearest triangle and its squared distance. The search starts from the
    # distance of triangle ``start``; a place that is taken before the nearest is known, and is too far, has no weight.
    # If there is no more room, the number is how many there would be. Of a thousand triangles about a smooth wall all
    # but a few have a nearer neighbour, and are not kept.
    n_leaves = len(leaf_starts) - 1
    nearest, u, v, w = closest_place(points, triangles, start, x, y, z)
    first = start
    same, apart, bound = _bounds(nearest, farthest, round_off)
    stack[0], left[0], n_left, n_found = 1, 0.0, 1, 0
    while n_left > 0:
        n_left -= 1
        k = stack[n_left]
        if left[n_left] > bound:
            continue
        if k < n_leaves:
            one, other = 2 * k, 2 * k + 1
            near, away = _box_square(boxes, one, x, y, z), _box_square(boxes, other, x, y, z)
            if away <= near:
                one, other, near, away = other, one, away, near
            if away <= nearest or (
                away <= bound
                and away < far[other] * far[other]
                and (away <= apart * apart or not has_no_minimum(cones, other, x, y, z))
            ):
                stack[n_left], left[n_left] = other, away
                n_left += 1
            if near <= nearest or (
                near <= bound
                and near < far[one] * far[one]
                and (near <= apart * apart or not has_no_minimum(cones, one, x, y, z))
            ):
                stack[n_left], left[n_left] = one, near
                n_left += 1
            continue
        for t in range(leaf_starts[k - n_leaves], leaf_starts[k - n_leaves + 1]):
            height, cosine, aside = _above(planes, t, 0, x, y, z), cosines[t], 0.0
            if cosine > 0.0:  # most are skipped before their closest point is computed
                for side in range(1, 4):
                    aside = max(aside, _above(planes, t, side, x, y, z))
                least = height * height + aside * aside
                if least > apart * apart and (
                    least > bound or height < 0.0 or height * height < cosine * cosine * least
                ):
                    continue
            square, u, v, w = closest_place(points, triangles, t, x, y, z)
            if square < nearest:
                nearest, first = square, t
                same, apart, bound = _bounds(nearest, farthest, round_off)
            if not (square < _reach_at(reach, triangles, t, u, v, w) ** 2 and square <= bound):
                continue
            distance = np.sqrt(square)
            if distance > apart and height < cosine * distance:
                continue
            if distance <= same or is_minimum(
                x, y, z, t, distance, u, v, w, points, triangles, planes, around_starts, around, round_off
            ):
                if n_found < len(found):
                    found[n_found], squares[n_found] = t, square
                    barycentric[n_found, 0], barycentric[n_found, 1], barycentric[n_found, 2] = u, v, w
                n_found += 1
    return n_found, first, nearest


@njit(cache=True, nogil=True, error_model="numpy")
def find_closest(
    part,
    points,
    triangles,
    reach,
    boxes,
    far,
    cones,
    planes,
    cosines,
    leaf_starts,
    around_starts,
    around,
    size,
    farthest,
    counts,
    out_triangles,
    out_barycentric,
    out_weights,
):
    """Find the closest points of points ``part`` and their weights; arguments from ``counts`` on are overwritten."""
    found, order, squares = np.empty(64, dtype=np.int64), np.empty(64, dtype=np.int64), np.empty(64)
    distances, barycentric = np.empty(64), np.empty((64, 3))
    closest, away = np.empty(MAX_CLOSEST, dtype=np.int64), np.empty((MAX_CLOSEST, 3))
    weights, fades, sizes = np.empty(MAX_CLOSEST), np.empty(MAX_CLOSEST), np.empty(MAX_CLOSEST)
    stack, left = np.empty(64, dtype=np.int64), np.empty(64)
    start, round_off = np.int64(-1), 1e-13 * size
    for i in range(len(part)):
        x, y, z = part[i, 0], part[i, 1], part[i, 2]
        # first any with the point in its reach, such as the previous point's nearest, then all that may have a weight
        is_near = False
        if start >= 0:
            square, u, v, w = closest_place(points, triangles, start, x, y, z)
            is_near = square < _reach_at(reach, triangles, start, u, v, w) ** 2
        if not is_near:
            any_near = _within_reach(x, y, z, points, triangles, reach, boxes, far, leaf_starts, stack)
            if any_near < 0:
                continue
            start = any_near
        while True:
            n, start, square = _collect(
                x,
                y,
                z,
                points,
                triangles,
                reach,
                boxes,
                far,
                cones,
                planes,
                cosines,
                leaf_starts,
                around_starts,
                around,
                start,
                farthest,
                round_off,
                found,
                squares,
                barycentric,
                stack,
                left,
            )
            if n <= len(found):
                break
            found, order, squares = np.empty(2 * n, dtype=np.int64), np.empty(2 * n, dtype=np.int64), np.empty(2 * n)
            distances, barycentric = np.empty(2 * n), np.empty((2 * n, 3))
        nearest = np.sqrt(square)
        n_closest = _choose(
            x,
            y,
            z,
            n,
            nearest * (1.0 + SAME_DISTANCE) + round_off,
            found,
            squares,
            distances,
            order,
            barycentric,
            points,
            triangles,
            planes,
            around_starts,
            around,
            round_off,
            closest,
            away,
        )
        counts[i] = _set_weights(
            n_closest,
            nearest,
            farthest,
            closest,
            away,
            found,
            squares,
            barycentric,
            triangles,
            reach,
            fades,
            sizes,
            weights,
        )
        for k in range(counts[i]):
            out_triangles[i, k], out_weights[i, k] = found[closest[k]], weights[k]
            for d in range(3):
                out_barycentric[i, k, d] = barycentric[closest[k], d]


@njit(cache=True, nogil=True, error_model="numpy")
def _choose(
    x,
    y,
    z,
    n,
    same,
    found,
    squares,
    distances,
    order,
    barycentric,
    points,
    triangles,
    planes,
    around_starts,
    around,
    round_off,
    closest,
    away,
):
    """Choose the closest points of a point among the found places; the nearest first, if it was found."""
    for k in range(n):
        distances[k] = np.sqrt(squares[k])
        place = k
        while place > 0 and distances[order[place - 1]] > distances[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
    # of coincident surfaces, the one with the point on its fluid side; the first in the tree if both or neither
    for rank in range(n):
        k = order[rank]
        if distances[k] > same:
            break
        u, v, w = barycentric[k, 0], barycentric[k, 1], barycentric[k, 2]
        if is_on_fluid_side(x, y, z, found[k], u, v, w, points, triangles, planes):
            for later in range(rank, 0, -1):
                order[later] = order[later - 1]
            order[0] = k
            break
    n_closest = np.int64(0)
    for rank in range(n):
        k = order[rank]
        if n_closest == MAX_CLOSEST:
            break
        t, u, v, w = found[k], barycentric[k, 0], barycentric[k, 1], barycentric[k, 2]
        away[n_closest, 0], away[n_closest, 1], away[n_closest, 2] = way_from(points, triangles, t, u, v, w, x, y, z)
        if (rank == 0 and distances[k] <= same) or (
            _is_another(n_closest, SAME_POINT * distances[k] + round_off, away)
            and is_minimum(
                x, y, z, t, distances[k], u, v, w, points, triangles, planes, around_starts, around, round_off
            )
        ):
            closest[n_closest] = k
            n_closest += 1
    return n_closest


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _is_another(n_closest, near, away):
    """Whether a place is farther than this from all that were chosen before."""
    for other in range(n_closest):
        square = 0.0
        for d in range(3):
            square += (away[n_closest, d] - away[other, d]) ** 2
        if square < near * near:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _above(planes, t, plane, x, y, z):
    """Height of a point above one of the planes of a triangle."""
    along = planes[t, plane, 0] * x + planes[t, plane, 1] * y + planes[t, plane, 2] * z
    return along - planes[t, plane, 3]


@njit(cache=True, nogil=True, error_model="numpy")
def _set_weights(
    n_closest, nearest, farthest, closest, away, found, squares, barycentric, triangles, reach, fades, sizes, weights
):
    """Set the weights of the closest points; return the number of those that have one."""
    # 1. A weight fades with the distance relative to the reach, and relative to the distance of the nearest place.
    # 2. Points in nearly the same direction, as next to the edge between two facets, share the weight of one.
    # 3. The weights sum to one on the surface, and fade with the reach.
    total, n_weighted = 0.0, 0
    for k in range(n_closest):  # step 1
        chosen = closest[k]
        distance = np.sqrt(squares[chosen])
        u, v, w = barycentric[chosen, 0], barycentric[chosen, 1], barycentric[chosen, 2]
        fades[k] = sizes[k] = fade(distance / _reach_at(reach, triangles, found[chosen], u, v, w))
        if distance > nearest:
            sizes[k] *= 1.0 - fade((nearest / distance - 1.0 / farthest) / (1.0 - 1.0 / farthest))
    for k in range(n_closest):  # step 2
        n_alike = 1.0
        for other in range(n_closest):
            cosine = away[k, 0] * away[other, 0] + away[k, 1] * away[other, 1] + away[k, 2] * away[other, 2]
            if other != k and cosine > 0.0:
                n_alike += sizes[other] * (cosine * cosine / (squares[closest[k]] * squares[closest[other]])) ** 2
        weights[k] = sizes[k] / n_alike
        total += weights[k]
    for k in range(n_closest):  # step 3
        weight = weights[k] / max(total, 1e-300) * fades[k]  # 1e-300: all weights may have faded to zero
        if weight > 0.0:
            weights[n_weighted], closest[n_weighted] = weight, closest[k]
            n_weighted += 1
    return n_weighted
