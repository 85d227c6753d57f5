"""The linear system of a step of an extrusion, after Chan and Steger (1992), on nodes with any number of neighbours.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LARGEST_COSINE = 0.9
"""Bound of half the angle of a corner in the dissipation, which would otherwise be unbounded."""

LEAST_SENSOR, LARGEST_SENSOR = 0.1, 4.0
"""Bounds of the convergence of grid lines in the dissipation; the lower one is Chan and Steger's."""

LEAST_SINE = 0.1
"""Bound of the angle between tangents of the front: a sharper one counts as this, which bounds their duals."""

FREE = -1
"""Constraint of nodes at free edges; 0 means unconstrained, and larger numbers are projectors."""


@njit(cache=True, error_model="numpy")
def assemble(
    d, length, previous, starts, nodes, image, maps, normals, steps, level, dissipation, projectors, constraint, splay
):
    """Blocks of the matrix, (n, 9) of the diagonal and (n_neighbours, 9), and right side (n, 3), of a step."""
    n = len(starts) - 1
    diagonal, blocks, right = np.zeros((n, 9)), np.zeros((len(nodes), 9)), np.empty((n, 3))
    a, b, pull = np.empty(3), np.empty(3), np.empty(3)
    coefficient = np.empty(9)
    for i in range(n):
        diagonal[i, 0] = diagonal[i, 4] = diagonal[i, 8] = 1.0
        if constraint[i] == FREE:
            _follow(i, starts, nodes, image, maps, constraint, blocks)
            for r in range(3):
                right[i, r] = splay[i, r] * steps[i]
            continue
        lo, hi = starts[i], starts[i + 1]
        m, step, normal = hi - lo, steps[i], normals[i]
        jacobian = _dual_tangents(d, lo, hi, normal, a, b)
        pull[:] = 0.0
        for k in range(lo, hi):
            opposite = lo + (k - lo + m // 2) % m if m % 2 == 0 else k
            weight = dissipation * level * _strength(d, length, previous, k, opposite, normal, level)
            mean = 0.5 * (length[k] + length[opposite])
            weight *= step / mean * 4.0 / m
            angle, scale = 2.0 * math.pi * (k - lo) / m, step * 2.0 / m / jacobian
            c, s = scale * math.cos(angle), scale * math.sin(angle)
            for r in range(3):
                pull[r] += weight * mean / length[k] * d[k, r]
                for q in range(3):
                    coefficient[3 * r + q] = (c * a[r] + s * b[r]) * normal[q] + normal[r] * (c * a[q] + s * b[q])
                coefficient[4 * r] -= 2.0 * weight
                diagonal[i, 4 * r] += 2.0 * weight
            _add_neighbour(i, k, coefficient, maps[image[k]], image[k] != 0, diagonal, blocks)
        # near the surface no pull into the body: at convex edges it would undo the step
        inwards = min(pull[0] * normal[0] + pull[1] * normal[1] + pull[2] * normal[2], 0.0) * (1.0 - level**4)
        for r in range(3):
            right[i, r] = (step - inwards) * normal[r] + pull[r]
        if constraint[i] > 0:
            p = projectors[constraint[i]]
            right[i] = p @ right[i]
            for k in range(lo, hi):
                blocks[k] = (p @ blocks[k].copy().reshape(3, 3)).ravel()
            block = p @ diagonal[i].copy().reshape(3, 3) @ p
            diagonal[i] = (block + np.eye(3) - p).ravel()
    return diagonal, blocks, right


@njit(cache=True)
def _follow(i, starts, nodes, image, maps, constraint, blocks):
    """Let a node at a free edge move as its neighbours off the edge, or as those on it if it has no others."""
    inside = 0
    for k in range(starts[i], starts[i + 1]):
        inside += _is_there(maps[image[k]]) and constraint[nodes[k]] != FREE
    for k in range(starts[i], starts[i + 1]):
        if _is_there(maps[image[k]]) and (constraint[nodes[k]] != FREE or inside == 0):
            blocks[k, 0] = blocks[k, 4] = blocks[k, 8] = -1.0 / inside if inside else -0.5


@njit(cache=True)
def _is_there(image_map):
    """Whether a neighbour is neither a mirror image (trace of its map 1) nor a continuation (trace -3)."""
    return image_map[0, 0] + image_map[1, 1] + image_map[2, 2] > 2.0


@njit(cache=True)
def _dual_tangents(d, lo, hi, normal, a, b):
    """Write the duals of the tangents of a front at a node, without their common divisor, which is returned."""
    t, u = np.zeros(3), np.zeros(3)
    for k in range(lo, hi):
        angle = 2.0 * math.pi * (k - lo) / (hi - lo)
        c, s = 2.0 / (hi - lo) * math.cos(angle), 2.0 / (hi - lo) * math.sin(angle)
        for r in range(3):
            t[r] += c * d[k, r]
            u[r] += s * d[k, r]
    for r in range(3):
        p, q = (r + 1) % 3, (r + 2) % 3
        a[r] = u[p] * normal[q] - u[q] * normal[p]
        b[r] = normal[p] * t[q] - normal[q] * t[p]
    jacobian = t[0] * a[0] + t[1] * a[1] + t[2] * a[2]
    size = (t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    return max(jacobian, LEAST_SINE * math.sqrt(size))


@njit(cache=True, error_model="numpy")
def _strength(d, length, previous, k, opposite, normal, level):
    """Dissipation along a neighbour: more if lines converge and corners are concave."""
    sensor = (previous[k] + previous[opposite]) / (length[k] + length[opposite])
    sensor = min(max(sensor ** (2.0 / level), LEAST_SENSOR), LARGEST_SENSOR)
    cosine = 0.0
    for r in range(3):
        cosine += 0.5 * normal[r] * (d[k, r] / length[k] + d[opposite, r] / length[opposite])
    cosine = min(max(cosine, 0.0), LARGEST_COSINE)
    return sensor / (1.0 - cosine * cosine)


@njit(cache=True)
def _add_neighbour(i, k, coefficient, image_map, is_image, diagonal, blocks):
    """Add the coefficient of a neighbour, which moves as the image of a node if it is one."""
    if not is_image:
        for r in range(9):
            blocks[k, r] = coefficient[r]
        return
    for r in range(3):
        for q in range(3):
            product = 0.0
            for p in range(3):
                product += coefficient[3 * r + p] * image_map[p, q]
            blocks[k, 3 * r + q] = product
            diagonal[i, 3 * r + q] += coefficient[3 * r + q] - product
