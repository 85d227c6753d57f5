"""Certified validity beside poles: the factor of the Jacobian that is zero there is divided out, and nothing more."""

from itertools import permutations
from math import comb

import numpy as np
import pytest

from bspline_mdao.core.evaluation.poles import next_to_pole, poles_of
from bspline_mdao.core.evaluation.spline_bounds import Lanes, Queue
from bspline_mdao.core.evaluation.spline_validity import spline_statuses
from bspline_mdao.core.splines.volume import Volume, evaluate_gradients, volume_basis
from bspline_mdao.grids.cells.bernstein import INVALID, UNDECIDED, VALID
from bspline_mdao.splines import BilinearKnots, ConstantKnots

COUNTS, ORDERS = (5, 6, 7), (4, 3, 4)  # about the pole, towards it, along it


def wedge(rng, roles, end, size, spread=0.9):
    """A sector about a bent pole, with knots that differ from edge to edge but not about the pole on it.

    ``roles`` are the directions about, towards and along the pole.
    """
    _, towards, along = roles
    n, p = np.empty(3, dtype=int), np.empty(3, dtype=int)
    n[list(roles)], p[list(roles)] = COUNTS, ORDERS
    knots = []
    for e in range(3):
        corners = np.tile(ConstantKnots.uniform(n[e], p[e]).knots, (2, 2, 1))
        corners[..., p[e] : n[e]] += spread * 0.5 / (n[e] - p[e] + 1) * rng.uniform(-1.0, 1.0, (2, 2, n[e] - p[e]))
        if e == along:
            sides = np.moveaxis(corners, 0 if towards == (e + 1) % 3 else 1, 0)
            sides[end, 1] = sides[end, 0]
        knots.append(BilinearKnots(corners, int(p[e])))
    a, t, z = np.meshgrid(*(np.linspace(0.0, 1.0, count) for count in COUNTS), indexing="ij")
    radius = (1.0 - t) * (1.0 + size * rng.uniform(-1.0, 1.0, t.shape) / COUNTS[1])
    angle = 1.3 * a + size * rng.uniform(-1.0, 1.0, a.shape) / COUNTS[0] * (t < 1.0)
    shift = size * rng.uniform(-1.0, 1.0, z.shape) / COUNTS[2] * (t < 1.0)
    bend = 0.4 * np.sin(2.0 * z)
    net = np.stack([radius * np.cos(angle) + bend, radius * np.sin(angle), 2.0 * z + shift + 0.3 * radius], axis=-1)
    net = np.moveaxis(net if end == 1 else net[:, ::-1], (0, 1, 2), roles)
    is_even = roles in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    sign = (1 if is_even else -1) * (1 if end == 1 else -1)
    return Volume(tuple(knots)), np.ascontiguousarray(net), sign


def least_divided(volume, net, sign, roles, end, rng, n=30_000):
    """Smallest sampled Jacobian of every element by the distance from the pole, down to one of 1e-9."""
    x = rng.uniform(0.0, 1.0, (n, 3))
    distance = np.where(rng.uniform(size=n) < 0.5, 10.0 ** rng.uniform(-9.0, 0.0, n), x[:, roles[1]])
    on_side = rng.integers(0, 3, n)
    for e in (roles[0], roles[2]):
        x[on_side == e, e] = np.round(x[on_side == e, e])
    x[:, roles[1]] = 1.0 - distance if end == 1 else distance
    jacobian = sign * np.linalg.det(evaluate_gradients(volume, net, x)) / np.maximum(distance, 1e-300)
    least = np.full([c - p + 1 for c, p in zip(volume.n_control, volume.orders)], np.inf)
    np.minimum.at(least, tuple(volume_basis(volume, x)[0].T), jacobian)
    return least


@pytest.mark.slow
@pytest.mark.parametrize("end", [0, 1])
def test_nothing_is_falsely_valid_beside_a_pole_up_to_where_it_folds(end):
    lows = []
    for number, roles in enumerate(permutations(range(3))):
        for seed in range(2):
            least, most = 0.0, 4.0
            for _ in range(10):  # the largest change of which all elements beside the pole are proved
                size, rng = 0.5 * (least + most), np.random.default_rng([end, number, seed])
                volume, net, sign = wedge(rng, roles, end, size)
                adjacent = np.moveaxis(spline_statuses(volume, net, sign), roles, (0, 1, 2))[:, -end]
                least, most = (size, most) if (adjacent == VALID).all() else (least, size)
            volume, net, sign = wedge(np.random.default_rng([end, number, seed]), roles, end, least)
            sampled = least_divided(volume, net, sign, roles, end, np.random.default_rng(9), 20_000)
            lows.append(np.moveaxis(sampled, roles, (0, 1, 2))[:, -end].min())
    assert min(lows) > 0.0
    assert np.median(lows) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("end", [0, 1])
def test_little_is_undecided_beside_a_pole(end):
    rng, counts = np.random.default_rng(11 + end), np.zeros(3, dtype=int)
    for roles in permutations(range(3)):
        for size in (0.3, 1.0, 1.6, 2.2, 2.8):
            status = np.moveaxis(spline_statuses(*wedge(rng, roles, end, size)), roles, (0, 1, 2))
            counts += np.bincount(status[:, -end].ravel(), minlength=3)
    assert counts[VALID] > 100
    assert counts[INVALID] > 10
    assert counts[UNDECIDED] < 0.03 * counts.sum()


