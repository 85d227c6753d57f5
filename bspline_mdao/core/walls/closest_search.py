"""The search of the closest points of a wall, compiled: see `.closest_points` for what they are.

Theory: ``docs/theory/wall_layer.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .normal_cones import BEHIND, has_no_minimum

__all__ = ["MAX_CLOSEST", "fade", "find_closest"]

MAX_CLOSEST = 4
"""Closest points of a point, at most."""

SAME_DISTANCE = 1e-9
"""Distances that differ by less than this part of them are the same: round-off of coordinates decides."""

SAME_POINT = 1e-4
"""Closest points that are nearer to each other than this part of the distance are the same: those of two triangles that
share an edge differ by round-off."""


@njit(cache=True, nogil=True, error_model="numpy")
def fade(s):
    """Polynomial from 1 at s = 0 to 0 at s = 1, and constant beyond, with two continuous derivatives."""
    if s >= 1.0:
        return 0.0
    if s <= 0.0:
        return 1.0
    return (1.0 - s) ** 3 * (1.0 + s * (3.0 + 6.0 * s))


@njit(cache=True, nogil=True, error_model="numpy")
def _box_distance_square(box, p):
    total = 0.0
    for d in range(3):
        outside = max(max(box[d] - p[d], p[d] - box[3 + d]), 0.0)
        total += outside * outside
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _closest(a, b, c, p, barycentric):
    """Write the barycentric coordinates of the point of a triangle that is closest to p; return the squared distance.

    C. Ericson, Real-Time Collision Detection (2005), section 5.1.5: regions of corners, edges and the face in turn, and
    exact zeros for corners that the point does not depend on.
    """
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for d in range(3):
        ab, ac = b[d] - a[d], c[d] - a[d]
        d1 += ab * (p[d] - a[d])
        d2 += ac * (p[d] - a[d])
        d3 += ab * (p[d] - b[d])
        d4 += ac * (p[d] - b[d])
        d5 += ab * (p[d] - c[d])
        d6 += ac * (p[d] - c[d])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    u, v, w = 0.0, 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        u = 1.0
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        u = 1.0 - v
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        u = 1.0 - w
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = vb / total, vc / total
        u = 1.0 - v - w
    barycentric[0], barycentric[1], barycentric[2] = u, v, w
    square = 0.0
    for d in range(3):
        along = p[d] - (u * a[d] + v * b[d] + w * c[d])
        square += along * along
    return square


@njit(cache=True, nogil=True, error_model="numpy")
def _square_within_reach(p, points, triangles, reach, boxes, far, leaf_starts, stack, place):
    """Squared distance of any triangle that p is within the reach of; infinity where there is none."""
    if _box_distance_square(boxes[1], p) >= far[1] * far[1]:
        return np.inf  # as for most nodes of a mesh
    n_leaves = len(leaf_starts) - 1
    stack[0], n_left = 1, 1
    while n_left > 0:
        n_left -= 1
        k = stack[n_left]
        if k < n_leaves:
            one, other = 2 * k, 2 * k + 1
            near, away = _box_distance_square(boxes[one], p), _box_distance_square(boxes[other], p)
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
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            square = _closest(points[a], points[b], points[c], p, place)
            up_to = place[0] * reach[a] + place[1] * reach[b] + place[2] * reach[c]
            if square < up_to * up_to:
                return square
    return np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_square(p, points, triangles, boxes, leaf_starts, nearest, stack, squares, place):
    """Squared distance of the nearest triangle, if that is less than ``nearest``, or else this."""
    n_leaves = len(leaf_starts) - 1
    stack[0], squares[0], n_left = 1, 0.0, 1
    while n_left > 0:
        n_left -= 1
        k = stack[n_left]
        if squares[n_left] >= nearest:
            continue
        if k < n_leaves:
            one, other = 2 * k, 2 * k + 1
            near, away = _box_distance_square(boxes[one], p), _box_distance_square(boxes[other], p)
            if away <= near:
                one, other, near, away = other, one, away, near
            if away < nearest:
                stack[n_left], squares[n_left] = other, away
                n_left += 1
            if near < nearest:
                stack[n_left], squares[n_left] = one, near
                n_left += 1
            continue
        for t in range(leaf_starts[k - n_leaves], leaf_starts[k - n_leaves + 1]):
            a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
            nearest = min(nearest, _closest(a, b, c, p, place))
    return nearest


@njit(cache=True, nogil=True, error_model="numpy")
def _collect(
    p,
    points,
    triangles,
    reach,
    boxes,
    far,
    cones,
    facing,
    leaf_starts,
    around_starts,
    around,
    bound,
    same,
    round_off,
    found,
    barycentric,
    squares,
    stack,
    place,
    other_place,
):
    """Triangles that p is within the reach of and that are local minima, or no farther than ``same``; their number."""
    # They are at a squared distance up to ``bound``. Where there is no more room, the number says how many there would
    # be. Of a thousand triangles about a smooth wall all but a few have a nearer neighbour: these are not kept.
    n_leaves = len(leaf_starts) - 1
    apart = max(same, 1e7 * round_off)  # nearer than that, round-off decides which triangle is the nearest
    stack[0], n_left, n_found = 1, 1, 0
    while n_left > 0:
        n_left -= 1
        k = stack[n_left]
        if k < n_leaves:
            one, other = 2 * k, 2 * k + 1
            near, away = _box_distance_square(boxes[one], p), _box_distance_square(boxes[other], p)
            if away <= near:
                one, other, near, away = other, one, away, near
            for box, square in ((other, away), (one, near)):
                if square > bound or square >= far[box] * far[box]:
                    continue
                if square > apart * apart and has_no_minimum(cones[box], p):
                    continue
                stack[n_left] = box
                n_left += 1
            continue
        for t in range(leaf_starts[k - n_leaves], leaf_starts[k - n_leaves + 1]):
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            square = _closest(points[a], points[b], points[c], p, place)
            up_to = place[0] * reach[a] + place[1] * reach[b] + place[2] * reach[c]
            if not (square < up_to * up_to and square <= bound):
                continue
            distance = np.sqrt(square)
            if distance > apart:
                along = 0.0
                for d in range(3):
                    along += facing[t, d] * (p[d] - points[a, d])
                if along < facing[t, 3] * distance:
                    continue
            if distance <= same or _is_minimum(
                p, t, distance, place, points, triangles, around_starts, around, round_off, other_place
            ):
                if n_found < len(found):
                    found[n_found], squares[n_found] = t, square
                    for d in range(3):
                        barycentric[n_found, d] = place[d]
                n_found += 1
    return n_found


@njit(cache=True, nogil=True, error_model="numpy")
def find_closest(
    part,
    points,
    triangles,
    reach,
    boxes,
    far,
    cones,
    facing,
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
    """Find the closest points of points ``part`` and their weights; all from ``counts`` on is overwritten."""
    found, squares, barycentric = np.empty(64, dtype=np.int64), np.empty(64), np.empty((64, 3))
    closest, away = np.empty(MAX_CLOSEST, dtype=np.int64), np.empty((MAX_CLOSEST, 3))
    stack, left, place, other_place = np.empty(64, dtype=np.int64), np.empty(64), np.empty(3), np.empty(3)
    for i in range(len(part)):
        p = part[i]
        # first any that it is within the reach of, then the nearest alone, then all that may have a weight
        nearest = _square_within_reach(p, points, triangles, reach, boxes, far, leaf_starts, stack, place)
        if nearest == np.inf:
            continue
        nearest = _nearest_square(p, points, triangles, boxes, leaf_starts, nearest, stack, left, place)
        bound = farthest**2 * (nearest + (1e-13 * size) ** 2)  # else round-off could leave out the nearest itself
        nearest = np.sqrt(nearest)
        same = nearest * (1.0 + SAME_DISTANCE) + 1e-13 * size
        while True:
            n = _collect(
                p,
                points,
                triangles,
                reach,
                boxes,
                far,
                cones,
                facing,
                leaf_starts,
                around_starts,
                around,
                bound,
                same,
                1e-13 * size,
                found,
                barycentric,
                squares,
                stack,
                place,
                other_place,
            )
            if n <= len(found):
                break
            found, squares, barycentric = np.empty(2 * n, dtype=np.int64), np.empty(2 * n), np.empty((2 * n, 3))
        n_closest = _choose(
            p,
            n,
            same,
            found,
            squares,
            barycentric,
            points,
            triangles,
            around_starts,
            around,
            1e-13 * size,
            closest,
            away,
        )
        counts[i] = _set_weights(
            n_closest, nearest, farthest, closest, away, found, squares, barycentric, triangles, reach, out_weights[i]
        )
        for k in range(counts[i]):
            out_triangles[i, k] = found[closest[k]]
            for d in range(3):
                out_barycentric[i, k, d] = barycentric[closest[k], d]


@njit(cache=True, nogil=True, error_model="numpy")
def _choose(
    p, n, same, found, squares, barycentric, points, triangles, around_starts, around, round_off, closest, away
):
    """Choose the closest points of p among what was found; the nearest first, if it was found."""
    order, distances = np.empty(n, dtype=np.int64), np.empty(n)
    for k in range(n):
        distances[k] = np.sqrt(squares[k])
        place = k
        while place > 0 and distances[order[place - 1]] > distances[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
    # of coincident surfaces, the one whose fluid p is in; by their order in the tree where both or none are
    for rank in range(n):
        k = order[rank]
        if distances[k] > same:
            break
        if _is_on_fluid_side(p, found[k], barycentric[k], points, triangles):
            for later in range(rank, 0, -1):
                order[later] = order[later - 1]
            order[0] = k
            break
    n_closest = 0
    for rank in range(n):
        k = order[rank]
        if n_closest == MAX_CLOSEST:
            break
        t = found[k]
        for d in range(3):
            away[n_closest, d] = p[d]
            for corner in range(3):
                away[n_closest, d] -= barycentric[k, corner] * points[triangles[t, corner], d]
        if (rank == 0 and distances[k] <= same) or _is_another_minimum(
            p, k, n_closest, found, distances, barycentric, points, triangles, around_starts, around, round_off, away
        ):
            closest[n_closest] = k
            n_closest += 1
    return n_closest


@njit(cache=True, nogil=True, error_model="numpy")
def _is_another_minimum(
    p, k, n_closest, found, distances, barycentric, points, triangles, around_starts, around, round_off, away
):
    """Whether a place is a local minimum of the distance, seen from the fluid, and none of those chosen before."""
    for other in range(n_closest):
        square = 0.0
        for d in range(3):
            square += (away[n_closest, d] - away[other, d]) ** 2
        if square < (SAME_POINT * distances[k] + round_off) ** 2:
            return False
    return _is_minimum(
        p, found[k], distances[k], barycentric[k], points, triangles, around_starts, around, round_off, np.empty(3)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _is_minimum(p, t, distance, barycentric, points, triangles, around_starts, around, round_off, place):
    """Whether the closest place of a triangle is a local minimum of the distance to all, seen from the fluid."""
    # ``place`` is overwritten.
    if not distance > round_off or not _is_on_fluid_side(p, t, barycentric, points, triangles):
        return False
    if min(barycentric[0], barycentric[1], barycentric[2]) > 0.0:
        return True
    # on an edge or a corner: no other triangle there may be nearer
    near = max(distance * (1.0 - SAME_DISTANCE) - round_off, 0.0)
    verdict = _by_lines(p, t, near, barycentric, points, triangles, around_starts, around)
    if verdict != 0:
        return verdict > 0
    corners = triangles[t]
    first = _first_corner(corners, barycentric)
    for at in range(around_starts[first], around_starts[first + 1]):
        neighbour = triangles[around[at]]
        if _has_place(neighbour, corners, barycentric):
            square = _closest(points[neighbour[0]], points[neighbour[1]], points[neighbour[2]], p, place)
            if np.sqrt(square) < near:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _by_lines(p, t, near, barycentric, points, triangles, around_starts, around):
    """Whether lines from a place of a triangle to corners of others there lead nearer to p than ``near``."""
    # -1 if one does, 1 if all lead away, and then no triangle there leads nearer; 0 where round-off decides. Of a
    # hundred places that are tried about a point, all but one are settled by their first lines.
    corners = triangles[t]
    u, v, w = barycentric[0], barycentric[1], barycentric[2]
    a, b, c = points[corners[0]], points[corners[1]], points[corners[2]]
    x, y, z = u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1], u * a[2] + v * b[2] + w * c[2]
    px, py, pz = p[0] - x, p[1] - y, p[2] - z
    square, first, is_clear = px * px + py * py + pz * pz, _first_corner(corners, barycentric), True
    for at in range(around_starts[first], around_starts[first + 1]):
        neighbour = triangles[around[at]]
        if not _has_place(neighbour, corners, barycentric):
            continue
        for corner in range(3):
            k = neighbour[corner]
            if (k == corners[0] and u > 0.0) or (k == corners[1] and v > 0.0) or (k == corners[2] and w > 0.0):
                continue
            ex, ey, ez = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            along, length = ex * px + ey * py + ez * pz, ex * ex + ey * ey + ez * ez
            if along > 0.0:
                part = min(1.0, along / length)
                if square - part * (2.0 * along - part * length) < near * near:
                    return -1
                is_clear = False
    return 1 if is_clear else 0


@njit(cache=True, nogil=True, error_model="numpy")
def _first_corner(corners, barycentric):
    """The corner with the largest weight, the first of these."""
    if barycentric[0] >= barycentric[1] and barycentric[0] >= barycentric[2]:
        return corners[0]
    return corners[1] if barycentric[1] >= barycentric[2] else corners[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _has_place(neighbour, corners, barycentric):
    """Whether a triangle has all the corners of another one that a place of this depends on."""
    for corner in range(3):
        k = corners[corner]
        if barycentric[corner] > 0.0 and neighbour[0] != k and neighbour[1] != k and neighbour[2] != k:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _is_on_fluid_side(p, t, barycentric, points, triangles):
    """Whether p is on the side of a triangle that its normal points to, seen from a place of the triangle."""
    a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
    height = length = area = 0.0
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        normal = (b[e] - a[e]) * (c[f] - a[f]) - (b[f] - a[f]) * (c[e] - a[e])
        along = p[d] - (barycentric[0] * a[d] + barycentric[1] * b[d] + barycentric[2] * c[d])
        height += normal * along
        length += along * along
        area += normal * normal
    return height >= -BEHIND * np.sqrt(length * area)


@njit(cache=True, nogil=True, error_model="numpy")
def _set_weights(n_closest, nearest, farthest, closest, away, found, squares, barycentric, triangles, reach, weights):
    """Set the weights of the closest points; return the number of those that have one."""
    # 1. A weight fades with the distance relative to the reach, and with that relative to the nearest place's.
    # 2. Points in nearly the same direction, as beside the edge between two facets, get the weight of one.
    # 3. The weights sum to one on the surface, and fade with the reach.
    total, n_weighted = 0.0, 0
    fades, sizes = np.empty(MAX_CLOSEST), np.empty(MAX_CLOSEST)
    for k in range(n_closest):  # step 1
        distance, up_to = np.sqrt(squares[closest[k]]), 0.0
        for corner in range(3):
            up_to += barycentric[closest[k], corner] * reach[triangles[found[closest[k]], corner]]
        fades[k] = sizes[k] = fade(distance / up_to)
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
        weight = weights[k] / max(total, 1e-300) * fades[k]  # 1e-300: of weights that have faded all the way
        if weight > 0.0:
            weights[n_weighted], closest[n_weighted] = weight, closest[k]
            n_weighted += 1
    return n_weighted
