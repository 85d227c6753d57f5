"""Mean value coordinates: a point inside a closed surface of triangles as a weighted mean of their corners.

On the unit sphere around a point x, average the vectors to every triangle. With the unit vectors u_k from x to the
corners of a triangle, at the distances d_k, the integral of the unit vectors over its image is

    m = 1/2 sum_k theta_k n_k / norm(n_k) ,   n_k = u_(k+1) x u_(k+2) ,   theta_k the angle between these two,

Since m = sum_k w_k d_k u_k for w_k = m . n_k / (d_k u_k . n_k), and the integrals over a closed surface cancel, the w
of all triangles are weights with sum_k w_k (x_k - x) = 0. Divided by their sum they are coordinates: they reproduce
every affine function, are smooth inside, and become linear on the triangles. After T. Ju, S. Schaefer and
J. Warren, Mean Value Coordinates for Closed Triangular Meshes, ACM Transactions on Graphics 24 (2005) 561-566.

Theory: ``docs/theory/body_points.rst``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["add_weights"]

ON_TRIANGLE = 1e-11
"""Volume spanned by unit vectors to the corners of a triangle below which a point lies in the plane of the triangle."""


@njit(cache=True, nogil=True, error_model="numpy")
def add_weights(points, corners, triangles, weights, windings):  # pragma: no cover
    """Find the weights of the corners in each point, up to a factor, and the surface's winding number about it."""
    # points: (n, 3), the points (m)
    # corners: (m, 3), corners of the triangles (m)
    # triangles: (n_triangles, 3) of int, their numbers in each triangle, which has an area, around the outward normal
    # of the body weights: (n, m), zeros, replaced by the weights windings: (n,), replaced by the fraction of directions
    # in which the surface is seen from inside
    for p in range(len(points)):
        x, y, z = points[p]
        row, angle, on = weights[p], 0.0, -1
        for t in range(len(triangles)):
            i, j, k = triangles[t]
            ax, ay, az = corners[i, 0] - x, corners[i, 1] - y, corners[i, 2] - z
            bx, by, bz = corners[j, 0] - x, corners[j, 1] - y, corners[j, 2] - z
            cx, cy, cz = corners[k, 0] - x, corners[k, 1] - y, corners[k, 2] - z
            da = np.sqrt(ax * ax + ay * ay + az * az)
            db = np.sqrt(bx * bx + by * by + bz * bz)
            dc = np.sqrt(cx * cx + cy * cy + cz * cz)
            if da == 0.0 or db == 0.0 or dc == 0.0:
                on = t
                break
            ax, ay, az = ax / da, ay / da, az / da
            bx, by, bz = bx / db, by / db, bz / db
            cx, cy, cz = cx / dc, cy / dc, cz / dc
            px, py, pz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
            qx, qy, qz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
            rx, ry, rz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            bc, ca, ab = bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az, ax * bx + ay * by + az * bz
            sp = np.sqrt(px * px + py * py + pz * pz)
            sq = np.sqrt(qx * qx + qy * qy + qz * qz)
            sr = np.sqrt(rx * rx + ry * ry + rz * rz)
            tp, tq, tr = np.arctan2(sp, bc), np.arctan2(sq, ca), np.arctan2(sr, ab)
            volume = ax * px + ay * py + az * pz
            if abs(volume) < ON_TRIANGLE * max(sp, sq, sr):
                if tp + tq + tr > 2.0 * np.pi - 1e-6:
                    on = t
                    break
                continue  # in its plane, outside it: the triangle is seen edge-on
            angle += 2.0 * np.arctan2(volume, 1.0 + bc + ca + ab)
            fp = 0.5 * tp / sp if sp > 0.0 else 0.0
            fq = 0.5 * tq / sq if sq > 0.0 else 0.0
            fr = 0.5 * tr / sr if sr > 0.0 else 0.0
            mx, my, mz = fp * px + fq * qx + fr * rx, fp * py + fq * qy + fr * ry, fp * pz + fq * qz + fr * rz
            row[i] += (mx * px + my * py + mz * pz) / (da * volume)
            row[j] += (mx * qx + my * qy + mz * qz) / (db * volume)
            row[k] += (mx * rx + my * ry + mz * rz) / (dc * volume)
        windings[p] = angle / (4.0 * np.pi)
        if on >= 0:
            row[:] = 0.0
            windings[p] = 1.0
            _lay_on_triangle(points[p], corners, triangles[on], row)


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_on_triangle(point, corners, triangle, row):  # pragma: no cover
    """Linear weights of the corners of the triangle that a point lies on: twice the areas across from them."""
    for k in range(3):
        a, b = corners[triangle[(k + 1) % 3]] - point, corners[triangle[(k + 2) % 3]] - point
        row[triangle[k]] = np.linalg.norm(np.cross(a, b))
