"""Springs of a hexahedron: lineal ones between its corners, torsional ones at them.

Every spring resists the change of one number Q of the element, with a stiffness of 1: its energy for a displacement u
is (g . u)^2 / 2 with g the gradient of Q by the corners. How stiff it is in the usual sense lies in Q:

- along an edge, a face diagonal or a body diagonal of length L, dQ = L^(-power / 2) dL: stiffness 1 / L^power;
- between two edges at a corner with angle theta, dQ = d theta / sin(theta): stiffness 1 / sin(theta)^2;
- at a corner with triple product t of unit edges, dQ = dt / t.

The last two are floored (`bspline_mdao.movement.floors`). An edge counts a quarter and a face diagonal a half, since as
many elements share it. The second derivatives of Q are symmetric, so that one function, g, gives the derivatives of the
force in both directions: its change along a field is taken by a complex step, which is exact to round-off. Powers are
those of the real part with a linear term in the rest, which is all that an infinitesimal step needs.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .element_corners import add_element
from .floors import FLAT_CORNER, floored
from .gauss_points import FAST
from .vectors import add, cross, dot, less, scaled

__all__ = ["N_LINEAL", "N_SPRINGS", "add_stiffness", "force", "force_jvp", "force_vjp"]

N_LINEAL = 28
"""Pairs of corners."""

N_SPRINGS = N_LINEAL + 8 * 4
"""All springs of an element: at every corner three angles and the triple product."""

_STEP = 1e-100


def _points():
    """Corners of every spring, shape (N_SPRINGS, 4): two ends, or a vertex and two or three ends, and then any."""
    pairs = [(p, q, p, p) for p in range(8) for q in range(p + 1, 8)]
    corners = []
    for c in range(8):
        a, b, d = c ^ 1, c ^ 2, c ^ 4
        corners += [(c, a, b, c), (c, b, d, c), (c, d, a, c), (c, a, b, d)]
    return np.array(pairs + corners)


_POINTS = _points()
_COUNTS = np.array([2] * N_LINEAL + [3, 3, 3, 4] * 8)
_SHARES = np.array([(0.5, np.sqrt(0.5), 1.0)[bin(p ^ q).count("1") - 1] for p, q in _POINTS[:N_LINEAL, :2]])
_PARITY = np.array([(-1.0) ** bin(c).count("1") for c in range(8)])


@njit(cache=True, inline="always")
def _corner(x, c):
    return x[c, 0], x[c, 1], x[c, 2]


@njit(cache=True, inline="always")
def _power(t, exponent):
    """Power of a number with a positive real part and no more than an infinitesimal imaginary one."""
    real = t.real**exponent
    return real * (1.0 + exponent * (t * (1.0 / t.real) - 1.0))


@njit(cache=True, inline="always")
def _inverse_root(t):
    """Power -1/2, likewise."""
    real = 1.0 / np.sqrt(t.real)
    return real * (1.5 - 0.5 * t * (real * real))


@njit(cache=True, inline="always")
def _inverse(t):
    """Power -1, likewise."""
    real = 1.0 / t.real
    return real * (2.0 - t * real)


@njit(cache=True)
def _inverse_floor(t, t_0):
    """Inverse of the floor of t at t_0."""
    return _inverse(t if t.real >= t_0 else floored(t, t_0)[0])


@njit(cache=True, inline="always")
def _unit(start, end):
    """Unit vector between two points, and the inverse of their distance."""
    edge = less(end, start)
    inverse = _inverse_root(dot(edge, edge) + 1e-290)
    return scaled(inverse, edge), inverse


@njit(cache=True, inline="always")
def _put(g, n, vector):
    g[n, 0], g[n, 1], g[n, 2] = vector


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _lineal(x, points, factor, power, g):
    """Gradient of the Q of a lineal spring by its ends."""
    direction, inverse = _unit(_corner(x, points[0]), _corner(x, points[1]))
    by_end = scaled(factor * _power(inverse, 0.5 * power), direction)
    _put(g, 0, scaled(-1.0, by_end))
    _put(g, 1, by_end)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _angular(x, points, factor, g):
    """Gradient of the Q of an angle by its vertex and the ends of its legs."""
    vertex = _corner(x, points[0])
    a, by_a = _unit(vertex, _corner(x, points[1]))
    b, by_b = _unit(vertex, _corner(x, points[2]))
    cosine = dot(a, b)
    slope = -factor * _inverse_floor(1.0 - cosine * cosine, FLAT_CORNER * FLAT_CORNER)
    first = scaled(slope * by_a, less(b, scaled(cosine, a)))
    second = scaled(slope * by_b, less(a, scaled(cosine, b)))
    _put(g, 0, scaled(-1.0, add(first, second)))
    _put(g, 1, first)
    _put(g, 2, second)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _solid(x, points, factor, sign, g):
    """Gradient of the Q of a corner by its vertex and the ends of its three edges."""
    vertex = _corner(x, points[0])
    a, by_a = _unit(vertex, _corner(x, points[1]))
    b, by_b = _unit(vertex, _corner(x, points[2]))
    c, by_c = _unit(vertex, _corner(x, points[3]))
    bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
    t = dot(a, bc)
    slope = sign * factor * _inverse_floor(sign * t, FLAT_CORNER)
    first = scaled(slope * by_a, less(bc, scaled(t, a)))
    second = scaled(slope * by_b, less(ca, scaled(t, b)))
    third = scaled(slope * by_c, less(ab, scaled(t, c)))
    _put(g, 0, scaled(-1.0, add(first, add(second, third))))
    _put(g, 1, first)
    _put(g, 2, second)
    _put(g, 3, third)


@njit(cache=True)
def _gradient(x, n, sign, settings, g):
    """Gradient g of spring n by its corners; settings are the power and the weight of torsion."""
    power, torsion = settings
    points = _POINTS[n]
    if n < N_LINEAL:
        _lineal(x, points, _SHARES[n], power, g)
    elif n % 4 < 3:
        _angular(x, points, torsion, g)
    else:
        _solid(x, points, torsion, sign * _PARITY[points[0]], g)


@njit(cache=True)
def _step_along(x, dx, z):
    """Corners with a complex step along dx."""
    for c in range(8):
        for d in range(3):
            z[c, d] = complex(x[c, d], _STEP * dx[c, d])


@njit(cache=True)
def _gradient_and_change(z, n, sign, settings, complex_g, g, dg):
    """Gradient of spring n, and its change along the complex step of the corners z."""
    _gradient(z, n, sign, settings, complex_g)
    for c in range(_COUNTS[n]):
        for d in range(3):
            g[c, d] = complex_g[c, d].real
            dg[c, d] = complex_g[c, d].imag / _STEP


@njit(cache=True)
def _stretch(g, n, u):
    """Product g . u of spring n."""
    total = 0.0
    for c in range(_COUNTS[n]):
        for d in range(3):
            total += g[c, d] * u[_POINTS[n, c], d]
    return total


@njit(cache=True)
def _add_force(g, n, factor, f):
    """Add factor times g to the corners of spring n."""
    for c in range(_COUNTS[n]):
        for d in range(3):
            f[_POINTS[n, c], d] += factor * g[c, d]


@njit(cache=True)
def _is_left_out(n, bits):
    """Whether a spring sits at a corner with a collapsed edge."""
    return n >= N_LINEAL and (bits >> _POINTS[n, 0]) & 1 != 0


@njit(cache=True)
def _gather(values, corners, local):
    for c in range(8):
        for d in range(3):
            local[c, d] = values[corners[c], d]


@njit(cache=True)
def _scatter(local, corners, values):
    for c in range(8):
        for d in range(3):
            values[corners[c], d] += local[c, d]


@njit(cache=True)
def force(points, elements, signs, left_out, n_springs, settings, displacement):
    """Compute the force K u on every point.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        Coordinates (m).
    elements : ndarray of int32, shape (n_elements, 8)
        Points at the corners.
    signs : ndarray of int8, shape (n_elements,)
        Handedness.
    left_out : ndarray of uint8, shape (n_elements,)
        Bits of the corners without torsional springs.
    n_springs : int
        `N_LINEAL`, or `N_SPRINGS` with torsion.
    settings : tuple of float
        Power of the lineal stiffness, and factor of dQ of the torsional springs.
    displacement : ndarray, shape (n_points, 3)
        The field u (m).

    Returns
    -------
    ndarray, shape (n_points, 3)
    """
    total = np.zeros_like(points)
    x, u, f, g = np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3)), np.empty((4, 3))
    for e in range(len(elements)):
        _gather(points, elements[e], x)
        _gather(displacement, elements[e], u)
        f[:] = 0.0
        for n in range(n_springs):
            if not _is_left_out(n, left_out[e]):
                _gradient(x, n, float(signs[e]), settings, g)
                _add_force(g, n, _stretch(g, n, u), f)
        _scatter(f, elements[e], total)
    return total


@njit(cache=True)
def force_jvp(points, elements, signs, left_out, n_springs, settings, displacement, d_points, d_displacement):
    """Change of `force` for changes of the points and the displacement."""
    total = np.zeros_like(points)
    x, u, f, g = np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3)), np.empty((4, 3))
    dx, du, dg = np.empty((8, 3)), np.empty((8, 3)), np.empty((4, 3))
    z, complex_g = np.empty((8, 3), np.complex128), np.empty((4, 3), np.complex128)
    for e in range(len(elements)):
        sign = float(signs[e])
        _gather(points, elements[e], x)
        _gather(displacement, elements[e], u)
        _gather(d_points, elements[e], dx)
        _gather(d_displacement, elements[e], du)
        _step_along(x, dx, z)
        f[:] = 0.0
        for n in range(n_springs):
            if not _is_left_out(n, left_out[e]):
                _gradient_and_change(z, n, sign, settings, complex_g, g, dg)
                _add_force(dg, n, _stretch(g, n, u), f)
                _add_force(g, n, _stretch(dg, n, u) + _stretch(g, n, du), f)
        _scatter(f, elements[e], total)
    return total


@njit(cache=True)
def force_vjp(points, elements, signs, left_out, n_springs, settings, displacement, bar):
    """Transpose of `force_jvp`: derivatives by the points and the displacement."""
    points_bar, displacement_bar = np.zeros_like(points), np.zeros_like(points)
    x, u, v = np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3))
    x_bar, u_bar = np.empty((8, 3)), np.empty((8, 3))
    g, along_u, along_v = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    z_u, z_v = np.empty((8, 3), np.complex128), np.empty((8, 3), np.complex128)
    complex_g = np.empty((4, 3), np.complex128)
    for e in range(len(elements)):
        sign = float(signs[e])
        _gather(points, elements[e], x)
        _gather(displacement, elements[e], u)
        _gather(bar, elements[e], v)
        _step_along(x, u, z_u)
        _step_along(x, v, z_v)
        x_bar[:] = 0.0
        u_bar[:] = 0.0
        for n in range(n_springs):
            if not _is_left_out(n, left_out[e]):
                _gradient_and_change(z_u, n, sign, settings, complex_g, g, along_u)
                _gradient_and_change(z_v, n, sign, settings, complex_g, g, along_v)
                _add_force(g, n, _stretch(g, n, v), u_bar)
                _add_force(along_u, n, _stretch(g, n, v), x_bar)
                _add_force(along_v, n, _stretch(g, n, u), x_bar)
        _scatter(x_bar, elements[e], points_bar)
        _scatter(u_bar, elements[e], displacement_bar)
    return points_bar, displacement_bar


@njit(cache=True)
def add_stiffness(points, elements, signs, left_out, n_springs, settings, rows, slots, data):
    """Add the stiffness of all springs to blocks, see `bspline_mdao.movement.element_stiffness.add_stiffness`."""
    x, g, stiffness = np.empty((8, 3)), np.empty((4, 3)), np.empty((8, 8, 3, 3))
    for e in range(len(elements)):
        _gather(points, elements[e], x)
        stiffness[:] = 0.0
        for n in range(n_springs):
            if not _is_left_out(n, left_out[e]):
                _gradient(x, n, float(signs[e]), settings, g)
                _add_square(g, n, stiffness)
        add_element(stiffness, rows[e], slots[e], data)


@njit(cache=True)
def _add_square(g, n, stiffness):
    """Add g g^T of spring n, pair by pair of its corners."""
    for a in range(_COUNTS[n]):
        for b in range(_COUNTS[n]):
            for c in range(3):
                for d in range(3):
                    stiffness[_POINTS[n, a], _POINTS[n, b], c, d] += g[a, c] * g[b, d]