def test_a_side_is_no_pole_where_knots_along_it_differ_about_it():
    rng, roles = np.random.default_rng(3), (2, 0, 1)
    volume, net, sign = wedge(rng, roles, 1, 0.1)
    edges = [knots.corners for knots in volume.knots]
    assert poles_of(tuple(edges), net, 1e-12) == [(2, 0, 1)]
    assert (spline_statuses(volume, net, sign) == VALID).all()
    corners = edges[1].copy()
    corners[0, 1, 4] += 1e-6  # directions of its edges: about the pole, then towards it
    differing = Volume((volume.knots[0], BilinearKnots(corners, volume.orders[1]), volume.knots[2]))
    assert poles_of((edges[0], corners, edges[2]), net, 1e-12) == []
    assert (spline_statuses(differing, net, sign)[-1] == UNDECIDED).any()


def shares_of(volume, x, spans):
    """Shares of the spans at points, and the derivatives of the parameters in them, (n, 3) and (n, 3, 3)."""
    K, u, widths = np.zeros((len(x), 3, 3)), np.empty_like(x), np.empty_like(x)
    for e, (knots, span) in enumerate(zip(volume.knots, spans)):
        s, t, at = x[:, (e + 1) % 3], x[:, (e + 2) % 3], slice(span + knots.order - 1, span + knots.order + 1)
        first, last = knots.values(s, t)[:, at].T
        slopes = knots.gradients(s, t)[:, at]
        widths[:, e] = last - first
        u[:, e] = (x[:, e] - first) / widths[:, e]
        for n, f in enumerate(((e + 1) % 3, (e + 2) % 3)):
            K[:, e, f] = (1.0 - u[:, e]) * slopes[:, 0, n] + u[:, e] * slopes[:, 1, n]
    return u, np.linalg.inv(np.eye(3) - K) * widths[:, None, :]


def bernstein(order, u):
    """Bernstein polynomials of a degree at points, shape (n, order)."""
    return np.stack([comb(order - 1, i) * u**i * (1.0 - u) ** (order - 1 - i) for i in range(order)], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("roles", list(permutations(range(3))), ids=str)
def test_divided_derivatives_lie_between_those_of_their_control_vectors(roles, end):
    rng, pole = np.random.default_rng(4), (roles[0], roles[1], end)
    volume, net, _ = wedge(rng, roles, end, 1.0)
    knots, shape = tuple(k.corners for k in volume.knots), [n - p + 1 for n, p in zip(volume.n_control, volume.orders)]
    side, status = next_to_pole(pole, tuple(shape)), np.zeros(shape, dtype=np.uint8)
    varies = ~np.eye(3, dtype=bool)
    lanes, queue = Lanes(8, volume.orders, varies, np.zeros(3), pole), Queue.of(8, status.size)
    assert lanes.fill(knots, ~side.ravel(), net, 1e-12, status.ravel(), queue) == side.sum() == 8
    x = rng.uniform(0.0, 1.0, (200_000, 3))
    x[:, roles[1]] = np.abs(end - 10.0 ** rng.uniform(-6.0, 0.0, len(x)))
    places, gradients = volume_basis(volume, x)[0], evaluate_gradients(volume, net, x)
    low, high = rng.uniform(0.0, 0.4, (3, 8)), rng.uniform(0.6, 1.0, (3, 8))
    (high if end == 1 else low)[roles[1]] = end
    lanes.boxes.fractions[:, 0], lanes.boxes.fractions[:, 1] = low, high
    lanes.derive()
    n_sampled, tight = 0, np.inf
    for lane, number in enumerate(lanes.boxes.numbers):
        spans = np.unravel_index(number, shape)
        is_in = (places == spans).all(axis=1)
        u, to_shares = shares_of(volume, x[is_in], spans)
        in_box = ((u >= low[:, lane]) & (u <= high[:, lane])).all(axis=1)
        u = (u[in_box] - low[:, lane]) / (high - low)[:, lane]
        derivatives = np.einsum("ox,nxe,nev->nvo", lanes.frame[..., lane], gradients[is_in][in_box], to_shares[in_box])
        derivatives[:, roles[0]] /= np.abs(end - u[:, roles[1]])[:, None]
        a, b, c = (bernstein(p, u[:, e]) for e, p in enumerate(volume.orders))
        vectors = lanes.vectors[..., lane]
        centres, radii = np.einsum("vrabco,na,nb,nc->rnvo", vectors, a, b, c, optimize=True)
        rounding = 1e-7 * np.abs(derivatives).max() * (np.arange(3) == roles[0])[:, None] + 1e-12
        assert (np.abs(derivatives - centres) <= radii + rounding).all()
        n_sampled += len(u)
        tight = min(tight, (radii[:, roles[0]] / np.abs(derivatives[:, roles[0]]).max()).max())
    assert n_sampled > 1_000
    assert tight < 1.0
